//! A recording replayed through the recursive estimator, sample by sample, as it would have come on the robot.

use std::fmt::Write;

use serde_json::{Value, json};
use wheelwright_core::dataset::Dataset;
use wheelwright_core::model::{ParameterMap, RegressorModel};
use wheelwright_core::solver::SolveError;
use wheelwright_solvers::{DIFFERENCED, Recursive, Stage};

use crate::documents::number;
use crate::output::quoted;

/// Points of the trajectory that the JSON document keeps; the CSV has all.
const POINTS: usize = 200;

/// What the estimator said after every sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Settings it ran with.
    pub settings: Recursive,
    /// Name and unit of each parameter.
    pub parameters: Vec<(String, String)>,
    /// What each innovation is one of: the input that is the equation's response, or the equation's number.
    pub equations: Vec<String>,
    /// One entry a stretch.
    pub parts: Vec<Part>,
    /// θ of the regression alone, after the last sample.
    pub regression: Vec<f64>,
    /// Why there are no intervals at the end, if there are none.
    pub obstacle: Option<&'static str>,
    /// What else a reader must know: that the velocities turned out to be differenced from counts.
    pub remark: Option<&'static str>,
}

/// A stretch of a trace: columns as long as its time. What is not known is not a number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Part {
    /// Label of the stretch.
    pub label: String,
    /// Times of the samples \[s\].
    pub time: Vec<f64>,
    /// Where each estimate comes from: `none`, `regression`, `free-run`.
    pub source: Vec<&'static str>,
    /// Estimates by parameter.
    pub value: Vec<Vec<f64>>,
    /// Lower ends of the 95 % intervals by parameter.
    pub low: Vec<Vec<f64>>,
    /// Upper ends.
    pub high: Vec<Vec<f64>>,
    /// Innovation by equation: what the last window held beyond what was predicted, in units of the response.
    pub innovation: Vec<Vec<f64>>,
}

impl Trace {
    /// Replays the stretches in order; as velocities differenced from encoder counts where the errors of such a pass show that they are.
    ///
    /// # Errors
    /// [`SolveError::Setting`].
    pub fn replay(settings: &Recursive, model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<Self, SolveError> {
        if let Some(differences) = settings.on_differences() {
            let (trace, counts) = Self::pass(&differences, model, map, data)?;
            if counts {
                return Ok(Self { remark: Some(DIFFERENCED), ..trace });
            }
        }
        Self::pass(settings, model, map, data).map(|(trace, _)| trace)
    }

    /// One pass; also whether its errors are those of differenced counts.
    fn pass(settings: &Recursive, model: &dyn RegressorModel, map: &ParameterMap, data: &Dataset) -> Result<(Self, bool), SolveError> {
        let mut estimator = settings.start(model, map)?;
        let (count, equations) = (model.parameters().len(), model.equations());
        let (mut theta, mut std) = (vec![0.0; count], vec![0.0; count]);
        let (mut inputs, mut outputs) = (vec![0.0; data.inputs.len()], vec![0.0; data.outputs.len()]);
        let mut parts = Vec::with_capacity(data.stretches.len());
        for stretch in &data.stretches {
            estimator.new_stretch();
            let columns = |n: usize| vec![Vec::with_capacity(stretch.len()); n];
            let mut part = Part {
                label: stretch.label.clone(),
                time: stretch.time.clone(),
                source: Vec::with_capacity(stretch.len()),
                value: columns(count),
                low: columns(count),
                high: columns(count),
                innovation: columns(equations),
            };
            for (k, time) in stretch.time.iter().enumerate() {
                inputs.iter_mut().zip(&stretch.inputs).for_each(|(x, c)| *x = c[k]);
                outputs.iter_mut().zip(&stretch.outputs).for_each(|(x, c)| *x = c[k]);
                let full = estimator.push(*time, &inputs, &outputs);
                let (source, half_width) = match estimator.estimate(&mut theta, &mut std) {
                    Stage::Unknown => ("none", f64::NAN),
                    Stage::Regression => ("regression", f64::NAN),
                    Stage::FreeRun { half_width } => ("free-run", half_width),
                };
                part.source.push(source);
                for i in 0..count {
                    let value = if source == "none" { f64::NAN } else { theta[i] };
                    part.value[i].push(value);
                    part.low[i].push(value - half_width * std[i]);
                    part.high[i].push(value + half_width * std[i]);
                }
                for (column, innovation) in part.innovation.iter_mut().zip(estimator.innovation()) {
                    column.push(if full { *innovation } else { f64::NAN });
                }
            }
            parts.push(part);
        }
        estimator.theta(&mut theta);
        let name = |e: usize| if equations == data.inputs.len() { data.inputs[e].name.to_string() } else { format!("equation {}", e + 1) };
        let trace = Self {
            settings: settings.clone(),
            parameters: model.parameters().iter().map(|p| (p.name.clone(), p.unit.clone())).collect(),
            equations: (0..equations).map(name).collect(),
            parts,
            regression: theta,
            obstacle: estimator.obstacle(),
            remark: None,
        };
        Ok((trace, estimator.counts()))
    }

    /// Root mean square of an equation's innovation over the samples that had an estimate before them.
    pub fn innovation_rms(&self, equation: usize) -> f64 {
        let values = || self.parts.iter().flat_map(|p| &p.innovation[equation]).filter(|x| x.is_finite() && **x != 0.0);
        (values().map(|x| x * x).sum::<f64>() / values().count().max(1) as f64).sqrt()
    }

    /// Seconds of data after which intervals were stated without a break to the end.
    pub fn settled_s(&self) -> Option<f64> {
        let (mut elapsed, mut settled) = (0.0, None);
        for part in &self.parts {
            let start = part.time.first().copied().unwrap_or_default();
            for (time, source) in part.time.iter().zip(&part.source) {
                settled = if *source == "free-run" { settled.or(Some(elapsed + time - start)) } else { None };
            }
            elapsed += part.time.last().map_or(0.0, |end| end - start);
        }
        settled
    }

    /// The estimates in a sentence or two.
    pub fn statement(&self) -> String {
        let intervals = match (self.obstacle, self.settled_s()) {
            (Some(reason), _) => format!("no intervals while running: {reason}"),
            (None, Some(seconds)) => format!("estimates while running carry intervals from {seconds:.1} s on"),
            (None, None) => "no estimate carried intervals".to_owned(),
        };
        self.remark.map_or_else(|| intervals.clone(), |remark| format!("{intervals}; {remark}"))
    }

    /// The block `online` of the `identify` document.
    pub fn document(&self) -> Value {
        let rows: Vec<(usize, usize)> =
            self.parts.iter().enumerate().flat_map(|(p, part)| (0..part.time.len()).map(move |k| (p, k))).collect();
        let step = rows.len().div_ceil(POINTS).max(1);
        // Counted from the end, so that the last estimate is among them.
        let mut kept: Vec<(usize, usize)> = rows.into_iter().rev().step_by(step).collect();
        kept.reverse();
        let column = |of: &dyn Fn(&Part, usize) -> Value| kept.iter().map(|&(p, k)| of(&self.parts[p], k)).collect::<Vec<_>>();
        let parameters = self.parameters.iter().enumerate().map(|(i, (name, unit))| {
            let interval = |p: &Part, k: usize| if p.low[i][k].is_finite() { json!([p.low[i][k], p.high[i][k]]) } else { Value::Null };
            json!({
                "name": name,
                "unit": unit,
                "regression": number(self.regression[i]),
                "value": column(&|p, k| number(p.value[i][k])),
                "ci95": column(&interval),
            })
        });
        let innovation = self.equations.iter().enumerate().map(
            |(e, name)| json!({ "of": name, "rms": number(self.innovation_rms(e)), "value": column(&|p, k| number(p.innovation[e][k])) }),
        );
        json!({
            "window": self.settings.window,
            "memory_s": self.settings.memory_s,
            "refine": self.settings.refine,
            "samples": self.parts.iter().map(|p| p.time.len()).sum::<usize>(),
            "settled_s": self.settled_s(),
            "no_intervals": self.obstacle,
            "t": column(&|p, k| json!(p.time[k])),
            "segment": column(&|p, _| json!(p.label)),
            "source": column(&|p, k| json!(p.source[k])),
            "parameters": parameters.collect::<Vec<_>>(),
            "innovation": innovation.collect::<Vec<_>>(),
        })
    }

    /// Every sample as a row: `t`, `segment`, `source`, each parameter with the ends of its interval under `_low` and `_high`, and
    /// each innovation under `innovation_`. What is not known is empty.
    pub fn csv(&self) -> String {
        let mut text = "t,segment,source".to_owned();
        for (name, _) in &self.parameters {
            let _ = write!(text, ",{name},{name}_low,{name}_high");
        }
        for name in &self.equations {
            let _ = write!(text, ",innovation_{}", name.replace(' ', "_"));
        }
        text.push('\n');
        for part in &self.parts {
            let label = quoted(&part.label);
            for (k, time) in part.time.iter().enumerate() {
                let _ = write!(text, "{time},{label},{}", part.source[k]);
                let estimates = (0..self.parameters.len()).flat_map(|i| [part.value[i][k], part.low[i][k], part.high[i][k]]);
                for x in estimates.chain(part.innovation.iter().map(|c| c[k])) {
                    let _ = if x.is_finite() { write!(text, ",{x}") } else { write!(text, ",") };
                }
                text.push('\n');
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prelude::*;
    use wheelwright_core::Stretch;

    fn driven(rows: usize) -> Stretch {
        let time: Vec<f64> = (0..rows).map(|k| 0.05 * k as f64).collect();
        let inputs = vec![
            time.iter().map(|t| 0.4 + 0.2 * (0.9 * t).sin() + 0.1 * (2.3 * t).sin()).collect(),
            time.iter().map(|t| 0.7 * (0.7 * t).cos() + 0.3 * (1.9 * t).sin()).collect(),
        ];
        let mut stretch = Stretch { label: "a,b".to_owned(), time, inputs, outputs: vec![vec![0.0; rows]; 2] };
        let model = VwPdConfig::default().build().unwrap();
        let theta = [0.26, 0.22, -0.005, 0.999, -0.028, 1.014];
        let mut run = vec![Vec::new(), Vec::new()];
        wheelwright_core::simulation::Simulator::new(&*model, &theta).unwrap().run(&stretch, &[0.0; 2], &mut run).unwrap();
        stretch.outputs = run;
        stretch
    }

    #[test]
    fn a_trace_holds_every_sample_and_ends_with_the_solution() {
        let model = VwPdConfig::default().build().unwrap();
        let data =
            Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![driven(900), driven(300)] };
        let settings = Recursive::default();
        let trace = Trace::replay(&settings, &*model, &model.map(), &data).unwrap();
        let solution = settings.solve(&Problem::new(&*model, &data)).unwrap();
        let last = &trace.parts[1];
        assert_eq!(last.value.iter().map(|c| c[299]).collect::<Vec<_>>(), solution.theta);
        assert_eq!(trace.equations, ["v_ref", "omega_ref"]);
        assert!(trace.obstacle.is_none() && trace.settled_s().is_some_and(|s| s > 1.0 && s < 40.0), "{:?}", trace.settled_s());
        let csv = trace.csv();
        assert_eq!(csv.lines().count(), 1201);
        assert!(csv.starts_with("t,segment,source,theta1,theta1_low,theta1_high,theta2,"));
        assert!(csv.lines().nth(1).unwrap().starts_with("0,\"a,b\",none,,,,"), "{:?}", csv.lines().nth(1));
        let document = trace.document();
        let (t, theta1) = (document["t"].as_array().unwrap(), &document["parameters"][0]);
        assert!(t.len() <= POINTS && t.last().unwrap() == &json!(last.time[299]));
        assert_eq!(theta1["value"].as_array().unwrap().last().unwrap(), &json!(solution.theta[0]));
        assert!(theta1["ci95"].as_array().unwrap().last().unwrap().is_array() && theta1["ci95"][0].is_null());
    }

    #[test]
    fn without_the_free_run_the_reason_is_said() {
        let model = VwPdConfig::default().build().unwrap();
        let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![driven(900)] };
        let settings = Recursive { refine: false, ..Recursive::default() };
        let trace = Trace::replay(&settings, &*model, &model.map(), &data).unwrap();
        assert!(trace.document()["no_intervals"].as_str().unwrap().contains("biases"));
        assert_eq!(trace.settled_s(), None);
    }
}
