//! Dry friction at one wheel only: f = c sgn s there, nothing at the other.
//!
//! A rubbing tyre or a dry bearing: it slows the robot and turns it. In the body frame it uses up f/2 of the forward command and
//! ±ρ f/(2h) of the turning command.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force::{self, Wheel};
use super::words::smooth_sign;

/// Coulomb friction of one wheel.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoulombFrictionOneWheel {
    /// Which one. Default `left`.
    #[serde(default)]
    pub wheel: Wheel,
}

#[typetag::serde(name = "coulomb_friction_one_wheel")]
impl Effect for CoulombFrictionOneWheel {
    fn name(&self) -> &str {
        "coulomb_friction_one_wheel"
    }

    fn about(&self) -> String {
        format!("dry friction of constant size at the {} wheel alone", self.wheel)
    }

    fn stage(&self) -> Stage {
        Stage::Bearing
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let label = |p: EffectParameter| p.of("wheel", self.wheel.word());
        force::sizes(scene, "friction").into_iter().chain(force::turning_ratio(scene)).map(label).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        force::starts(scene, &[0.05 * force::command(scene, 0)], &[vec![0]])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        format!("the {} wheel alone has dry friction: it uses up {}; the model had none", self.wheel, force::in_words(values[0], scene))
    }

    fn excitation(&self) -> &'static str {
        "slow driving and turning in both directions, so that each wheel reverses"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "while no wheel reverses, either is a constant offset of both commands, and the turning offset may be one of the sensor",
            },
            Confusion { with: "gain_asymmetry", because: "at one speed a weaker wheel and a braked wheel pull to the same side alike" },
            Confusion {
                with: "viscous_asymmetry",
                because: "over a narrow range of speeds a constant loss at one wheel looks like one proportional to speed",
            },
            Confusion { with: "slope", because: "while the heading stays the same, a pull to one side may come from the ground" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let (frame, side) = (&at.scene.frame, self.wheel.index());
        let mut forces = [0.0; 2];
        forces[side] = p[0] * smooth_sign(frame.wheels(outputs)[side], at.scene.scales.speed);
        frame.add_at_wheels(forces, p.get(1).copied().unwrap_or(1.0), load);
    }
}
