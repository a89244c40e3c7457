//! Rolling resistance: every wheel resists in proportion to the load that it carries.
//!
//! The driven wheels' share acts on each against its own rolling, F = d sgn s, and is therefore dry friction at the wheels to the letter
//! (`coulomb_friction`, same equation, same signs). What tells them apart is the share of the weight that other wheels carry along on the
//! centre line, a distance d from the axle: there the robot moves at (v, d ω), and feels F = c against that, c v/√(v² + d² ω²) against forward
//! motion and (ρ d²/h²) c ω/√(v² + d² ω²) against turning; near the axle it is c sgn v without a lever to brake a turn. Neither share is known
//! beforehand. How a castor swings round is `castor_drag`, how patches scrub is `turning_scrub`.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;
use super::words::quantity;

/// Places of the parameters; the turning ratio stands last, where there is one.
const CARRIED: usize = 0;
const DRIVEN: usize = 1;
const DISTANCE: usize = 2;
const RATIO: usize = 3;

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
        let h = scene.frame.half_track();
        let sizes = ["resistance", "driven"].into_iter().flat_map(|name| force::sizes(scene, name));
        // Ahead or behind is one. Where nobody knows, near the axle.
        let distance = EffectParameter::new("distance", "m", (0.0, 3.0 * h), 0.2 * h).usually(0.0, h);
        sizes.chain([distance]).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let size = 0.05 * force::command(scene, 0);
        let at = |distance: f64| force::starts(scene, &[size, size, distance], &[vec![CARRIED], vec![DRIVEN]]);
        [0.0, scene.frame.half_track()].into_iter().flat_map(at).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let [carried, driven] = [CARRIED, DRIVEN].map(|place| force::in_words(values[place], scene));
        let place = quantity(values[DISTANCE], "m");
        format!(
            "rolling resistance uses up {driven} at each driven wheel and {carried} for what rolls along {place} from the axle; the model had none"
        )
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
            Confusion {
                with: "dead_zone",
                because: "a dead zone that subtracts takes as much off, but by the sign of the command and not by that of the motion",
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
        let ratio = p.get(RATIO);
        force::slides(at.scene, outputs, [p[CARRIED], p[DISTANCE]], ratio, load);
        force::at_contacts(at, outputs, ratio, None, load, |_, _, sign| p[DRIVEN] * sign);
    }
}
