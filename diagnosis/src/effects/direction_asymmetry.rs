//! Dry friction that differs forwards and backwards: f = c_f on a wheel that rolls forwards, −c_b on one that rolls backwards.
//!
//! A `soft` one comes up with speed: c s/√(s² + s_0²).

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;
use super::words::quantity;

/// Friction by direction.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionAsymmetry {
    /// Whether it comes up with speed. Default `false`: it is whole as soon as a wheel turns.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub soft: bool,
}

#[typetag::serde(name = "direction_asymmetry")]
impl Effect for DirectionAsymmetry {
    fn name(&self) -> &str {
        "direction_asymmetry"
    }

    fn about(&self) -> String {
        let how = if self.soft { " and comes up with speed" } else { "" };
        format!("dry friction that is greater in one direction than in the other{how}")
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.soft { force::needs_wheels(scene) } else { force::needs_commands(scene) }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let mut all = force::sizes(scene, "friction_forward");
        all.extend(force::sizes(scene, "friction_backward"));
        all.extend(self.soft.then(|| force::softness(scene)));
        all.extend(force::turning_ratio(scene));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let (sizes, soft) = (force::sizes(scene, ""), self.soft.then(|| force::softness(scene)));
        let scales: Vec<f64> = sizes.iter().chain(&sizes).chain(&soft).map(|p| p.scale).collect();
        force::starts(scene, &scales, &(0..2 * sizes.len()).map(|i| vec![i]).collect::<Vec<_>>())
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (forward, backward) = (values[0], values[force::contacts(scene)]);
        let harder = if forward.value >= backward.value { "forwards" } else { "backwards" };
        format!(
            "rolling {harder} is harder: dry friction uses up {} of the command forwards and {} backwards{}; the model had none",
            quantity(forward, force::unit(scene)),
            quantity(backward, force::unit(scene)),
            force::comes_up(self.soft.then(|| values[2]))
        )
    }

    fn contains(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }

    fn excitation(&self) -> &'static str {
        "slow driving in both directions, through standstill"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "as long as no wheel rolls backwards, and together with a constant offset of the command always",
            },
            Confusion {
                with: "rolling_resistance",
                because: "while the robot does not drive backwards, what other wheels resist adds to the driven ones' friction forwards and is taken off it backwards",
            },
            Confusion { with: "slope", because: "while the heading stays the same, a slope helps one way and brakes the other alike" },
            Confusion {
                with: "viscous_asymmetry",
                because: "over a narrow range of speeds a loss by direction may be constant or proportional to speed",
            },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let n = force::contacts(at.scene);
        let (ratio, comes_up_by) = (p.get(2 * n + usize::from(self.soft)), self.soft.then(|| p[2 * n]));
        force::at_contacts(at, outputs, ratio, comes_up_by, load, |contact, _, sign| {
            let (forward, backward) = (p[contact], p[n + contact]);
            sign * if sign > 0.0 { forward } else { backward }
        });
    }
}
