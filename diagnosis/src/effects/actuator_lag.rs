//! The drive follows its command with dynamics of its own: τ u̇' = u − u', or τ² ü' + 2 ζ τ u̇' = u − u', on every input.
//!
//! With `servo` it is what the speed loops push with that lags, and not what they are told: of e = u − β x, β their feedback, 1 or somewhat less,
//! z acts, τ ż = e − z. A current that builds up in its winding does so. The loop is of second order then, and overshoots where τ is more than half
//! of the model's own time constant.

use serde::{Deserialize, Serialize};
use wheelwright_core::Effect;
use wheelwright_core::effect::{Confusion, EffectParameter, Estimate, Instant, Motion, Scene, Stage, Start};

use super::force;
use super::late;
use super::words::{digits, quantity};

/// A lag between the command and the model, which makes the whole of second order, or, with a resonance, of third.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ActuatorLag {
    /// Whether each axis (or wheel, or channel) has a time constant of its own.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub each_axis: bool,
    /// Whether the drive is of second order and may resonate: an elastic transmission, a loop that overshoots.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub resonant: bool,
    /// In the loops' answer, not in their command.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub servo: bool,
}

/// Numbers of state of each axis of a loop that lags: what pushes now, what did when the step began, and what was asked for in its middle.
const EACH: usize = 3;

/// Longest time constant considered \[s\]: beyond it the model's own one would be the lesser part.
const LONGEST: f64 = 1.0;
/// Damping considered: from a vibration that rings for a while to none (two equal lags).
const DAMPING: (f64, f64) = (0.05, 1.0);

/// Share of a sampling interval below which a lag is none: no step of a simulation is as short, and what is filtered would come a step late.
const NONE: f64 = 1e-3;

impl ActuatorLag {
    /// Time constant below which there is none \[s\]. The fastest resonance that samples can tell is at half their rate.
    fn least(&self, scene: &Scene) -> f64 {
        scene.scales.period * if self.resonant { std::f64::consts::FRAC_1_PI } else { NONE }
    }
}

#[typetag::serde(name = "actuator_lag")]
impl Effect for ActuatorLag {
    fn name(&self) -> &str {
        "actuator_lag"
    }

    fn about(&self) -> String {
        let what = if self.servo {
            "the loops' push lags behind what they ask for"
        } else {
            "the drive follows its command with a second time constant"
        };
        what.to_owned()
    }

    fn stage(&self) -> Stage {
        if self.servo { Stage::Drive } else { Stage::Filter }
    }

    fn inapplicable(&self, scene: &Scene) -> Option<String> {
        if !self.servo {
            return None;
        }
        let other = self.each_axis || self.resonant;
        other
            .then(|| "it is set to a lag in the loops and to one before them: it is one of them".to_owned())
            .or_else(|| force::needs_loops(scene))
    }

    fn family(&self) -> &str {
        late::FAMILY
    }

    /// Time constants, and the damping or the feedback.
    fn parameters(&self, scene: &Scene) -> Vec<EffectParameter> {
        let mut all = late::parameters("time_constant", LONGEST, self.each_axis, scene);
        if self.resonant {
            all.push(EffectParameter::new("damping", "1", DAMPING, 0.2));
        }
        all.extend(self.servo.then(force::feedback));
        all
    }

    fn starts(&self, scene: &Scene) -> Vec<Start> {
        let lags = late::starts(self.each_axis, scene);
        let seconds: &[f64] = match (self.resonant, self.servo) {
            (true, _) => &[0.2, 0.5, 0.8],
            (_, true) => &[1.0],
            _ => return lags,
        };
        let with = |start: &Start, second: f64| Start { values: [&start.values[..], &[second]].concat(), ..start.clone() };
        lags.iter().flat_map(|start| seconds.iter().map(|second| with(start, *second))).collect()
    }

    fn in_series(&self) -> bool {
        self.each_axis && !self.resonant
    }

    fn statement(&self, values: &[Estimate], scene: &Scene) -> String {
        if self.servo {
            let time = quantity(values[0], "s");
            return format!(
                "what the speed loops push with follows what they ask for with a time constant of {time}; the model's did at once"
            );
        }
        let said = late::each(self.each_axis, values, scene, |whose, v| {
            let hertz = digits(1.0 / (std::f64::consts::TAU * v.value));
            let resonance = if self.resonant { format!(" ({hertz} Hz)") } else { String::new() };
            format!("the drive follows {whose} with a further time constant of {}{resonance}", quantity(v, "s"))
        });
        match (self.resonant, values.last()) {
            (true, Some(damping)) => {
                format!("{said} and rings with a damping of {}; the model had one lag only", quantity(*damping, "1"))
            }
            _ => format!("{said}; the model had one lag only"),
        }
    }

    /// Lags in series never overshoot, and a loop of second order that is tuned well has no peak in its response: below a damping of 1/√2 it
    /// has one.
    fn beyond(&self, values: &[Estimate]) -> Option<String> {
        let damping = values.last().filter(|_| self.resonant)?;
        let most = damping.ci95.map_or(damping.value, |(_, upper)| upper);
        let hertz = digits(1.0 / (std::f64::consts::TAU * values[0].value));
        (most < std::f64::consts::FRAC_1_SQRT_2)
            .then(|| format!("the drive resonates at {hertz} Hz: something in it is elastic, which no lag is"))
    }

    fn excitation(&self) -> &'static str {
        late::EXCITATION
    }

    fn confusions(&self) -> &'static [Confusion] {
        &[
            Confusion {
                with: "command_delay",
                because: "under slow commands a delay and a lag of the same length are the same; only the sum with the model's own lag shows",
            },
            Confusion { with: "sensor_delay", because: "under slow motion a late measurement and a lag of the same length are the same" },
            Confusion { with: "theta1", because: "under slow commands the lag is a longer time constant of the model" },
            Confusion { with: "slew_limit", because: "steps of one height only are filtered and ramped alike" },
            Confusion { with: "wheel_slip", because: "a wheel that creeps in proportion to its force lags a little" },
            Confusion { with: "backlash", because: "crossing a gap takes time at every reversal of the force" },
        ]
    }

    /// The filtered command, the command that last arrived and, with a resonance, the filtered command's slope, of each input. Of a loop what each
    /// axis is pushed with, and whether a step is in its middle.
    fn states(&self, scene: &Scene) -> usize {
        if self.servo { EACH * scene.outputs.len() + 1 } else { 3 * scene.inputs.len() }
    }

    fn begin(&self, p: &[f64], _at: &Instant<'_>, inputs: &[f64], outputs: &[f64], state: &mut [f64]) {
        if self.servo {
            state.fill(0.0);
            state.chunks_exact_mut(EACH).zip(inputs.iter().zip(outputs)).for_each(|(own, (u, x))| own[0] = u - p[1] * x);
            return;
        }
        state.chunks_exact_mut(3).zip(inputs).for_each(|(state, u)| state.copy_from_slice(&[*u, *u, 0.0]));
    }

    /// Steps are short while the filter runs after a new command: of one lag, then two, then four; several lags share their steps.
    fn next_switch(&self, p: &[f64], at: &Instant<'_>, _state: &[f64]) -> f64 {
        if self.servo {
            return f64::INFINITY;
        }
        let start = at.stretch.time[at.row];
        let elapsed = at.time - start;
        let next = |lag: &f64| {
            if *lag < self.least(at.scene) {
                f64::INFINITY
            } else if self.resonant {
                let counts = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
                counts.iter().map(|count| count * lag).find(|t| *t > elapsed + 1e-3 * lag).unwrap_or(f64::INFINITY)
            } else if elapsed < 6.999 * lag {
                2.0 * elapsed + lag
            } else {
                f64::INFINITY
            }
        };
        let lags = &p[..p.len() - usize::from(self.resonant)];
        start + lags.iter().map(next).fold(f64::INFINITY, f64::min)
    }

    fn command(&self, p: &[f64], at: &Instant<'_>, _outputs: &[f64], state: &mut [f64], u: &mut [f64]) {
        if self.servo {
            return;
        }
        let (lags, damping) = match p {
            [lags @ .., damping] if self.resonant => (lags, Some(*damping)),
            _ => (p, None),
        };
        let one = lags.len() == 1;
        for (i, (state, u)) in state.chunks_exact_mut(3).zip(u).enumerate() {
            let lag = lags[if one { 0 } else { i }];
            if lag < self.least(at.scene) {
                state.copy_from_slice(&[*u, *u, 0.0]);
            } else {
                follow(lag, damping, at.span, state, *u);
            }
            *u = state[0];
        }
    }

    fn drive(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, state: &[f64], drive: &mut [f64]) {
        if self.servo && p[0] >= self.least(at.scene) {
            let axes = motion.u.iter().zip(motion.outputs).zip(state.chunks_exact(EACH));
            drive.iter_mut().zip(axes).for_each(|(drive, ((u, x), own))| *drive += own[0] - (u - p[1] * x));
        }
    }

    /// The whole step by what is asked for in its middle: of second order, as the motion is.
    fn advance(&self, p: &[f64], at: &Instant<'_>, motion: &Motion<'_>, _drive: &[f64], state: &mut [f64]) {
        if !self.servo || p[0] < self.least(at.scene) {
            return;
        }
        let Some((middle, axes)) = state.split_last_mut() else { return };
        let first = *middle == 0.0;
        let spans = if first { 1.0 } else { 2.0 };
        let kept = (-spans * at.span / p[0]).exp();
        for (own, (u, x)) in axes.chunks_exact_mut(EACH).zip(motion.u.iter().zip(motion.outputs)) {
            if first {
                (own[1], own[2]) = (own[0], u - p[1] * x);
            }
            own[0] = own[2] + (own[1] - own[2]) * kept;
        }
        *middle = if first { 1.0 } else { 0.0 };
    }
}

/// Lets a filter run for a span in which the command goes straight from the one that last arrived to `u`.
fn follow(lag: f64, damping: Option<f64>, span: f64, state: &mut [f64], u: f64) {
    let [filtered, arrived, slope] = state else { return };
    if span > 0.0 {
        // Behind a command that runs straight a filter runs behind in parallel; what differs from that decays.
        let run = (u - *arrived) / span;
        let behind = lag * run * damping.map_or(1.0, |d| 2.0 * d);
        let off = *filtered - (*arrived - behind);
        (*filtered, *slope) = match damping {
            None => (u - behind + off * (-span / lag).exp(), 0.0),
            Some(damping) => {
                let (off, slope) = ring(off, *slope - run, damping, span / lag, lag);
                (u - behind + off, slope + run)
            }
        };
    }
    *arrived = u;
}

/// A free vibration after `angle` radians of its undamped angle.
fn ring(off: f64, slope: f64, damping: f64, angle: f64, lag: f64) -> (f64, f64) {
    let rest = (1.0 - damping * damping).max(0.0).sqrt();
    let (decay, cos) = ((-damping * angle).exp(), (rest * angle).cos());
    let sin = if rest > 0.0 { (rest * angle).sin() / rest } else { angle };
    (decay * (off * (cos + damping * sin) + slope * lag * sin), decay * (slope * (cos - damping * sin) - off / lag * sin))
}
