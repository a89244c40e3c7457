//! The wheels answer their commands unequally: U_R' = (1 + g) U_R, U_L' = (1 − g) U_L.
//!
//! With `servo` it is the whole loop of a wheel that is stronger, and not what it is told alone: the drive gains ± g (U − β s), s the wheel's
//! ground speed and β its feedback, 1 or somewhat less. At rest on its set-point such a wheel runs as the others do. Where the loops are closed on
//! forward and angular velocity, what both ask of a wheel counts by their strengths (`force::asked`).

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::words::{digits, quantity};

/// A stronger wheel: unequal motors, amplifiers, or wheels in a drive without encoders.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GainAsymmetry {
    /// The loops' gains differ, not their commands'. Default `false`.
    #[serde(default)]
    pub servo: bool,
}

#[typetag::serde(name = "gain_asymmetry")]
impl Effect for GainAsymmetry {
    fn name(&self) -> &str {
        "gain_asymmetry"
    }

    fn about(&self) -> String {
        match self.servo {
            false => "the wheels answer their commands unequally".to_owned(),
            true => "one wheel's speed loop is stronger than the other's".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        if self.servo { Stage::Drive } else { Stage::Gain }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        let looped = if self.servo { force::needs_loops(scene) } else { None };
        looped.or_else(|| (!scene.frame.has_wheels()).then(|| "the model's channels do not tell the wheels' commands".to_owned()))
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let gain = EffectParameter::new("gain", "1", (-0.5, 0.5), 0.02).neutral(0.0);
        match self.servo {
            true => [gain].into_iter().chain(force::loops(scene)).collect(),
            false => vec![gain],
        }
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        match self.servo {
            // Loops that close tightly, and ones that hardly look.
            true => [1.0, 0.0].into_iter().flat_map(|feedback| force::starts(scene, &[0.02, feedback], &[vec![0]])).collect(),
            false => vec![Start { values: vec![0.02], columns: vec![vec![0]], linear: true }],
        }
    }

    fn statement(&self, values: &[Estimate], _scene: &Scene) -> String {
        let g = values[0];
        let (strong, weak) = if g.value < 0.0 { ("left", "right") } else { ("right", "left") };
        let percent = |x: f64| 100.0 * x * if g.value < 0.0 { -1.0 } else { 1.0 };
        let ends = g.ci95.map(|(a, b)| (percent(a).min(percent(b)), percent(a).max(percent(b))));
        let size = quantity(Estimate { value: percent(g.value), ci95: ends }, "%");
        if self.servo {
            return format!(
                "the {strong} wheel's speed loop is {size} stronger and the {weak} wheel's as much weaker; the model had equal loops"
            );
        }
        format!(
            "the {strong} wheel answers its command {} too strongly and the {weak} wheel as much too weakly: the robot veers {} by {} of its forward speed; the model had equal wheels",
            size,
            weak,
            digits(2.0 * g.value.abs()),
        )
    }

    fn excitation(&self) -> &'static str {
        "straight driving at several speeds, forwards and backwards, and turning on the spot"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "wheel_radius_mismatch",
                because: "a gain before the drive and one behind it differ only in what the two axes' different time constants leave of them",
            },
            Confusion { with: "command_offset", because: "at one forward speed a veer in proportion to it is a constant turning command" },
            Confusion {
                with: "coulomb_friction_one_wheel",
                because: "while the robot drives one way at one speed, a wheel held back and a wheel with less gain veer alike",
            },
            Confusion {
                with: "lateral_com_offset",
                because: "a mass off the middle makes the robot veer too, but only while it speeds up or slows down",
            },
        ]
    }

    fn holds(&self) -> bool {
        true
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        let frame = at.scene.frame;
        let [left, right] = frame.wheels(u);
        if self.servo {
            return;
        }
        let added = frame.from_wheels([-p[0] * left, p[0] * right]);
        u.iter_mut().zip(added).for_each(|(u, d)| *u += d);
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _state: &[f64], drive: &mut [f64]) {
        if !self.servo {
            return;
        }
        let frame = &at.scene.frame;
        let [left, right] = force::asked(frame, motion, p[1], p[2]);
        frame.add_at_wheels([-p[0] * left, p[0] * right], p[2], drive);
    }
}
