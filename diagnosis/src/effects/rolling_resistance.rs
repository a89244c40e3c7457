//! Rolling resistance: every wheel resists in proportion to the load that it carries.
//!
//! The driven wheels' share acts on each against its own rolling, F = d sgn s, and is therefore dry friction at the wheels to the letter
//! (`coulomb_friction`, same equation, same signs). What tells them apart is the share of the weight that other wheels carry along on the
//! centre line: F = c sgn v against forward motion, without a lever to brake a turn. Of the two shares none is known beforehand. How a
//! castor swings round is `castor_drag`, how patches scrub is `turning_scrub`.

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
        "a constant force of every wheel that carries load, driven or not".to_owned()
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
        let sizes = ["resistance", "driven"].into_iter().flat_map(|name| force::sizes(scene, name));
        sizes.chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        force::starts(scene, &[0.05 * force::command(scene, 0); 2], &[vec![0], vec![1]])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let [body, driven] = [values[0], values[1]].map(|size| force::in_words(size, scene));
        format!("rolling resistance uses up {body} for the body and {driven} at each driven wheel; the model had none")
    }

    fn contains(&self) -> &'static [&'static str] {
        &["coulomb_friction"]
    }

    fn excitation(&self) -> &'static str {
        "driving forwards and backwards, and turning in place"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "coulomb_friction",
                because: "always, as far as the driven wheels resist: that is dry friction there to the letter; what other wheels carry shows in turning in place only",
            },
            Confusion {
                with: "direction_asymmetry",
                because: "while the robot does not drive backwards, what it carries along takes a constant off the forward command, as friction does that is greater forwards",
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
        force::at_contacts(at, outputs, p.get(2), load, |_, _, sign| p[1] * sign);
    }
}
