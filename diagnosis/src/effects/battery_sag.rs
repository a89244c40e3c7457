//! The drive weakens with time: U' = (1 − k (t − t0)) U, with t0 the recording's first time.
//!
//! A `settling` supply weakens quickly first and then slowly, as one does that has just been charged: U' = (1 − K (1 − e^{−(t − t0)/τ})) U.
//!
//! Of a `dropped` one a cell fails, or a second one is switched on: U' = (1 − D) U from some time on.
//!
//! A `loaded` one has a resistance of its own and gives way to what the motors draw as well: U' = s U. Their currents are in proportion
//! to what the voltage that is left drives them with against their back-EMF: (1 − r) (1 − k (t − t0) − s) = r Σ |s U_w − b_w|/2c over the wheels, U_w what
//! a wheel's motor is asked for, U_w − b_w what would drive it at full voltage, and c a typical command: r is lost where such a command meets wheels that
//! stand. (A chopping driver takes only its duty of a motor's current from the supply, which is all of it where it matters most.)
//!
//! A `recovering` one gives way as much in the end, but only a share of it at once; the rest follows the current with a time constant, in which the supply
//! recovers as well: the battery of Thevenin's circuit.
//!
//! With `servo` it is the gain of the speed loops that weakens, and not what they are told alone: the drive loses that share of u − β x, x what
//! the robot does and β their feedback, 1 or somewhat less.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::moments::{self, duration};
use super::supply::{self, Currents};
use super::trend;
use super::words::{digits, quantity, scaled};

/// How a supply weakens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SagLaw {
    /// In proportion to time.
    #[default]
    Steady,
    /// Quickly first, then slowly.
    Settling,
    /// At once, at some time.
    Dropped,
    /// In proportion to time, and to the current it is asked for.
    Loaded,
    /// The same, but not at once.
    Recovering,
}

/// A supply that runs down or gives way, or anything else that changes the gain of all commands alike.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatterySag {
    /// The loops weaken, not their commands. Default `false`.
    #[serde(default)]
    pub servo: bool,
    /// How. Default `steady`.
    #[serde(default)]
    pub law: SagLaw,
}

/// Share by which a supply is tried to give way, and the share of that which it does at once.
const GIVES_WAY: f64 = 0.1;
const AT_ONCE: f64 = 0.5;
/// Time in which it is tried to recover, and the shortest that is told \[s\].
const RECOVERS: f64 = 2.5;
const SHORTEST: f64 = 0.05;

impl BatterySag {
    /// What is lost at a time. On a recording that ends later than the one it was found on, a drive still does not turn round.
    fn lost(&self, p: &[f64], at: &Instant<'_>) -> f64 {
        let since = at.time - at.scene.scales.time.0;
        match self.law {
            SagLaw::Settling => p[0] * (1.0 - trend::left(p[1], at)),
            SagLaw::Dropped if moments::passed(p[1], at) => p[0],
            SagLaw::Dropped => 0.0,
            SagLaw::Steady => (p[0] * since).min(1.0),
            SagLaw::Loaded | SagLaw::Recovering => (p[1] * since).min(1.0),
        }
    }

    /// Whether it gives way to what the motors draw.
    fn yields(&self) -> bool {
        matches!(self.law, SagLaw::Loaded | SagLaw::Recovering)
    }

    /// Whether it acts on what drives, and not on commands.
    fn drives(&self) -> bool {
        self.servo || self.yields()
    }

    /// What the loops and motors are known by: the last parameters.
    fn known<'a>(&self, p: &'a [f64]) -> &'a [f64] {
        match self.law {
            SagLaw::Steady => &p[1..],
            SagLaw::Settling | SagLaw::Dropped | SagLaw::Loaded => &p[2..],
            SagLaw::Recovering => &p[4..],
        }
    }

    /// What a supply gives way by in the end for a unit of current, and which share of it at once.
    fn resistance(&self, p: &[f64], at: &Instant<'_>) -> (f64, f64) {
        let whole = 0.5 * p[0] / (1.0 - p[0]).max(f64::EPSILON) / at.scene.scales.command;
        (whole, if self.law == SagLaw::Recovering { p[2] } else { 1.0 })
    }

    /// The currents at this instant, and the share of the voltage that they leave.
    fn under_load(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &[f64]) -> (Currents, f64) {
        let currents = Currents::of(self.servo, self.known(p), &at.scene.frame, motion, drive);
        let (whole, at_once) = self.resistance(p, at);
        let recovering = state.first().copied().unwrap_or(0.0);
        (currents, currents.leave(1.0 - self.lost(p, at) - recovering, whole * at_once))
    }
}

#[typetag::serde(name = "battery_sag")]
impl Effect for BatterySag {
    fn name(&self) -> &str {
        "battery_sag"
    }

    fn about(&self) -> String {
        let how = match self.law {
            SagLaw::Steady => "steadily with time",
            SagLaw::Settling => "with time, quickly first",
            SagLaw::Dropped => "at once at some time",
            SagLaw::Loaded => "with time and under load",
            SagLaw::Recovering => "with time and under load, and recover slowly",
        };
        match self.servo {
            false => format!("all commands lose effect {how}"),
            true => format!("the speed loops weaken {how}"),
        }
    }

    fn stage(&self) -> Stage {
        if self.drives() { Stage::Drive } else { Stage::Gain }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        match (self.servo, self.yields()) {
            (true, _) => force::needs_loops(scene),
            (false, true) => force::needs_wheels(scene),
            (false, false) => None,
        }
    }

    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        // At the end nothing is left of the drive, or it is twice as strong: beyond that it is no sag. A supply that settles falls.
        let per_second = 1.0 / duration(scene);
        let sag = EffectParameter::new("sag", "1/s", (-per_second, per_second), 0.03 * per_second).neutral(0.0);
        let share = |name: &str| EffectParameter::new(name, "1", (0.0, 1.0), 0.03).neutral(0.0);
        let mut all = match self.law {
            SagLaw::Steady => vec![sag],
            SagLaw::Settling => vec![share("lost"), trend::parameter("settling_time", scene)],
            SagLaw::Dropped => {
                let lost = EffectParameter::new("lost", "1", (-1.0, 1.0), 0.03).neutral(0.0);
                vec![lost, moments::parameter(scene)]
            }
            SagLaw::Loaded => vec![share("lost_under_load"), sag],
            SagLaw::Recovering => {
                let at_once = EffectParameter::new("at_once", "1", (0.0, 1.0), 0.1).usually(AT_ONCE, AT_ONCE);
                let bounds = (SHORTEST, duration(scene).max(SHORTEST));
                vec![share("lost_under_load"), sag, at_once, EffectParameter::new("recovery_time", "s", bounds, 0.2 * RECOVERS)]
            }
        };
        match (self.yields(), self.servo) {
            (true, _) => all.extend(supply::known(self.servo, scene)),
            (false, true) => all.push(force::feedback()),
            (false, false) => {}
        }
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let steady = 0.03 / duration(scene);
        let (tried, columns): (Vec<Vec<f64>>, Vec<Vec<usize>>) = match self.law {
            SagLaw::Steady => (vec![vec![steady]], vec![vec![0]]),
            SagLaw::Settling => (trend::times(scene).map(|time| vec![0.03, time]).into(), vec![vec![0]]),
            SagLaw::Dropped => (moments::SHARES.map(|share| vec![0.03, moments::at(share, scene)]).into(), vec![vec![0]]),
            SagLaw::Loaded => (vec![vec![GIVES_WAY, steady]], vec![vec![0], vec![1]]),
            SagLaw::Recovering => (vec![vec![GIVES_WAY, steady, AT_ONCE, RECOVERS]], vec![vec![0], vec![1]]),
        };
        let all = self.parameters(scene);
        // What loops and motors are known by is as usual.
        let start = |values: Vec<f64>| {
            let usual = all[values.len()..].iter().filter_map(|p| p.usual.map(|(value, _)| value));
            Start { values: values.iter().copied().chain(usual).collect(), columns: columns.clone(), linear: true }
        };
        tried.into_iter().map(start).collect()
    }

    /// The same drop at other times nearby: while nothing drives it does not show.
    fn detours(&self, values: &[f64], scene: &Scene) -> Vec<Vec<f64>> {
        if self.law != SagLaw::Dropped {
            return Vec::new();
        }
        let (earliest, latest) = moments::parameter(scene).bounds;
        let at = |time: f64| [&[values[0], time], &values[2..]].concat();
        moments::nearby(scene).map(|off| values[1] + off).filter(|t| (earliest..=latest).contains(t)).map(at).collect()
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        let what = if self.servo { "the speed loops" } else { "commands" };
        let verb = |k: Estimate| if k.value < 0.0 { "gain" } else { "lose" };
        let percent = |k: Estimate, times: f64| quantity(scaled(k, |x| 100.0 * times * x * k.value.signum()), "%");
        let steady = |k: Estimate| {
            let (verb, a_minute) = (verb(k), percent(k, 60.0));
            let total = digits(100.0 * (k.value * duration(scene)).abs());
            format!("{verb} {a_minute} of their effect a minute, {total} % over the recording")
        };
        let lost = || quantity(scaled(values[0], |x| 100.0 * x), "%");
        let said = match self.law {
            SagLaw::Steady => format!("{what} {}", steady(values[0])),
            SagLaw::Settling => {
                let time = quantity(values[1], "s");
                format!("{what} lose {} of their effect, quickly first, most of it within {time}", lost())
            }
            SagLaw::Dropped => {
                let (verb, share, when) = (verb(values[0]), percent(values[0], 1.0), moments::when(values[1]));
                format!("{what} {verb} {share} of their effect at {when}, {} into the recording", moments::into(values[1], scene))
            }
            SagLaw::Loaded | SagLaw::Recovering => {
                let slowly = || format!(", {} of that at once and the rest within {}", percent(values[2], 1.0), quantity(values[3], "s"));
                let slowly = if self.law == SagLaw::Recovering { slowly() } else { String::new() };
                format!(
                    "the supply gives way under load: {what} lose {} of their effect where a typical command meets wheels that stand{slowly}, and {}",
                    lost(),
                    steady(values[1])
                )
            }
        };
        format!("{said}; the model's drive stayed the same")
    }

    fn excitation(&self) -> &'static str {
        "the same driving at the beginning and at the end of a long recording"
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "torque_saturation",
                because: "a supply that gives way under load bounds the force as a limit does, if softly",
            },
            Confusion {
                with: "payload_change",
                because: "if accelerations are few, a step in the middle and a steady change differ in the shape of their trend only",
            },
            Confusion {
                with: "viscous_asymmetry",
                because: "a recording that drives one way first and the other way later makes a change with time out of one with direction",
            },
        ]
    }

    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        if self.law == SagLaw::Dropped && p[0] != 0.0 && p[1] > at.time { p[1] } else { f64::INFINITY }
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], _state: &mut [f64], u: &mut [f64]) {
        let lost = if self.drives() { 0.0 } else { self.lost(p, at) };
        u.iter_mut().for_each(|u| *u -= lost * *u);
    }

    /// What a recovering supply has given way by besides what it does at once.
    fn states(&self, _scene: &Scene) -> usize {
        usize::from(self.law == SagLaw::Recovering)
    }

    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, drive: &[f64], state: &mut [f64]) {
        if self.law != SagLaw::Recovering {
            return;
        }
        let (currents, left) = self.under_load(p, at, motion, state, drive);
        let (whole, at_once) = self.resistance(p, at);
        let settles = whole * (1.0 - at_once) * currents.drawn(left);
        state[0] = settles + (state[0] - settles) * (-at.span / p[3]).exp();
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        if !self.drives() {
            return;
        }
        let lost = if self.yields() { 1.0 - self.under_load(p, at, motion, state, drive).1 } else { self.lost(p, at) };
        let held = if self.servo { self.known(p)[0] } else { 0.0 };
        drive.iter_mut().zip(motion.u.iter().zip(motion.outputs)).for_each(|(drive, (u, x))| *drive -= lost * (u - held * x));
    }
}
