//! The ground is not level: gravity takes a_c cos ψ + a_s sin ψ off the forward command, ψ the measured heading.
//!
//! A centre of mass ahead of the axle turns the robot downhill: η (a_c sin ψ − a_s cos ψ) is added to the turning command, with
//! η = ρ b/h² for a centre b ahead, h half the track and ρ the turning ratio. A centre to one side is turned by the pull along the robot: σ
//! (a_c cos ψ + a_s sin ψ) more. Most robots carry it in the middle.
//!
//! With `waves` the ground rises and falls with the place p: the pull is a sin(k·p + φ) along k, the wave's direction, in which a surface that goes up
//! and down by cos(k·p + φ) slopes. The place is dead-reckoned from where a recording began, and with it the phase is a matter of the recording.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Frame, Instant, Scene, Stage, Start, Track};

use super::force;
use super::words::{digits, percent, quantity, scaled};

/// How far a centre of mass usually lies to one side, of half the track.
const ASIDE: f64 = 0.1;

/// A slope.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Slope {
    /// Whether it changes with the place, in waves.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub waves: bool,
}

/// Places of the parameters of ground in waves.
const PULL: usize = 0;
const WAVE: [usize; 2] = [1, 2];
const PHASE: usize = 3;

/// Waves along the longest way across what was driven over that are tried, in halves of one.
const HALVES: i32 = 12;

/// The longest way across what a recording drove over \[m\].
fn across(scene: &Scene) -> f64 {
    let extent = |track: &Track| {
        let range = |of: &Vec<f64>| of.iter().fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(*x), high.max(*x)));
        track.place.iter().map(range).map(|(low, high)| (high - low).powi(2)).sum::<f64>().sqrt()
    };
    scene.tracks.iter().map(extent).fold(scene.frame.half_track(), f64::max)
}

/// The wave number of the shortest wave \[rad/m\]: one as short as the robot is wide is no slope under it.
fn shortest(scene: &Scene) -> f64 {
    std::f64::consts::PI / scene.frame.half_track()
}

impl Slope {
    /// The pull along two fixed directions where the robot is.
    fn pulls(&self, p: &[f64], at: &Instant<'_>) -> [f64; 2] {
        if !self.waves {
            return [p[0], p[1]];
        }
        let (wave, place) = (WAVE.map(|i| p[i]), at.place());
        let number = wave[0].hypot(wave[1]);
        if number == 0.0 {
            return [0.0; 2];
        }
        let pull = p[PULL] * (wave[0] * place[0] + wave[1] * place[1] + p[PHASE]).sin();
        wave.map(|k| pull * k / number)
    }
}

#[typetag::serde(name = "slope")]
impl Effect for Slope {
    fn name(&self) -> &str {
        "slope"
    }

    fn about(&self) -> String {
        let what = if self.waves {
            "the ground rises and falls: a pull that depends on place and heading"
        } else {
            "the ground slopes: a pull that depends on the heading"
        };
        what.to_owned()
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
        let shares = [share("turning_share"), share("sideways_share").usually(0.0, ASIDE / h)];
        if !self.waves {
            return [pull("pull_cos"), pull("pull_sin")].into_iter().chain(shares).collect();
        }
        let shortest = shortest(scene);
        let wave = |name: &str| EffectParameter::new(name, "rad/m", (-shortest, shortest), 0.1 / across(scene));
        let phase = EffectParameter::new("phase", "rad", (-std::f64::consts::PI, std::f64::consts::PI), 0.1).initially();
        [pull("pull"), wave("wave_x"), wave("wave_y"), phase].into_iter().chain(shares).collect()
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let pull = 0.05 * force::command(scene, 0);
        if self.waves {
            let half = std::f64::consts::PI / across(scene);
            // What goes one way up goes the other way down.
            let most = HALVES.min((shortest(scene) / half) as i32);
            let ahead = |(x, y): &(i32, i32)| (*x > 0 || (*x == 0 && *y > 0)) && x * x + y * y <= most * most;
            let numbers = (0..=HALVES).flat_map(|x| (-HALVES..=HALVES).map(move |y| (x, y))).filter(ahead);
            let at = |(x, y): (i32, i32), phase: f64| Start {
                values: vec![pull, half * f64::from(x), half * f64::from(y), phase, 0.0, 0.0],
                columns: vec![vec![PULL]],
                linear: true,
            };
            return numbers.flat_map(|number| [0.0, 0.5 * std::f64::consts::PI].map(|phase| at(number, phase))).collect();
        }
        vec![Start { values: vec![pull, pull, 0.0, 0.0], columns: vec![vec![0], vec![1]], linear: true }]
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if self.waves {
            let [x, y] = WAVE.map(|i| values[i].value);
            let number = x.hypot(y);
            let pull = scaled(values[PULL], |pull| pull * values[PULL].value.signum());
            return format!(
                "the ground rises and falls: along a heading of {:.0} degrees with every {} m, where it pulls by up to {}; the model's ground was level",
                y.atan2(x).to_degrees(),
                digits(std::f64::consts::TAU / number),
                force::in_words(pull, scene),
            );
        }
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
        // Of waves the phase changes with it as well, and not as a sine does.
        if self.waves {
            return None;
        }
        let (sin, cos) = angle.sin_cos();
        let (along, across) = (values[0] * cos + values[1] * sin, values[1] * cos - values[0] * sin);
        Some([&[along, across], &values[2..]].concat())
    }

    fn last_resort(&self) -> bool {
        self.waves
    }

    fn excitation(&self) -> &'static str {
        if self.waves {
            "driving over the same ground again, to and fro and at all headings"
        } else {
            "driving at all headings, as in a circle"
        }
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
        let [x, y] = self.pulls(p, at);
        let (along, across) = (x * cos + y * sin, y * cos - x * sin);
        let [.., turning, sideways] = p else { return };
        at.scene.frame.add_at_body([along, turning * across + sideways * along], load);
    }
}
