//! The command cannot change faster than a rate: |dU'/dt| ≤ a, on each axis, on one axis, or on each wheel.
//!
//! With `slowing`, |U'| falls at a rate of its own: drivers and motor controllers set acceleration and deceleration apart. Where the sign changes,
//! it falls to zero first and grows from there; whether the way to zero is slowing down differs from one controller to the next, so that there it
//! falls at another multiple of that rate.
//!
//! With `settling`, it comes to its goal gently: U'̇ = clip((U − U')/τ, ±a), a follower of first order whose rate is limited.
//!
//! With `easing`, it sets out and arrives gently: |U''̇| ≤ a/τ besides, the ramp in the shape of an S that motion profiles and velocity smoothers have.
//! It goes the quickest way to rest on its goal.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Scene, Stage, Start};

use super::parts::{Axis, Part, Parts, part_by_part};
use super::ramp::{Eased, leg, ramped, settled};
use super::words::{each, quantity};

/// A ramp in the command path, as drivers and motor controllers have it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SlewLimit {
    /// One axis only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// On each wheel, with one rate for both, in place of the axes.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub wheels: bool,
    /// With another rate for slowing down than for speeding up.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub slowing: bool,
    /// Coming to rest on its goal with a time constant.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub settling: bool,
    /// With a limit of jerk: its rate comes up, and down to rest on its goal, within a time.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub easing: bool,
}

/// Times in which commands settle or their rate comes up, at most and at first \[s\].
const LONGEST: f64 = 2.0;
const GENTLY: [f64; 2] = [0.1, 0.5];

/// Rates that are tried where slowing down has its own, in sizes of the command a second, and how many times as fast it is.
const SPEEDING: [f64; 5] = [0.25, 0.6, 1.5, 4.0, 10.0];
const SLOWING: [f64; 2] = [0.5, 2.0];
/// Share of a typical command below which nothing of one that settles is left to see.
const UNSEEN: f64 = 1e-3;
/// Multiples of the rate of slowing down at which a command may fall that reverses.
const REVERSING: (f64, f64) = (0.05, 20.0);

impl SlewLimit {
    fn parts(&self, scene: &Scene) -> Parts {
        if self.wheels { Parts::of(scene.frame, None, None) } else { Parts::axes(scene.frame, self.axis) }
    }

    /// Whether it has a time besides its rates.
    fn gentle(&self) -> bool {
        self.settling || self.easing
    }

    /// Numbers of state of each part: where the command is, where it was told to go, and how fast it changes.
    fn numbers(&self) -> usize {
        if self.easing { 3 } else { 2 }
    }
}

fn unit(part: &Part) -> String {
    format!("{}/s", part.unit).replace("/s/s", "/s2")
}

/// The rates of a part for speeding up, slowing down, and slowing down in order to reverse, by the number of its first parameter.
fn rates(p: &[f64], slowing: bool, i: usize) -> [f64; 3] {
    if !slowing {
        return [p[i]; 3];
    }
    let parts = p.len() / 3;
    [p[i], p[parts + i], p[parts + i] * p[2 * parts + i]]
}

#[typetag::serde(name = "slew_limit")]
impl Effect for SlewLimit {
    fn name(&self) -> &str {
        "slew_limit"
    }

    fn about(&self) -> String {
        let how = match (self.slowing, self.settling, self.easing) {
            (true, ..) => "the rates at which they grow and fall are limited apart",
            (_, true, _) => "their rate of change is limited, and they settle on their goal",
            (.., true) => "their rate of change is limited, and how fast it comes up and down",
            _ => "their rate of change is limited",
        };
        format!("commands are ramped: {how}")
    }

    fn stage(&self) -> Stage {
        Stage::Ramp
    }

    /// What holds on one axis says nothing about the other.
    fn family(&self) -> &str {
        match self.axis {
            Some(Axis::V) => "slew_limit/v",
            Some(Axis::Omega) => "slew_limit/omega",
            None => "slew_limit",
        }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if self.wheels && self.axis.is_some() {
            return Some("it is set to the wheels and to an axis: it acts on one of them".to_owned());
        }
        if [self.slowing, self.settling, self.easing].into_iter().filter(|set| *set).count() > 1 {
            return Some(
                "it is set to more than one of slowing down at a rate of its own, settling and easing: it does one of them".to_owned(),
            );
        }
        Parts::refuse(scene.frame, None, self.axis)
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // Slower than once to its typical size and back over the recording nothing would have been driven.
        let lowest = 2.0 / (scene.scales.time.1 - scene.scales.time.0);
        let of =
            |name: &str, p: &Part| p.parameter(name, &unit(p), (lowest * p.typical, f64::INFINITY), 0.3 * p.typical).neutral(f64::INFINITY);
        let parts = self.parts(scene).list(scene);
        let mut all: Vec<EffectParameter> = parts.iter().map(|p| of("rate", p)).collect();
        if self.gentle() {
            let name = if self.easing { "rising_time" } else { "settling_time" };
            all.push(EffectParameter::new(name, "s", (0.0, LONGEST), 0.1).neutral(0.0));
        }
        if self.slowing {
            all.extend(parts.iter().map(|p| of("slowing_rate", p)));
            all.extend(parts.iter().map(|p| p.parameter("reversing", "1", REVERSING, 0.2).usually(1.0, 1.0)));
        }
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let sizes: Vec<f64> = self.parts(scene).list(scene).iter().map(|p| p.typical).collect();
        let n = sizes.len();
        if self.gentle() {
            let at = |share: f64, time: f64| Start {
                values: sizes.iter().map(|size| share * size).chain([time]).collect(),
                columns: (0..n).map(|i| vec![i]).collect(),
                linear: false,
            };
            return SPEEDING.iter().flat_map(|share| GENTLY.map(|time| at(*share, time))).collect();
        }
        if self.slowing {
            let at = |share: f64, times: f64| Start {
                values: [share, share * times]
                    .iter()
                    .flat_map(|rate| sizes.iter().map(move |size| rate * size))
                    .chain(vec![1.0; n])
                    .collect(),
                columns: (0..n).map(|i| vec![i, n + i]).collect(),
                linear: false,
            };
            return SPEEDING.iter().flat_map(|share| SLOWING.map(|times| at(*share, times))).collect();
        }
        part_by_part(&sizes, &[0.15, 0.25, 0.4, 0.6, 1.0, 1.7, 2.8, 4.6, 8.0, 13.0, 22.0], &[0.2, 0.45, 1.0, 2.2, 5.0, 11.0, 25.0])
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let parts = self.parts(scene).list(scene);
        // Over within one sampling interval, it is none that these data show.
        let at_once = |p: &Part, v: Estimate| v.value * scene.scales.period > p.largest;
        let of = |values: &[Estimate], how: &str| {
            each(&parts, values, |p, v| match at_once(p, v) {
                true => format!("{} command {how} at once", p.whose),
                false => format!("{} command {how} by at most {}", p.whose, quantity(v, &unit(p))),
            })
        };
        let said = match values.chunks(parts.len()).collect::<Vec<_>>()[..] {
            [rates, time] if self.gentle() => {
                let gently = if self.easing { "comes up to that and down again within" } else { "settles with a time constant of" };
                format!("{}, and {gently} {}", of(rates, "changes"), quantity(time[0], "s"))
            }
            [up, down, reversing] => {
                let back = |v: &Estimate| format!("{} times as fast", quantity(*v, "1"));
                let back = reversing.iter().map(back).collect::<Vec<_>>().join(" and ");
                format!("{}, {}, and {back} where it reverses", of(up, "speeds up"), of(down, "slows down"))
            }
            _ => of(values, "changes"),
        };
        format!("{said}; the model had no ramp")
    }

    /// One whose rate is no limit is a lag: only a ramp that was found may settle, or ease.
    fn stands_in(&self) -> bool {
        self.gentle()
    }

    fn excitation(&self) -> &'static str {
        "large steps of the command, on each axis alone"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "torque_saturation",
                because: "a limited force bounds the acceleration too; it bounds it at the robot, however the command came, and less when coasting",
            },
            Confusion { with: "actuator_lag", because: "steps of one height only are ramped and filtered alike" },
            Confusion { with: "command_delay", because: "a short ramp delays each step by half its length" },
        ]
    }

    fn states(&self, scene: &Scene) -> usize {
        self.numbers() * Parts::count(scene)
    }

    fn begin(&self, _p: &[f64], at: &Instant<'_>, inputs: &[f64], _outputs: &[f64], state: &mut [f64]) {
        state.fill(0.0);
        let n = self.numbers();
        self.parts(at.scene).look(inputs, |(i, command)| state[n * i..n * i + 2].fill(command));
    }

    /// A ramp ends where it reaches its goal, and turns from slowing down to speeding up where it passes through zero; one that eases has three legs.
    fn next_switch(&self, p: &[f64], at: &Instant<'_>, state: &[f64]) -> f64 {
        let parts = self.parts(at.scene);
        let acted_on = state.chunks_exact(self.numbers()).enumerate().filter_map(|(i, s)| Some((parts.parameter_of(i)?, s)));
        let later = |t: &f64| *t > at.time + 1e-9 * at.scene.scales.period;
        if self.settling {
            let (time, scales) = (p[p.len() - 1], &at.scene.scales.inputs);
            let next = |(i, s): (usize, &[f64])| {
                let far = (s[1] - s[0]).abs();
                let ramp = far / p[i] - time;
                // Steps are short while it settles: of one time constant each, until nothing is left to see.
                let seen = time > 0.0 && far > UNSEEN * scales[i];
                let wait = match (ramp > 0.0, seen) {
                    (true, _) => ramp,
                    (false, true) => time,
                    (false, false) => f64::INFINITY,
                };
                at.time + wait
            };
            return acted_on.map(next).filter(later).fold(f64::INFINITY, f64::min);
        }
        if self.easing {
            let ends = |(i, s): (usize, &[f64])| Eased::new([s[0], s[2]], s[1], p[i], p[p.len() - 1]).ends().map(|end| at.time + end);
            return acted_on.flat_map(ends).filter(later).fold(f64::INFINITY, f64::min);
        }
        let ends = acted_on.flat_map(|(i, s)| {
            let rates = rates(p, self.slowing, i);
            let (turn, rate) = if self.slowing { leg(s[0], s[1], rates) } else { (s[1], rates[0]) };
            let time = |from: f64, to: f64, rate: f64| if from == to { 0.0 } else { (to - from).abs() / rate };
            let turned = at.time + time(s[0], turn, rate);
            [turned, turned + time(turn, s[1], rates[0])]
        });
        ends.filter(later).fold(f64::INFINITY, f64::min)
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        let n = self.numbers();
        self.parts(at.scene).change(u, |part, i, goal| {
            let own = &mut state[n * part..n * (part + 1)];
            let (from, time) = (own[0], p[p.len() - 1]);
            own[0] = if self.easing {
                let [there, pace] = Eased::new([from, own[2]], goal, p[i], time).after(at.span);
                own[2] = pace;
                there
            } else if self.settling {
                settled(from, goal, p[i], time, at.span)
            } else {
                ramped(from, goal, rates(p, self.slowing, i), at.span)
            };
            own[1] = goal;
            own[0]
        });
    }
}
