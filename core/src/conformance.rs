//! Conformance: what the traits promise and the compiler cannot see, checked on a live object.
//!
//! Every registered built-in is run through these checks; a plugin author calls them in one line:
//!
//! ```
//! # use wheelwright_core::{Effect, RegressorModel, conformance};
//! fn my_model_keeps_its_promises(model: &dyn RegressorModel) {
//!     assert_eq!(conformance::check_model(model), Ok(()));
//! }
//! fn my_effect_keeps_its_promises(effect: &dyn Effect) {
//!     assert_eq!(conformance::check_effect(effect), Ok(()));
//! }
//! ```

mod effect;

use std::fmt;

use thiserror::Error;

use crate::channel::Channel;
use crate::excitation::Excitation;
use crate::model::{ModelError, RegressorModel, Sample, solve_accelerations};
use crate::robot::Robot;

pub use effect::check_effect;

/// Points at which a model is tried.
const POINTS: usize = 8;
/// Tolerance of equalities, relative to the size of what is compared.
const TOLERANCE: f64 = 1e-9;

/// A promise that was not kept.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Violation {
    /// A name, or a list of names, is empty.
    #[error("{what} is empty")]
    Empty {
        /// What should not be.
        what: String,
    },
    /// Two things share a name.
    #[error("two {what} are named `{name}`")]
    Duplicate {
        /// Kind of thing.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A number is not what it has to be.
    #[error("{what} is {found}: it must be {expected}")]
    Number {
        /// Which number.
        what: String,
        /// Its value.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// A length differs from what was promised.
    #[error("{what} has {found} values: {expected} are needed")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Its length by the contract.
        expected: usize,
    },
    /// A value was not written, or is not finite.
    #[error("{what} was not written or is not finite at {point}")]
    NotFinite {
        /// Which value.
        what: String,
        /// Where.
        point: Point,
    },
    /// The same question got two answers.
    #[error("{what} changed from {first} to {second} when asked again at {point}")]
    NotRepeatable {
        /// Which value.
        what: String,
        /// First answer.
        first: f64,
        /// Second answer.
        second: f64,
        /// Where.
        point: Point,
    },
    /// The equations are not affine in the accelerations.
    #[error("{what} is not affine in the accelerations: {found} where a straight line gives {expected}, at {point}")]
    NotAffine {
        /// Which value.
        what: String,
        /// Value found.
        found: f64,
        /// Value on the line through two others.
        expected: f64,
        /// Where.
        point: Point,
    },
    /// The model's own accelerations do not solve its equations.
    #[error("accelerations() gives {found} for `{output}` where the equations give {expected}, at {point}")]
    Accelerations {
        /// Output channel.
        output: String,
        /// Value of the model.
        found: f64,
        /// Value that solves the equations.
        expected: f64,
        /// Where.
        point: Point,
    },
    /// The model's own motion is not what its accelerations make of it.
    #[error("flow() takes {what} to {found} where the accelerations take it to {expected}, from {point}")]
    Flow {
        /// Which value.
        what: String,
        /// Value by the model's motion.
        found: f64,
        /// Value by its accelerations.
        expected: f64,
        /// Where it started.
        point: Point,
    },
    /// One way to the accelerations fails where the other does not.
    #[error("accelerations() ends with {found} where the equations end with {expected}, at {point}")]
    AccelerationsEnd {
        /// End of the model's own.
        found: String,
        /// End of the general solution.
        expected: String,
        /// Where.
        point: Point,
    },
    /// A call failed that must not.
    #[error("{call} failed: {reason}")]
    Failed {
        /// Which call.
        call: &'static str,
        /// Its error.
        reason: String,
    },
    /// The robot's clock does not run.
    #[error("the robot's time went from {before} s to {after} s over a control period")]
    TimeStands {
        /// Time before a step \[s\].
        before: f64,
        /// Time after it \[s\].
        after: f64,
    },
    /// A command depends on which other channels the robot has, or in which order.
    #[error(
        "the command of `{channel}` at t = {time} s is {found} where {expected} was expected: channels go by name, unnamed ones are zero"
    )]
    ByPosition {
        /// Channel.
        channel: String,
        /// Time \[s\].
        time: f64,
        /// Value found.
        found: f64,
        /// Value expected.
        expected: f64,
    },
    /// An effect breaks a promise.
    #[error("on {channels} channels: {promise}")]
    Effect {
        /// Which channels it acted on: `body`, `sides`, `single`; `all` for what does not depend on them.
        channels: &'static str,
        /// What it did.
        promise: String,
    },
}

/// Where a check was made.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Point {
    /// Time \[s\], for what depends on it.
    pub time: Option<f64>,
    /// Inputs.
    pub inputs: Vec<f64>,
    /// Outputs.
    pub outputs: Vec<f64>,
    /// Accelerations.
    pub accelerations: Vec<f64>,
}

impl Point {
    fn at(time: f64) -> Self {
        Self { time: Some(time), ..Self::default() }
    }

    fn sample(&self) -> Sample<'_> {
        Sample { inputs: &self.inputs, outputs: &self.outputs, accelerations: &self.accelerations }
    }
}

impl fmt::Display for Point {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(time) = self.time {
            return write!(f, "t = {time} s");
        }
        write!(f, "inputs {:?}, outputs {:?}", self.inputs, self.outputs)?;
        if self.accelerations.is_empty() { Ok(()) } else { write!(f, ", accelerations {:?}", self.accelerations) }
    }
}

/// Checks that a model names its channels and parameters uniquely, fills its whole regressor with finite repeatable
/// values, is affine in the accelerations, maps free parameters onto all of θ, and that its closed forms of the
/// accelerations and of the motion, if it has them, solve its equations.
///
/// The points tried lie between 0.3 and 2 in size, so that what a model does near rest (static friction) is its own affair.
///
/// # Errors
/// Every promise that was not kept.
pub fn check_model(model: &dyn RegressorModel) -> Result<(), Vec<Violation>> {
    let mut found = Findings::default();
    found.name("the model's name", model.name());
    found.channels("input", model.inputs());
    found.channels("output", model.outputs());
    check_parameters(model, &mut found);
    if model.equations() == 0 {
        found.push(Violation::Empty { what: "the list of equations".to_owned() });
    }
    if found.0.is_empty() {
        for k in 0..POINTS {
            check_regressor(model, k, &mut found);
            check_accelerations(model, k, &mut found);
            check_flow(model, k, &mut found);
        }
    }
    found.end()
}

/// Checks a connected robot: its channels and period, that it can be measured, that time passes while zero commands are
/// held for a few periods, and that it can be stopped twice. The robot is commanded to stand still throughout.
///
/// # Errors
/// Every promise that was not kept.
pub fn check_robot(robot: &mut dyn Robot) -> Result<(), Vec<Violation>> {
    let mut found = Findings::default();
    found.channels("input", robot.inputs());
    found.channels("output", robot.outputs());
    let period = robot.period();
    if !(period.is_finite() && period > 0.0) {
        found.push(Violation::Number { what: "the period".to_owned(), found: period, expected: "a number of seconds above zero" });
    }
    let command = vec![0.0; robot.inputs().len()];
    let names: Vec<String> = robot.outputs().iter().map(|c| c.name.to_string()).collect();
    let mut measured = vec![f64::NAN; names.len()];
    let first = robot.measure(&mut measured);
    let mut time = found.measurement("measure", first.map_err(|e| e.to_string()), &names, &measured);
    for _ in 0..4 {
        let Some(before) = time else { break };
        measured.fill(f64::NAN);
        let stepped = robot.step(&command, &mut measured);
        time = found.measurement("step", stepped.map_err(|e| e.to_string()), &names, &measured);
        if let Some(after) = time.filter(|after| *after <= before) {
            found.push(Violation::TimeStands { before, after });
            break;
        }
    }
    for call in ["stop", "a second stop"] {
        if let Err(error) = robot.stop() {
            found.push(Violation::Failed { call, reason: error.to_string() });
        }
    }
    found.end()
}

/// Checks an excitation on the channels it is meant for: that it accepts them, lasts a positive time, and commands finite
/// repeatable values by name, zero on a channel it cannot know.
///
/// # Errors
/// Every promise that was not kept.
pub fn check_excitation(excitation: &dyn Excitation, inputs: &[Channel]) -> Result<(), Vec<Violation>> {
    let mut found = Findings::default();
    let duration = excitation.duration();
    if !(duration.is_finite() && duration > 0.0) {
        found.push(Violation::Number { what: "the duration".to_owned(), found: duration, expected: "a number of seconds above zero" });
    }
    if let Err(error) = excitation.check(inputs) {
        found.push(Violation::Failed { call: "check", reason: error.to_string() });
    }
    let mut extended: Vec<Channel> = inputs.iter().rev().cloned().collect();
    extended.push(Channel::new("no channel of any robot", "1"));
    let mut first = vec![f64::NAN; inputs.len()];
    let mut second = vec![f64::NAN; extended.len()];
    for k in 0..=64 {
        if !found.0.is_empty() {
            break;
        }
        let t = duration * f64::from(k) / 64.0;
        first.fill(f64::NAN);
        second.fill(f64::NAN);
        excitation.command(t, inputs, &mut first);
        excitation.command(t, &extended, &mut second);
        let expected = first.iter().rev().copied().chain(std::iter::once(0.0));
        for ((channel, value), expected) in extended.iter().zip(&second).zip(expected) {
            if !expected.is_finite() || !value.is_finite() {
                found.push(Violation::NotFinite { what: format!("the command of `{}`", channel.name), point: Point::at(t) });
            } else if *value != expected {
                found.push(Violation::ByPosition { channel: channel.name.to_string(), time: t, found: *value, expected });
            }
        }
    }
    found.end()
}

/// Violations found so far.
#[derive(Default)]
struct Findings(Vec<Violation>);

impl Findings {
    fn push(&mut self, violation: Violation) {
        self.0.push(violation);
    }

    fn end(self) -> Result<(), Vec<Violation>> {
        if self.0.is_empty() { Ok(()) } else { Err(self.0) }
    }

    fn name(&mut self, what: &str, name: &str) {
        if name.trim().is_empty() {
            self.push(Violation::Empty { what: what.to_owned() });
        }
    }

    fn unique<'a>(&mut self, what: &'static str, names: impl Iterator<Item = &'a str>) {
        let mut seen: Vec<&str> = Vec::new();
        for name in names {
            self.name(&format!("the name of one of the {what}"), name);
            if seen.contains(&name) {
                self.push(Violation::Duplicate { what, name: name.to_owned() });
            }
            seen.push(name);
        }
    }

    fn channels(&mut self, kind: &str, channels: &[Channel]) {
        if channels.is_empty() {
            self.push(Violation::Empty { what: format!("the list of {kind} channels") });
        }
        self.unique("channels", channels.iter().map(|c| c.name.as_ref()));
        for channel in channels {
            self.name(&format!("the unit of `{}`", channel.name), &channel.unit);
        }
    }

    fn length(&mut self, what: &'static str, found: usize, expected: usize) {
        if found != expected {
            self.push(Violation::Length { what, found, expected });
        }
    }

    /// The robot's time, if a measurement came and is finite throughout.
    fn measurement(&mut self, call: &'static str, time: Result<f64, String>, names: &[String], measured: &[f64]) -> Option<f64> {
        let time = match time {
            Ok(time) => time,
            Err(reason) => {
                self.push(Violation::Failed { call, reason });
                return None;
            }
        };
        let before = self.0.len();
        if !time.is_finite() {
            self.push(Violation::Number { what: format!("the time returned by {call}"), found: time, expected: "a finite number" });
        }
        for (name, _) in names.iter().zip(measured).filter(|(_, value)| !value.is_finite()) {
            self.push(Violation::NotFinite { what: format!("`{name}` by {call}"), point: Point::at(time) });
        }
        (self.0.len() == before).then_some(time)
    }
}

fn check_parameters(model: &dyn RegressorModel, found: &mut Findings) {
    let parameters = model.parameters();
    if parameters.is_empty() {
        found.push(Violation::Empty { what: "the list of parameters".to_owned() });
    }
    found.unique("parameters", parameters.iter().map(|p| p.name.as_str()));
    for parameter in parameters {
        let (lower, upper) = parameter.bounds;
        found.name(&format!("the unit of `{}`", parameter.name), &parameter.unit);
        found.name(&format!("the meaning of `{}`", parameter.name), &parameter.meaning);
        if lower.is_nan() || upper.is_nan() || lower > upper {
            found.push(Violation::Number {
                what: format!("the lower bound of `{}`", parameter.name),
                found: lower,
                expected: "no larger than the upper one, neither of them NaN",
            });
        }
    }
    let map = model.map();
    found.unique("free parameters", map.free.iter().map(String::as_str));
    found.length("the offset of map()", map.offset.len(), parameters.len());
    found.length("the matrix of map()", map.matrix.len(), parameters.len() * map.free.len());
    for value in map.matrix.iter().chain(&map.offset).filter(|v| !v.is_finite()) {
        found.push(Violation::Number { what: "a value of map()".to_owned(), found: *value, expected: "a finite number" });
    }
}

/// Values of varied size between 0.3 and 2 and of both signs, the same for the same `k`.
fn values(k: usize, list: usize, n: usize) -> Vec<f64> {
    let fraction = |seed: usize| (seed as f64 * 0.618_033_988_749_894_9).fract();
    let value = |i: usize| {
        let seed = 1 + k + POINTS * (list + 4 * i);
        let size = 0.3 + 1.7 * fraction(seed);
        if fraction(7 * seed + 3) < 0.5 { -size } else { size }
    };
    (0..n).map(value).collect()
}

fn point(model: &dyn RegressorModel, k: usize) -> Point {
    let (inputs, outputs) = (model.inputs().len(), model.outputs().len());
    Point { time: None, inputs: values(k, 0, inputs), outputs: values(k, 1, outputs), accelerations: values(k, 2, outputs) }
}

/// Φ and y in one list.
fn evaluate(model: &dyn RegressorModel, point: &Point) -> Vec<f64> {
    let (equations, parameters) = (model.equations(), model.parameters().len());
    let mut phi = vec![f64::NAN; equations * parameters];
    let mut y = vec![f64::NAN; equations];
    model.regressor(point.sample(), &mut phi, &mut y);
    phi.extend(y);
    phi
}

/// Name of an entry of [`evaluate`].
fn entry(model: &dyn RegressorModel, index: usize) -> String {
    let parameters = model.parameters();
    let (row, column) = (index / parameters.len(), index % parameters.len());
    match index.checked_sub(model.equations() * parameters.len()) {
        Some(equation) => format!("y of equation {}", equation + 1),
        None => format!("the column of `{}` in equation {}", parameters[column].name, row + 1),
    }
}

fn check_regressor(model: &dyn RegressorModel, k: usize, found: &mut Findings) {
    let at = point(model, k);
    let scaled = |factor: f64| {
        let accelerations = at.accelerations.iter().map(|a| factor * a).collect();
        evaluate(model, &Point { accelerations, ..at.clone() })
    };
    let (first, second) = (evaluate(model, &at), evaluate(model, &at));
    let (rest, double) = (scaled(0.0), scaled(2.0));
    for i in 0..first.len() {
        let what = || entry(model, i);
        if [first[i], second[i], rest[i], double[i]].iter().any(|x| !x.is_finite()) {
            found.push(Violation::NotFinite { what: what(), point: at.clone() });
        } else if first[i] != second[i] {
            found.push(Violation::NotRepeatable { what: what(), first: first[i], second: second[i], point: at.clone() });
        } else {
            let expected = 2.0 * first[i] - rest[i];
            let size = first[i].abs() + rest[i].abs() + double[i].abs();
            if (double[i] - expected).abs() > TOLERANCE * size {
                found.push(Violation::NotAffine { what: what(), found: double[i], expected, point: at.clone() });
            }
        }
    }
}

/// Parameters within their bounds.
fn inside_bounds(model: &dyn RegressorModel, k: usize) -> Vec<f64> {
    let wanted = values(k, 3, model.parameters().len());
    let place = |((lower, upper), x): ((f64, f64), f64)| match (lower.is_finite(), upper.is_finite()) {
        (true, true) => lower + (upper - lower) * (0.25 + 0.25 * x.abs()).min(1.0),
        (true, false) => lower + x.abs(),
        (false, true) => upper - x.abs(),
        (false, false) => x,
    };
    model.parameters().iter().map(|p| p.bounds).zip(wanted).map(place).collect()
}

fn check_accelerations(model: &dyn RegressorModel, k: usize, found: &mut Findings) {
    let at = Point { accelerations: Vec::new(), ..point(model, k) };
    let theta = inside_bounds(model, k);
    let n = model.outputs().len();
    let (mut own, mut solved) = (vec![f64::NAN; n], vec![f64::NAN; n]);
    let own_end = model.accelerations(&theta, &at.inputs, &at.outputs, &mut own);
    let solved_end = solve_accelerations(model, &theta, &at.inputs, &at.outputs, &mut solved);
    if let (Ok(()), Ok(())) = (&own_end, &solved_end) {
        let size: f64 = solved.iter().map(|a| a.abs()).fold(1.0, f64::max);
        for ((output, a), expected) in model.outputs().iter().zip(&own).zip(&solved) {
            if !a.is_finite() || (a - expected).abs() > TOLERANCE * size {
                found.push(Violation::Accelerations { output: output.name.to_string(), found: *a, expected: *expected, point: at.clone() });
            }
        }
    } else if own_end != solved_end {
        let say = |end: Result<(), ModelError>| end.map_or_else(|e| format!("\"{e}\""), |()| "a value".to_owned());
        found.push(Violation::AccelerationsEnd { found: say(own_end), expected: say(solved_end), point: at });
    }
}

/// Time over which a motion is compared \[s\]: so short that a step of Runge-Kutta is accurate to rounding.
const MOMENT: f64 = 1e-4;

fn check_flow(model: &dyn RegressorModel, k: usize, found: &mut Findings) {
    let Some(flow) = model.flow() else { return };
    let at = Point { accelerations: Vec::new(), ..point(model, k) };
    let theta = inside_bounds(model, k);
    let Some((expected, way)) = moved(model, &theta, &at) else { return };
    let (mut outputs, mut travelled) = (at.outputs.clone(), vec![f64::NAN; at.outputs.len()]);
    if let Err(error) = flow.advance(&theta, &at.inputs, MOMENT, &mut outputs, &mut travelled) {
        return found.push(Violation::Failed { call: "flow", reason: error.to_string() });
    }
    for (i, output) in model.outputs().iter().enumerate() {
        let ways = (format!("the integral of `{}`", output.name), travelled[i], way[i], MOMENT);
        for (what, value, expected, unit) in [(format!("`{}`", output.name), outputs[i], expected[i], 1.0), ways] {
            if !value.is_finite() || (value - expected).abs() > TOLERANCE * unit * (1.0 + expected.abs() / unit) {
                found.push(Violation::Flow { what, found: value, expected, point: at.clone() });
            }
        }
    }
}

/// Outputs and their integrals after [`MOMENT`], by one step of classical Runge-Kutta; `None` where there are no accelerations.
fn moved(model: &dyn RegressorModel, theta: &[f64], from: &Point) -> Option<(Vec<f64>, Vec<f64>)> {
    let mut slopes: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    for share in [0.0, 0.5, 0.5, 1.0] {
        let along = slopes.last().map(|(slope, _)| slope.clone()).unwrap_or_else(|| vec![0.0; from.outputs.len()]);
        let state: Vec<f64> = from.outputs.iter().zip(along).map(|(x, a)| x + share * MOMENT * a).collect();
        let mut slope = vec![f64::NAN; state.len()];
        model.accelerations(theta, &from.inputs, &state, &mut slope).ok()?;
        slopes.push((slope, state));
    }
    let weighed = |value: &dyn Fn(usize) -> f64| MOMENT / 6.0 * (value(0) + 2.0 * value(1) + 2.0 * value(2) + value(3));
    let outputs = from.outputs.iter().enumerate().map(|(i, x)| x + weighed(&|s| slopes[s].0[i])).collect();
    Some((outputs, (0..from.outputs.len()).map(|i| weighed(&|s| slopes[s].1[i])).collect()))
}

#[cfg(test)]
#[path = "conformance_tests.rs"]
mod tests;
