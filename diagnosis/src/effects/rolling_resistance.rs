//! Rolling resistance: every wheel resists in proportion to the load that it carries.
//!
//! The driven wheels' share acts on each against its own rolling, F = d sgn s, and is therefore dry friction at the wheels to the letter
//! (`coulomb_friction`, same equation, same signs). What tells them apart is the share w of the weight that other wheels carry along on the
//! centre line, a distance d from the axle: there the robot moves at (v, d ω), and feels F = c against that, c v/√(v² + d² ω²) against forward
//! motion and (ρ d²/h²) c ω/√(v² + d² ω²) against turning; near the axle it is c sgn v without a lever to brake a turn. Of a resistance r to straight
//! driving the driven wheels have (1 − w) r and the others w r. The share is not known beforehand, but at most a half: a robot's weight is nearer to its
//! driven wheels, or they would not move it. One that drags by more than its weight is `castor_drag`, as is how it swings round; how patches scrub is
//! `turning_scrub`.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::force;
use super::words::{quantity, scaled};

/// Places of the parameters; the turning ratio stands last, where there is one.
const RESISTANCE: usize = 0;
const CARRIED: usize = 1;
const DISTANCE: usize = 2;
const RATIO: usize = 3;
/// Share of the weight that other wheels carry on most robots, and the most that they do.
const SHARE: f64 = 0.25;
const MOST: f64 = 0.5;

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
        let carried = EffectParameter::new("carried", "1", (0.0, MOST), 0.2 * SHARE).usually(SHARE, SHARE);
        // Ahead or behind is one. Where nobody knows, near the axle.
        let distance = EffectParameter::new("distance", "m", (0.0, 3.0 * h), 0.2 * h).usually(0.0, h);
        force::sizes(scene, "resistance").into_iter().chain([carried, distance]).chain(force::turning_ratio(scene)).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let size = 0.05 * force::command(scene, 0);
        let at = |distance: f64| force::starts(scene, &[size, SHARE, distance], &[vec![RESISTANCE]]);
        [0.0, scene.frame.half_track()].into_iter().flat_map(at).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (resistance, place) = (force::in_words(values[RESISTANCE], scene), quantity(values[DISTANCE], "m"));
        let carried = quantity(scaled(values[CARRIED], |w| 100.0 * w), "%");
        format!("rolling resistance uses up {resistance} of which what rolls along {place} from the axle has {carried}; the model had none")
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
        let (ratio, carried) = (p.get(RATIO), p[CARRIED] * p[RESISTANCE]);
        force::slides(at.scene, outputs, [carried, p[DISTANCE]], ratio, load);
        force::at_contacts(at, outputs, ratio, None, load, |_, _, sign| (p[RESISTANCE] - carried) * sign);
    }
}
