//! Rolling resistance of the body: F = c sgn v against forward motion, and nothing against turning.
//!
//! Tyres and castors on the ground resist in proportion to the load they carry. What the two driven wheels contribute acts on
//! each wheel against its own rolling, and is therefore dry friction at the wheels to the letter (`coulomb_friction`, same
//! equation, same signs). What can be told apart is the share of the body's weight that rolls along on its centre line: it
//! changes sign with v and not with either wheel, and has no lever to brake a turn. This effect is that share. How a castor
//! swings round is `castor_drag`, how patches scrub is `turning_scrub`.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;
use super::words::smooth_sign;

/// Rolling resistance.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RollingResistance {}

#[typetag::serde(name = "rolling_resistance")]
impl Effect for RollingResistance {
    fn name(&self) -> &str {
        "rolling_resistance"
    }

    fn about(&self) -> String {
        "a constant force against forward motion, in proportion to the load, that leaves turning alone".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn family(&self) -> &str {
        "friction"
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        force::sizes(scene, "resistance")
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        vec![Start { values: vec![0.05 * force::command(scene, 0)], columns: vec![vec![0]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        format!("rolling resistance against forward motion uses up {}; the model had none", force::in_words(values[0], scene))
    }

    fn excitation(&self) -> &'static str {
        "driving forwards and backwards, and turning in place"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "resistance at the driven wheels is dry friction there; only turning in place, which friction at the wheels brakes, tells the body's share apart",
            },
            Confusion { with: "castor_drag", because: "on the straight a castor drags with the same force" },
            Confusion {
                with: "slope",
                because: "while the robot drives one way at one heading, either is a constant offset of the command",
            },
            Confusion { with: "theta4", because: "over a narrow range of speeds a constant loss looks like one proportional to speed" },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let frame = &at.scene.frame;
        frame.add_at_body([p[0] * smooth_sign(frame.body(outputs)[0], at.scene.scales.speed), 0.0], load);
    }
}
