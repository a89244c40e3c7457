//! `steady-state`: parameters of the equations at rest, from stretches in which nothing changes.
//!
//! Where commands are constant and outputs have settled, accelerations are zero and (1) reads Φ(ū, x̄, 0) θ = y(ū) for
//! the means: of `vw-pd`, v_ref = θ4 v at ω = 0 and ω_ref = θ6 ω at v = 0 (Laut 2011, Tables 4.3 and 4.4). No derivative,
//! no filter, no sampling error.
//!
//! Such stretches cannot show every parameter. Those they show are estimated from them; those named in `given` keep the
//! value stated there; the rest is estimated by `ols` from all samples with the others held. Where that is impossible
//! too, the error names what is missing.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use wheelwright_core::dataset::Stretch;
use wheelwright_core::model::{ParameterMap, RegressorModel, Sample};
use wheelwright_core::regression::{EquationRows, Settings, StretchRows};
use wheelwright_core::solver::{Problem, Solution, SolveError, Solver};

use crate::ols::Ols;
use crate::regression::{SolverRegression, not_identifiable};

/// Share of an output's largest value below which its mean counts as standing still, and of its range within which it
/// counts as settled.
const STILL: f64 = 0.02;
/// Standard errors of a mean that are not told from zero.
const ERRORS: f64 = 3.0;
/// Smallest singular value, column-scaled, at which constant stretches count as telling parameters apart: means of
/// measured outputs do not carry more.
const RANK: f64 = 0.01;

/// Settings of the `steady-state` solver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SteadyState {
    /// Time after a change of command that is left out \[s\]. Default 2.
    pub settle_s: f64,
    /// Shortest settled stretch that is used \[s\]. Default 1.
    pub hold_s: f64,
    /// Share of an input's range within which it counts as constant. Default 0.02.
    pub flat: f64,
    /// Free parameters that keep a value, `theta3 = 0.0`.
    pub given: BTreeMap<String, f64>,
    /// Rows for the parameters that `ols` estimates: a table with the keys of [`Settings`].
    pub conditioning: Settings,
}

impl Default for SteadyState {
    fn default() -> Self {
        Self { settle_s: 2.0, hold_s: 1.0, flat: 0.02, given: BTreeMap::new(), conditioning: Settings::default() }
    }
}

#[typetag::serde(name = "steady-state")]
impl Solver for SteadyState {
    fn name(&self) -> &str {
        "steady-state"
    }

    fn about(&self) -> String {
        "parameters without dynamics from constant, settled stretches; the others given or by `ols`".to_owned()
    }

    fn solve(&self, problem: &Problem<'_>) -> Result<Solution, SolveError> {
        self.check()?;
        let (model, map) = (problem.model, self.with_given(&problem.map)?);
        let holds = self.holds(problem);
        let [mut regression, mut visible] = [SolverRegression::empty(model), SolverRegression::empty(model)];
        regression.append(&rows(model, &holds, |h| &h.outputs), 1);
        visible.append(&rows(model, &holds, |h| &h.moving), 1);
        regression.preparation.rows = holds.len();
        let shown = shown(&regression, &visible, &map)?;
        if shown.values.is_empty() {
            return Err(self.nothing_constant(model, &map));
        }
        let names = shown.values.iter().map(|(j, _)| map.free[*j].as_str()).collect::<Vec<_>>().join(", ");
        let step = format!(
            "estimated {names} from {} constant stretch(es) of {} s or more, {} s after the last change of command",
            holds.len(),
            self.hold_s,
            self.settle_s
        );
        let rest = fixed(&map, &shown.values);
        let mut solution = if rest.free.is_empty() {
            regression.into_solution(rest.theta(&[]), shown.condition)
        } else {
            let ols = Ols { conditioning: self.conditioning.clone(), undo_hold: true };
            let problem = Problem { map: rest.clone(), bounds: problem.bounds.clone(), ..*problem };
            let mut solution = ols.solve(&problem).map_err(|e| or_given(e, &rest))?;
            solution.steps.push(format!("estimated {} by least squares on all samples with the others held", rest.free.join(", ")));
            solution.condition = solution.condition.max(shown.condition);
            solution
        };
        solution.steps.insert(0, step);
        Ok(solution)
    }
}

/// One constant stretch: its means and number of samples.
#[derive(Debug, Clone, PartialEq)]
struct Constant {
    inputs: Vec<f64>,
    outputs: Vec<f64>,
    /// Outputs with those that cannot be told from standing still set to zero. They decide which parameters are shown: a
    /// robot that drives straight has some ω, and θ3 must not be read from its square.
    moving: Vec<f64>,
    samples: usize,
}

/// Free parameters that constant stretches show, with their values.
#[derive(Debug)]
struct Shown {
    values: Vec<(usize, f64)>,
    condition: f64,
}

impl SteadyState {
    fn check(&self) -> Result<(), SolveError> {
        for (key, value) in [("settle_s", self.settle_s), ("hold_s", self.hold_s), ("flat", self.flat)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SolveError::Setting { key: key.to_owned(), reason: format!("{value} must be a number, 0 or more") });
            }
        }
        self.conditioning.check()
    }

    /// The map with `given` values put in.
    fn with_given(&self, map: &ParameterMap) -> Result<ParameterMap, SolveError> {
        let values = self.given.iter().map(|(name, value)| match map.free.iter().position(|f| f == name) {
            Some(j) => Ok((j, *value)),
            None => Err(SolveError::Setting {
                key: format!("given.{name}"),
                reason: format!("no free parameter has this name; free are {}", map.free.join(", ")),
            }),
        });
        Ok(fixed(map, &values.collect::<Result<Vec<_>, _>>()?))
    }

    /// Constant, settled stretches of the data.
    fn holds(&self, problem: &Problem<'_>) -> Vec<Constant> {
        let stretches = &problem.data.stretches;
        let range = |pick: &dyn Fn(&Stretch) -> &Vec<f64>| {
            let all = stretches.iter().flat_map(|s| pick(s).iter());
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
            (high - low, high.abs().max(low.abs()))
        };
        let inputs: Vec<f64> = (0..problem.data.inputs.len()).map(|i| range(&|s| &s.inputs[i]).0 * self.flat).collect();
        let outputs: Vec<f64> = (0..problem.data.outputs.len()).map(|i| range(&|s| &s.outputs[i]).1 * STILL).collect();
        let mut found = Vec::new();
        for stretch in stretches {
            let mut start = 0;
            for k in 1..=stretch.len() {
                let same = |(u, tolerance): (&Vec<f64>, &f64)| (u[k] - u[start]).abs() <= *tolerance;
                if k == stretch.len() || !stretch.inputs.iter().zip(&inputs).all(same) {
                    found.extend(self.constant(stretch, start..k, &outputs));
                    start = k;
                }
            }
        }
        found
    }

    /// The settled part of a stretch of constant inputs, if it is long enough and indeed settled.
    fn constant(&self, stretch: &Stretch, rows: std::ops::Range<usize>, still: &[f64]) -> Option<Constant> {
        let time = &stretch.time;
        let settled = (rows.start..rows.end).find(|&k| time[k] - time[rows.start] >= self.settle_s)?;
        let samples = rows.end - settled;
        if samples < 4 || time[rows.end - 1] - time[settled] < self.hold_s * (1.0 - 1e-9) {
            return None;
        }
        let half = settled + samples / 2;
        let (mut outputs, mut moving) = (Vec::with_capacity(still.len()), Vec::with_capacity(still.len()));
        for (x, tolerance) in stretch.outputs.iter().zip(still) {
            let (mean, spread) = mean_and_spread(&x[settled..rows.end]);
            let error = ERRORS * spread / (samples as f64).sqrt();
            let drift = mean_and_spread(&x[half..rows.end]).0 - mean_and_spread(&x[settled..half]).0;
            if drift.abs() > tolerance.max(2.0 * error) {
                return None;
            }
            outputs.push(mean);
            moving.push(if mean.abs() <= tolerance.max(error) { 0.0 } else { mean });
        }
        let inputs = stretch.inputs.iter().map(|u| mean_and_spread(&u[settled..rows.end]).0).collect();
        Some(Constant { inputs, outputs, moving, samples })
    }

    fn nothing_constant(&self, model: &dyn RegressorModel, map: &ParameterMap) -> SolveError {
        let (e, p, z) = (model.equations(), model.parameters().len(), map.free.len());
        let (mut phi, mut y) = (vec![0.0; e * p], vec![0.0; e]);
        let ones = vec![1.0; model.inputs().len().max(model.outputs().len())];
        let accelerations = vec![0.0; model.outputs().len()];
        let sample =
            Sample { inputs: &ones[..model.inputs().len()], outputs: &ones[..model.outputs().len()], accelerations: &accelerations };
        model.regressor(sample, &mut phi, &mut y);
        let still = |j: &usize| (0..p).any(|i| map.matrix[i * z + j] != 0.0 && (0..e).any(|r| phi[r * p + i] != 0.0));
        let free: Vec<usize> = (0..z).filter(still).collect();
        let mut error = not_identifiable(model, map, &free);
        if let SolveError::NotIdentifiable { missing, .. } = &mut error {
            let length = self.settle_s + self.hold_s;
            *missing = format!("{length} s or more of constant command while moving, with outputs that settle, at several speeds");
        }
        error
    }
}

/// Rows of (1) at the means, each weighted by the root of its number of samples.
fn rows(model: &dyn RegressorModel, holds: &[Constant], outputs: fn(&Constant) -> &[f64]) -> StretchRows {
    let (e, p) = (model.equations(), model.parameters().len());
    let (mut phi, mut y) = (vec![0.0; e * p], vec![0.0; e]);
    let accelerations = vec![0.0; model.outputs().len()];
    let mut equations = vec![EquationRows { columns: vec![Vec::new(); p], response: Vec::new() }; e];
    for hold in holds {
        let weight = (hold.samples as f64).sqrt();
        model.regressor(Sample { inputs: &hold.inputs, outputs: outputs(hold), accelerations: &accelerations }, &mut phi, &mut y);
        for (i, equation) in equations.iter_mut().enumerate() {
            equation.columns.iter_mut().enumerate().for_each(|(j, c)| c.push(weight * phi[i * p + j]));
            equation.response.push(weight * y[i]);
        }
    }
    StretchRows { stretch: 0, time: vec![0.0; holds.len()], equations }
}

/// Solves for what the rows show, going by those with only clear motion in them. Of each direction they leave open, one parameter is put aside so that the others can be
/// solved for, and none that takes part is reported.
fn shown(regression: &SolverRegression, visible: &SolverRegression, map: &ParameterMap) -> Result<Shown, SolveError> {
    let weights = regression.unit_weights();
    let mut kept: Vec<usize> = (0..map.free.len()).collect();
    let mut open: Vec<usize> = Vec::new();
    loop {
        let aside: Vec<(usize, f64)> = (0..map.free.len()).filter(|j| !kept.contains(j)).map(|j| (j, 0.0)).collect();
        let reduced = fixed(map, &aside);
        if kept.is_empty() {
            return Ok(Shown { values: Vec::new(), condition: 1.0 });
        }
        match visible.system(&reduced, &weights).undetermined(RANK)? {
            Ok(condition) => {
                let free = regression.least_squares(&reduced, &weights)?;
                let values = kept.iter().copied().zip(free).filter(|(j, _)| !open.contains(j)).collect();
                return Ok(Shown { values, condition });
            }
            Err(part) => {
                open.extend(part.iter().map(|&k| kept[k]));
                kept.remove(part[0]);
            }
        }
    }
}

/// A map with some of its free parameters fixed.
fn fixed(map: &ParameterMap, values: &[(usize, f64)]) -> ParameterMap {
    let z = map.free.len();
    let kept: Vec<usize> = (0..z).filter(|j| values.iter().all(|(i, _)| i != j)).collect();
    let row = |i: usize| kept.iter().map(move |&j| map.matrix[i * z + j]).collect::<Vec<_>>();
    let offset = |i: usize| map.offset[i] + values.iter().map(|(j, value)| map.matrix[i * z + j] * value).sum::<f64>();
    ParameterMap {
        free: kept.iter().map(|&j| map.free[j].clone()).collect(),
        matrix: (0..map.offset.len()).flat_map(row).collect(),
        offset: (0..map.offset.len()).map(offset).collect(),
    }
}

/// An error of the dynamic part, with the way out that this solver has.
fn or_given(error: SolveError, rest: &ParameterMap) -> SolveError {
    match error {
        SolveError::NotIdentifiable { parameters, missing } => {
            let missing = format!("{missing}; or state values in the solver's `given` table for {}", rest.free.join(", "));
            SolveError::NotIdentifiable { parameters, missing }
        }
        other => other,
    }
}

fn mean_and_spread(x: &[f64]) -> (f64, f64) {
    let n = x.len().max(1) as f64;
    let mean = x.iter().sum::<f64>() / n;
    (mean, (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}
