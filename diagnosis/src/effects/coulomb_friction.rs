//! Dry friction of constant size at both wheels: f = c sgn s on each, s the wheel's ground speed; with `each_wheel` of a size of its own
//! on each.
//!
//! In the body frame it uses up (f_R + f_L)/2 of the forward command and ρ (f_R − f_L)/(2h) of the turning command, ρ the
//! turning ratio. In channels without wheels each output has a friction of its own.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::words::smooth_sign;

/// Coulomb friction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFriction {
    /// A size for each wheel. Default `false`.
    #[serde(default)]
    pub each_wheel: bool,
}

#[typetag::serde(name = "coulomb_friction")]
impl Effect for CoulombFriction {
    fn name(&self) -> &str {
        "coulomb_friction"
    }

    fn about(&self) -> String {
        match self.each_wheel {
            false => "dry friction of constant size at both wheels".to_owned(),
            true => "dry friction of constant size at each wheel".to_owned(),
        }
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        match self.each_wheel {
            false => force::needs_commands(scene),
            true => force::needs_wheels(scene),
        }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let sizes = match self.each_wheel {
            false => force::sizes(scene, "friction"),
            true => [Wheel::Left, Wheel::Right]
                .iter()
                .flat_map(|wheel| force::sizes(scene, "friction").into_iter().map(|p| p.of("wheel", wheel.word())))
                .collect(),
        };
        sizes.into_iter().chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let scales: Vec<f64> = self.parameters(scene).iter().filter(|p| p.neutral.is_some()).map(|p| p.scale).collect();
        force::starts(scene, &scales, &(0..scales.len()).map(|i| vec![i]).collect::<Vec<_>>())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if let (true, [left, right, ..]) = (self.each_wheel, values) {
            let [left, right] = [left, right].map(|v| force::in_words(*v, scene));
            return format!("dry friction uses up {left} at the left wheel and {right} at the right one; the model had none");
        }
        let whose = if scene.frame.has_wheels() { "at each wheel".to_owned() } else { format!("on `{}`", scene.outputs[0].name) };
        format!("dry friction {whose} uses up {}; the model had none", force::in_words(values[0], scene))
    }

    fn narrower(&self, values: &[f64], scene: &Scene) -> Option<&'static str> {
        let parameters = self.parameters(scene);
        let (sizes, _) = values.split_at(parameters.iter().take_while(|p| p.neutral.is_some()).count());
        let idle = |wheel: &[f64]| wheel.iter().zip(&parameters).all(|(x, p)| p.is_neutral(*x));
        (self.each_wheel && sizes.chunks(sizes.len().div_ceil(2).max(1)).any(idle)).then_some("coulomb_friction_one_wheel")
    }

    fn contains(&self) -> &'static [&'static str] {
        if self.each_wheel { &["coulomb_friction", "coulomb_friction_one_wheel"] } else { &[] }
    }

    fn excitation(&self) -> &'static str {
        "slow driving in both directions, through standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "rolling_resistance",
                because: "always, as far as the driven wheels resist: rolling resistance is dry friction there to the letter; what other wheels carry shows in turning in place only",
            },
            Confusion {
                with: "coulomb_friction_one_wheel",
                because: "while no wheel reverses, friction is a constant offset of each command, whichever wheel it comes from",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "friction that differs forwards and backwards is this one as long as the robot does not drive backwards",
            },
            Confusion {
                with: "stribeck_friction",
                because: "above the speed at which friction has fallen to its running value the two are one",
            },
            Confusion {
                with: "dead_zone",
                because: "a subtracting dead zone takes as much off the command, and differs at reversals only",
            },
            Confusion { with: "theta4", because: "over a narrow range of speeds a constant loss looks like one proportional to speed" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        if self.each_wheel {
            let frame = &at.scene.frame;
            let [left, right] = frame.wheels(outputs).map(|s| smooth_sign(s, at.scene.scales.speed));
            frame.add_at_wheels([p[0] * left, p[1] * right], p.get(2).copied().unwrap_or(1.0), load);
            return;
        }
        force::at_contacts(at, outputs, p.get(1), load, |contact, _, sign| p[contact] * sign);
    }
}
