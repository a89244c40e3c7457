//! The ground is not level: gravity takes a_c cos ψ + a_s sin ψ off the forward command, ψ the measured heading.
//!
//! A centre of mass ahead of the axle turns the robot downhill: η (a_c sin ψ − a_s cos ψ) is added to the turning command, with
//! η = ρ b/h² for a centre b ahead, h half the track and ρ the turning ratio. A centre to one side is turned by the pull along the robot: σ
//! (a_c cos ψ + a_s sin ψ) more. Most robots carry it in the middle.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start};

use super::force;
use super::words::{percent, quantity};

/// How far a centre of mass usually lies to one side, of half the track.
const ASIDE: f64 = 0.1;

/// A slope.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slope {}

#[typetag::serde(name = "slope")]
impl Effect for Slope {
    fn name(&self) -> &str {
        "slope"
    }

    fn about(&self) -> String {
        "the ground slopes: a pull that depends on the heading".to_owned()
    }

    fn stage(&self) -> Stage {
        Stage::Load
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        force::needs_wheels(scene).or_else(|| {
            let headed = scene.tracks.iter().all(|t| !t.heading.is_empty());
            (!headed).then(|| "the recording has no heading".to_owned())
        })
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let (typical, unit) = (force::command(scene, 0), force::unit(scene));
        let pull = |name: &str| EffectParameter::new(name, unit, (-2.0 * typical, 2.0 * typical), 0.05 * typical).neutral(0.0);
        // The centre of mass of a robot that stands is within its track's size of the axle, and ρ below four.
        let h = scene.frame.half_track();
        let reach = 4.0 / h;
        let share = |name: &str| EffectParameter::new(name, "1/m", (-reach, reach), 0.05 * reach).neutral(0.0);
        vec![pull("pull_cos"), pull("pull_sin"), share("turning_share"), share("sideways_share").usually(0.0, ASIDE / h)]
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let pull = 0.05 * force::command(scene, 0);
        vec![Start { values: vec![pull, pull, 0.0, 0.0], columns: vec![vec![0], vec![1]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let (c, s) = (values[0], values[1]);
        let pull = c.value.hypot(s.value);
        let uphill = s.value.atan2(c.value);
        // Of a sum of independent parts.
        let ci95 = c.ci95.zip(s.ci95).map(|((a, b), (d, e))| {
            let half = (0.5 * (b - a) * uphill.cos()).hypot(0.5 * (e - d) * uphill.sin());
            ((pull - half).max(0.0), pull + half)
        });
        let turns = match (scene.frame, values[2].value) {
            (_, 0.0) => String::new(),
            (Frame::Body { .. } | Frame::Sides { .. }, share) => {
                format!(", and it turns the robot's {} downhill", if share > 0.0 { "front" } else { "back" })
            }
            (Frame::Channels, _) => String::new(),
        };
        format!(
            "the ground slopes: driving uphill, at a heading of {:.0} degrees, uses up {}, {} of a typical command{turns}; the model's ground was level",
            uphill.to_degrees(),
            quantity(Estimate { value: pull, ci95 }, force::unit(scene)),
            percent(pull / force::command(scene, 0)),
        )
    }

    fn heading_elsewhere(&self, values: &[f64], angle: f64) -> Option<Vec<f64>> {
        let (sin, cos) = angle.sin_cos();
        let (along, across) = (values[0] * cos + values[1] * sin, values[1] * cos - values[0] * sin);
        Some([&[along, across], &values[2..]].concat())
    }

    fn excitation(&self) -> &'static str {
        "driving at all headings, as in a circle"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion { with: "command_offset", because: "while the heading stays the same, a slope is a constant offset" },
            Confusion {
                with: "rolling_resistance",
                because: "while the robot drives one way at one heading, either is a constant offset of the command",
            },
            Confusion {
                with: "theta4",
                because: "while heading and speed stay the same, a constant loss looks like one proportional to speed",
            },
        ]
    }

    fn load(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &[f64], load: &mut [f64]) {
        let (sin, cos) = at.heading().sin_cos();
        let (along, across) = (p[0] * cos + p[1] * sin, p[1] * cos - p[0] * sin);
        at.scene.frame.add_at_body([along, p[2] * across + p[3] * along], load);
    }
}
