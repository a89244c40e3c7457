//! How much later a robot answers its commands than its model explains.
//!
//! Every input is delayed by an unknown pure time, its hold shifted exactly and not by whole samples, and the delays are fitted
//! together with the parameters and the starts of the stretches to the free-run error, from the best point of a grid. The interval
//! counts the residual's colour: neighbouring errors of a real robot are alike, and a recording holds fewer independent ones than
//! samples. A delay and a time constant act alike under slow commands; then only their sum is known, and that is said.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::dataset::Dataset;
use crate::local::{self, FreeRun, Local, Point};
use crate::model::{ParameterMap, RegressorModel};
use crate::noise::Autoregression;
use crate::signal;
use crate::solver::SolveError;

/// Half the width of a 95 % interval in standard errors.
const HALF_WIDTH: f64 = 1.96;
/// Delays tried first, in sampling periods. One of less than zero is a command stamped late.
const GRID: [f64; 13] = [-1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0, 19.0, 28.0];
/// A command answered more periods than this before it was given is none: something else looks like it.
const EARLIEST: f64 = 2.0;
/// Delays below this share of a period are not worth counting, however narrow their interval: stamps mean no more.
const NEGLIGIBLE: f64 = 0.05;
/// Delays beyond this share of a typical stretch leave too little of it.
const LONGEST: f64 = 0.25;
/// Correlation beyond which two things count as hardly told apart.
const CONFOUNDED: f64 = 0.95;

/// The lag of one axis: an input, or all of them where inputs and outputs do not pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisLag {
    /// Names of the inputs delayed.
    pub inputs: Vec<String>,
    /// Name of the output that answers them; `None` for a lag common to all.
    pub output: Option<String>,
    /// Delay beyond what the model explains \[s\]; zero where the best one is early, which no delay is.
    pub delay_s: f64,
    /// How much earlier than its commands the output seems to answer \[s\], where the interval lies below zero: the trace of something
    /// else, such as a drive that limits how fast its command may change.
    pub early_s: Option<f64>,
    /// Its standard error under noise of the residual's colour \[s\].
    pub std_s: f64,
    /// Its 95 % interval \[s\].
    pub ci95_s: (f64, f64),
    /// True if the interval lies above zero, and the delay above a twentieth of a period and within what was searched.
    pub late: bool,
    /// True if the best delay lies at the limit of what was searched: two periods early, or a quarter of a typical stretch late.
    /// Then it is no delay but something else that the model leaves out.
    pub at_limit: bool,
    /// Time constant of the answer, fitted with the delay \[s\].
    pub time_constant_s: f64,
    /// Delay and time constant together \[s\], with the standard error.
    pub sum_s: (f64, f64),
    /// Correlation of the two estimates: near −1 the drive cannot tell them apart.
    pub correlation: f64,
    /// The parameter whose estimate is most alike to the delay's, and their correlation.
    pub alike: Option<(String, f64)>,
    /// Samples that the residual is worth, fewer the more alike neighbouring ones are.
    pub independent_samples: f64,
    /// The result in a sentence.
    pub statement: String,
}

/// Lags of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lag {
    /// One entry an axis.
    pub axes: Vec<AxisLag>,
    /// Free-run error of each output without delays, root mean square.
    pub error_without: Vec<f64>,
    /// The same with them.
    pub error_with: Vec<f64>,
}

/// Estimates the lag between commands and response: input i with output i where there are as many of both, else one in common.
///
/// # Errors
/// [`SolveError`] if there are too few samples, or no parameters near a quick estimate with which the model can be simulated.
pub fn estimate(model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<Lag, SolveError> {
    let (inputs, outputs) = (model.inputs().len(), model.outputs().len());
    let paired = inputs == outputs;
    // The delay of an input that never changes has no effect, not even one of rounding.
    let changes = |i: &usize| data.stretches.iter().any(|s| s.inputs[*i].iter().any(|u| *u != s.inputs[*i][0]));
    let axes: Vec<Option<usize>> = (0..inputs).map(|i| changes(&i).then_some(if paired { i } else { 0 })).collect();
    let count = if paired { inputs } else { usize::from(inputs > 0) };
    let (mut run, plain, error_without) = local::quick_fit(model, map, data, axes)?;
    let plainly = run.linearise(&plain, &error_without)?;
    run.limit_delays(-EARLIEST * data.period(), longest(data));
    let base = Point { delays: vec![0.0; count], ..plain };
    let best = from_grid(&run, &base, &plainly, &error_without)?;
    let far = best.delays.iter().any(|d| d.abs() > data.period());
    let (mut point, mut error_with) = run.fit(best)?;
    // A start on the grid may lie across a ridge from a small delay.
    if far {
        let (other, error) = run.fit(base)?;
        if likelihood(&error) < likelihood(&error_with) {
            (point, error_with) = (other, error);
        }
    }
    let local = run.linearise(&point, &error_with)?;
    let ar = local.autoregressions(outputs);
    let covariance = local.covariance(&ar);
    let found = Found { run: &run, point: &point, covariance: &covariance, ar: &ar };
    let axes = (0..count).map(|axis| found.axis(axis, paired)).collect();
    Ok(Lag { axes, error_without, error_with })
}

/// Twice the negative logarithm of the likelihood a sample, up to a constant.
fn likelihood(error: &[f64]) -> f64 {
    error.iter().map(|e| 2.0 * e.ln()).sum()
}

/// Longest delay searched \[s\].
fn longest(data: &Dataset) -> f64 {
    LONGEST * data.period() * local::typical_rows(data) as f64
}

/// The best delay of each axis on the grid. The change that a delay makes is simulated once; parameters and starts answer it to
/// first order.
fn from_grid(run: &FreeRun<'_>, base: &Point, local: &Local, sigma: &[f64]) -> Result<Point, SolveError> {
    let unknowns = base.z.len();
    let longest = longest(run.data);
    let mut best = base.clone();
    let still = run.simulate(base)?;
    for axis in 0..base.delays.len() {
        let mut least = explained(local, unknowns, None).0;
        for periods in GRID {
            let mut trial = base.clone();
            trial.delays[axis] = periods * run.data.period();
            if trial.delays[axis] > longest {
                break;
            }
            let Ok(moved) = run.simulate(&trial) else { continue };
            let change = |i: usize| -> Vec<f64> {
                let outputs = moved[i].iter().zip(&still[i]).zip(sigma);
                outputs.flat_map(|((m, s), sigma)| m.iter().zip(s).map(move |(m, s)| (m - s) / sigma)).collect()
            };
            let changes: Vec<Vec<f64>> = (0..moved.len()).map(change).collect();
            let (cost, step) = explained(local, unknowns, Some(&changes));
            if cost < least {
                least = cost;
                best.delays[axis] = trial.delays[axis];
                for ((z, from), d) in best.z.iter_mut().zip(&base.z).zip(step.iter()) {
                    *z = from + d;
                }
            }
        }
    }
    // The first-order answer of the parameters may leave what can be simulated.
    if !run.cost(&best, sigma).is_finite() {
        best.z.clone_from(&base.z);
    }
    Ok(best)
}

/// Squared error left once `unknowns` parameters answer a change to first order, and their answer.
fn explained(local: &Local, unknowns: usize, changes: Option<&[Vec<f64>]>) -> (f64, DVector<f64>) {
    let (mut squares, mut gram, mut right) = (0.0, DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
    for (i, block) in local.blocks.iter().enumerate() {
        let mut error = block.error.clone();
        if let Some(changes) = changes {
            error.iter_mut().zip(&changes[i]).for_each(|(e, c)| *e -= c);
        }
        let (columns, error) = block.projected_with(&error);
        let columns = columns.columns(0, unknowns);
        squares += error.norm_squared();
        gram += columns.tr_mul(&columns);
        right += columns.tr_mul(&error);
    }
    let step = local::scaled_solve(&gram, &right);
    (squares - right.dot(&step), step)
}

/// The fitted point with what is needed to judge it.
struct Found<'f, 'a> {
    run: &'f FreeRun<'a>,
    point: &'f Point,
    covariance: &'f DMatrix<f64>,
    ar: &'f [Autoregression],
}

impl Found<'_, '_> {
    fn axis(&self, axis: usize, paired: bool) -> AxisLag {
        let data = self.run.data;
        let free = self.point.z.len();
        let at = free + axis;
        let delay_s = self.point.delays[axis];
        let std_s = self.covariance[(at, at)].max(0.0).sqrt();
        let ci95_s = (delay_s - HALF_WIDTH * std_s, delay_s + HALF_WIDTH * std_s);
        // Lags in common are held against the slowest output.
        let outputs: Vec<usize> = if paired { vec![axis] } else { (0..data.outputs.len()).collect() };
        let constants = self.time_constants(&self.point.z);
        let output = outputs.iter().copied().max_by(|a, b| constants[*a].total_cmp(&constants[*b])).unwrap_or(0);
        let slope = self.slope(output);
        let lag = |v: &DVector<f64>| (v.transpose() * self.covariance * v)[(0, 0)].max(0.0).sqrt();
        let mut unit = DVector::zeros(self.covariance.nrows());
        unit[at] = 1.0;
        let correlation = (slope.transpose() * self.covariance * &unit)[(0, 0)] / (lag(&slope) * std_s);
        let samples = data.samples();
        let with = |j: usize| self.covariance[(at, j)] / (self.covariance[(j, j)].sqrt() * std_s);
        let told = (0..free).filter(|j| with(*j).is_finite()).max_by(|a, b| with(*a).abs().total_cmp(&with(*b).abs()));
        let margin = 1e-3 * data.period();
        let at_limit = delay_s < margin - EARLIEST * data.period() || delay_s > longest(data) - margin;
        let mut found = AxisLag {
            inputs: (0..data.inputs.len()).filter(|i| !paired || *i == axis).map(|i| data.inputs[i].name.to_string()).collect(),
            output: paired.then(|| data.outputs[axis].name.to_string()),
            delay_s,
            early_s: None,
            std_s,
            ci95_s,
            late: !at_limit && std_s > 0.0 && ci95_s.0 > 0.0 && delay_s > NEGLIGIBLE * data.period(),
            at_limit,
            alike: told.map(|j| (self.run.map.free[j].clone(), with(j))),
            time_constant_s: constants[output],
            sum_s: (delay_s + constants[output], lag(&(slope + unit))),
            correlation: if correlation.is_finite() { correlation } else { 0.0 },
            independent_samples: outputs.iter().map(|i| self.ar[*i].effective_samples(samples)).fold(f64::INFINITY, f64::min),
            statement: String::new(),
        };
        found.statement = statement(&found, data);
        if delay_s < 0.0 {
            found.early_s = (ci95_s.1 < 0.0 && delay_s < -NEGLIGIBLE * data.period()).then_some(-delay_s);
            found.delay_s = 0.0;
        }
        found
    }

    fn time_constants(&self, z: &[f64]) -> Vec<f64> {
        local::time_constants(self.run.model, &self.run.map.theta(z), self.run.data)
    }

    /// Derivative of an output's time constant with respect to the unknowns.
    fn slope(&self, output: usize) -> DVector<f64> {
        let mut slope = DVector::zeros(self.covariance.nrows());
        for j in 0..self.point.z.len() {
            let step = 1e-6 * self.point.z[j].abs().max(1e-6);
            let side = |sign: f64| {
                let mut z = self.point.z.clone();
                z[j] += sign * step;
                self.time_constants(&z)[output]
            };
            slope[j] = (side(1.0) - side(-1.0)) / (2.0 * step);
        }
        slope
    }
}

/// What an early answer is mostly the trace of: the fitted time constant then stands for a ramp that begins at once.
const EARLY: &str = ", such as a drive that limits how fast its command may change (a slew limit) or saturates";

fn statement(lag: &AxisLag, data: &Dataset) -> String {
    let (what, commands) = (lag.output.as_deref().unwrap_or("the response"), lag.inputs.join(", "));
    let (low, high) = lag.ci95_s;
    if lag.std_s == 0.0 || !lag.std_s.is_finite() {
        return format!("{commands} never changes, or {what} does not answer it: a delay cannot be seen");
    }
    if lag.at_limit {
        return format!(
            "no delay of {commands} explains {what}: the free run would rather have it {} than can be, because the model leaves out something else{}",
            if lag.delay_s < 0.0 { "earlier" } else { "later" },
            if lag.delay_s < 0.0 { EARLY } else { "" }
        );
    }
    let interval = format!("95 % interval {low:.3} to {high:.3} s");
    let period = data.stretches.first().and_then(|s| signal::spacing(&s.time)).map_or(data.period(), |s| s.period);
    let mut text = if lag.late {
        format!(
            "{what} answers {commands} {:.3} s late ({interval}), beyond the time constant of {:.3} s",
            lag.delay_s, lag.time_constant_s
        )
    } else if lag.delay_s.abs() < NEGLIGIBLE * period {
        format!("{what} answers {commands} without a delay worth counting ({:.3} s, {interval})", lag.delay_s)
    } else if high < 0.0 {
        format!(
            "no delay is seen between {commands} and {what}: the free run is best with commands {:.3} s early, which no robot does, because the \
             commands are stamped late, or the model leaves out something else{EARLY}",
            -lag.delay_s
        )
    } else {
        format!("{what} answers {commands} without a delay that could be told from zero ({:.3} s, {interval})", lag.delay_s)
    };
    if lag.late && low < 0.5 * period && 0.5 * period < high {
        text.push_str("; half a sampling period is what a driver adds that differences encoder counts");
    }
    if lag.correlation < -CONFOUNDED {
        let (sum, std) = lag.sum_s;
        // Slower than this, a delay and a lag of the same time turn the phase alike.
        let needed = 1.0 / (std::f64::consts::TAU * sum.max(period));
        text.push_str(&format!(
            "; this drive hardly tells delay from time constant (correlation {:.3}), only their sum is known, {sum:.3} ± {:.3} s: steps, or commands faster than {needed:.2} Hz, would tell them apart",
            lag.correlation,
            HALF_WIDTH * std
        ));
    } else if let Some((name, r)) = lag.alike.as_ref().filter(|(_, r)| r.abs() > CONFOUNDED) {
        text.push_str(&format!("; this drive hardly tells it from {name} (correlation {r:.3})"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Stretch;
    use crate::identifiability::tests::{THETA, TwoAxes, driven, thesis};
    use crate::noise::tests::Normal;

    /// Runs the robot on a millisecond grid with commands held for a period and delayed by whole milliseconds, then samples it.
    fn late(commands: &dyn Fn(f64) -> [f64; 2], seconds: usize, delays_ms: [usize; 2], noise: f64, rho: f64, seed: u64) -> Dataset {
        let period_ms = 50;
        let fine = |k: usize, i: usize| commands((k.saturating_sub(delays_ms[i]) / period_ms * period_ms) as f64 * 1e-3)[i];
        let n = seconds * 1000;
        let time: Vec<f64> = (0..n).map(|k| k as f64 * 1e-3).collect();
        let inputs = (0..2).map(|i| (0..n).map(|k| fine(k, i)).collect()).collect();
        let stretch = Stretch { label: String::new(), time, inputs, outputs: vec![vec![0.0; n]; 2] };
        let model = TwoAxes::new();
        let mut simulated = vec![Vec::new(); 2];
        crate::simulation::Simulator::new(&model, &THETA).unwrap().run(&stretch, &[0.0, 0.0], &mut simulated).unwrap();
        let mut normal = Normal::new(seed);
        let rows: Vec<usize> = (0..n).step_by(period_ms).collect();
        let outputs = simulated.iter().map(|x| {
            let e = normal.coloured(rows.len(), noise, rho);
            rows.iter().zip(e).map(|(k, e)| x[*k] + e).collect()
        });
        let outputs = outputs.collect();
        let time: Vec<f64> = rows.iter().map(|k| *k as f64 * 1e-3).collect();
        let inputs = (0..2).map(|i| time.iter().map(|t| commands(*t)[i]).collect()).collect();
        let stretches = vec![Stretch { label: String::new(), time, inputs, outputs }];
        Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches }
    }

    /// Steps of both commands, not at once.
    fn steps(t: f64) -> [f64; 2] {
        let level = |k: i64| [0.5, -0.3, 0.2, 0.7, -0.5, 0.0][k.rem_euclid(6) as usize];
        [level((t / 1.7) as i64), 1.5 * level((t / 1.3) as i64 + 2)]
    }

    fn found(data: &Dataset) -> Lag {
        let model = TwoAxes::new();
        estimate(&model, &model.map(), data).unwrap()
    }

    #[test]
    fn delays_of_a_fraction_of_a_period_are_found_without_noise() {
        for delays_ms in [[0, 0], [13, 137], [220, 75]] {
            let lag = found(&late(&steps, 40, delays_ms, 0.0, 0.0, 0));
            for (axis, ms) in lag.axes.iter().zip(delays_ms) {
                assert!((axis.delay_s - ms as f64 * 1e-3).abs() < 2e-5, "{axis:?}");
            }
        }
    }

    #[test]
    fn intervals_cover_under_white_and_coloured_noise() {
        for (rho, seeds) in [(0.0, 24), (0.8, 24)] {
            let (mut covered, mut bias) = (0, 0.0);
            for seed in 0..seeds {
                let lag = found(&late(&steps, 20, [0, 60], 0.02, rho, seed));
                for (axis, truth) in lag.axes.iter().zip([0.0, 0.06]) {
                    covered += usize::from(axis.ci95_s.0 <= truth && truth <= axis.ci95_s.1);
                    bias += (axis.delay_s - truth) / axis.std_s / (2.0 * seeds as f64);
                }
            }
            // 95 % of 48 is 45.6 with a standard deviation of 1.5: three of those below.
            assert!(covered >= 41, "rho {rho}: {covered} of 48");
            assert!(bias.abs() < 0.5, "rho {rho}: bias of {bias} standard errors");
        }
    }

    #[test]
    fn a_late_answer_is_said_so_and_a_prompt_one_is_not() {
        let lag = found(&late(&steps, 40, [0, 150], 0.01, 0.5, 3));
        assert!(!lag.axes[0].late && lag.axes[1].late, "{lag:?}");
        assert!(lag.axes[0].statement.contains("without a delay"), "{}", lag.axes[0].statement);
        assert!(lag.axes[1].statement.starts_with("omega answers omega_ref 0.1"), "{}", lag.axes[1].statement);
        assert!(lag.error_with[1] < 0.8 * lag.error_without[1], "{lag:?}");
    }

    #[test]
    fn a_short_straggler_changes_nothing() {
        let mut data = late(&steps, 40, [0, 150], 0.01, 0.5, 3);
        let alone = found(&data);
        let straggler = data.stretches[0].slice(300..303);
        data.stretches.push(straggler);
        let lag = found(&data);
        for (with, without) in lag.axes.iter().zip(&alone.axes) {
            assert!((with.delay_s - without.delay_s).abs() < 0.2 * without.std_s, "{with:?} {without:?}");
            assert!((with.std_s / without.std_s - 1.0).abs() < 0.1, "{with:?} {without:?}");
        }
    }

    #[test]
    fn slow_commands_leave_only_the_sum() {
        let slow = |t: f64| [0.4 + 0.3 * (0.3 * t).sin(), 0.5 * (0.4 * t).sin()];
        let mut data = late(&slow, 120, [100, 100], 0.005, 0.0, 4);
        // The start from rest is a step.
        data.stretches[0] = data.stretches[0].slice(100..2400);
        let lag = found(&data);
        for (axis, constant) in lag.axes.iter().zip([0.2604 / 0.9965, 0.2509 / 1.0768]) {
            assert!(axis.correlation < -CONFOUNDED, "{axis:?}");
            assert!((axis.sum_s.0 - constant - 0.1).abs() < 4.0 * axis.sum_s.1, "{axis:?}");
            assert!(axis.sum_s.1 < 0.2 * axis.std_s, "{axis:?}");
            assert!(axis.statement.contains("only their sum is known"), "{}", axis.statement);
        }
    }

    #[test]
    fn the_drive_of_the_thesis_has_no_delay() {
        let lag = found(&driven(thesis, 150.0, 20.0, 0.005, 5));
        assert!(lag.axes.iter().all(|a| a.delay_s.abs() < 4.0 * a.std_s && a.std_s < 0.01), "{lag:?}");
    }

    #[test]
    fn an_answer_before_its_command_is_no_delay() {
        // The command is recorded a quarter of a second after it was given.
        let mut data = late(&steps, 40, [250, 250], 0.005, 0.0, 7);
        for stretch in &mut data.stretches {
            let rows = stretch.len() - 10;
            stretch.outputs.iter_mut().for_each(|y| drop(y.drain(..10)));
            stretch.inputs.iter_mut().for_each(|u| u.truncate(rows));
            stretch.time.truncate(rows);
        }
        let lag = found(&data);
        assert!(lag.axes.iter().all(|a| a.at_limit && !a.late), "{lag:?}");
        assert!(lag.axes[0].statement.contains("rather have it earlier"), "{}", lag.axes[0].statement);
    }

    #[test]
    fn a_command_that_never_changes_hides_its_delay() {
        let lag = found(&driven(|t| [thesis(t)[0], 0.0], 30.0, 20.0, 0.005, 6));
        assert!(lag.axes[1].statement.contains("cannot be seen"), "{}", lag.axes[1].statement);
        assert!(!lag.axes[1].late);
    }

    #[test]
    fn a_slew_limit_is_no_delay_before_its_time() {
        // A square wave of ±0.4 m/s that the drive follows at 0.8 m/s² only.
        let square = |t: f64| -> f64 { if t % 8.0 < 4.0 { 0.4 } else { -0.4 } };
        let turning = |t: f64| if t % 5.0 < 2.5 { 0.8 } else { -0.5 };
        let limited = move |t: f64| {
            let ramp: f64 = (0.8 * (t % 4.0)).min(0.8) - 0.4;
            [if t < 4.0 { 0.4 } else { ramp * square(t).signum() }, turning(t)]
        };
        let mut data = late(&limited, 60, [0, 0], 0.005, 0.0, 1);
        data.stretches[0].inputs[0] = data.stretches[0].time.iter().map(|t| square(*t)).collect();
        let model = TwoAxes::new();
        let found = estimate(&model, &model.map(), &data).unwrap();
        for axis in &found.axes {
            assert!(axis.delay_s >= 0.0, "{axis:?}");
        }
        let v = &found.axes[0];
        if v.early_s.is_some() || (v.at_limit && v.delay_s == 0.0) {
            assert!(!v.late && v.statement.contains("slew limit"), "{}", v.statement);
        }
    }
}
