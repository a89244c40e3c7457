//! What surrounds an identification: whether the data could answer, how late the response is, how far any model could
//! come, and whether several recordings agree.

use serde_json::{Value, json};
use wheelwright_core::agreement::{self, Agreement};
use wheelwright_core::ceiling::{self, OutputCeiling};
use wheelwright_core::dataset::Dataset;
use wheelwright_core::identifiability::{self, Identifiability};
use wheelwright_core::identification::Identification;
use wheelwright_core::integral_action::{self, IntegralAction};
use wheelwright_core::lag::{self, AxisLag, Lag};
use wheelwright_core::solver::{Problem, SolveError, Solver};

/// More samples than this make no verdict surer, only later: of longer data the evidence sees this many, from every stretch its share.
const MOST: usize = 30_000;

/// Evidence beside the parameters. A part that the data do not allow is `None`, and says why in [`missing`](Self::missing).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Evidence {
    /// Verdict on each parameter, excitation, sampling rate.
    pub identifiability: Option<Identifiability>,
    /// Lag between command and response.
    pub lag: Option<Lag>,
    /// Whether the drive integrates its error; `None` also for a model without commands of its outputs' units.
    pub integral_action: Option<IntegralAction>,
    /// Noise ceiling and NARX yardstick, one entry an output.
    pub ceiling: Option<Vec<OutputCeiling>>,
    /// Comparison of the recordings fitted one by one; `None` for one recording.
    pub agreement: Option<Agreement>,
    /// Why parts are missing.
    pub missing: Vec<String>,
}

impl Evidence {
    /// Gathers the evidence around an identification of `problem` with its held-out data and the recordings it pooled.
    pub fn gather(
        problem: &Problem<'_>,
        solver: &dyn Solver,
        found: &Identification,
        held_out: &Dataset,
        recordings: &[(String, Dataset)],
    ) -> Self {
        let mut evidence = Self::default();
        let (model, theta) = (problem.model, found.solution.theta.as_slice());
        let (data, held_out) = (problem.data.shortened(MOST), held_out.shortened(MOST));
        let judged = identifiability::assess(model, &problem.map, Some(theta), &data);
        evidence.identifiability = evidence.keep("identifiability", judged);
        let late = lag::estimate(model, &problem.map, &data);
        evidence.lag = evidence.keep("lag", late);
        let predicted = evidence.identifiability.iter().flat_map(|i| &i.parameters).map(|j| j.predicted_std.unwrap_or(f64::NAN));
        let std = found.solution.std.clone().unwrap_or_else(|| predicted.collect());
        let integrates = integral_action::assess(model, &problem.map, theta, &std, &data);
        evidence.integral_action = evidence.keep("judgement of integral action", integrates).flatten();
        let highest = ceiling::estimate(model, theta, &data, &held_out);
        evidence.ceiling = evidence.keep("noise ceiling", highest);
        if recordings.len() > 1 {
            let (runs, unfitted) = agreement::fit_each(model, &problem.map, &problem.bounds, problem.seed, solver, recordings);
            evidence.missing.extend(unfitted.iter().map(|u| format!("{} could not be fitted alone: {}", u.label, u.error)));
            evidence.agreement = agreement::compare(model.parameters(), &runs);
        }
        evidence
    }

    fn keep<T>(&mut self, what: &str, result: Result<T, SolveError>) -> Option<T> {
        result.map_err(|error| self.missing.push(format!("no {what}: {error}"))).ok()
    }

    /// What a user should know: weak parameters, a lag, runs that do not agree, parts that are missing.
    pub fn concerns(&self) -> Vec<String> {
        let mut concerns = self.identifiability.as_ref().map(Identifiability::concerns).unwrap_or_default();
        // On data without noise any lag is significant; one far below the time constant concerns nobody.
        let matters = |a: &&AxisLag| a.late && a.delay_s > 0.01 * a.time_constant_s;
        concerns.extend(self.lag.iter().flat_map(|l| &l.axes).filter(matters).map(|a| a.statement.clone()));
        concerns.extend(self.integral_action.iter().flat_map(IntegralAction::concerns));
        concerns.extend(self.agreement.iter().filter(|a| a.p.is_some_and(|p| p < agreement::LEVEL)).map(|a| a.statement.clone()));
        concerns.extend(self.missing.iter().cloned());
        concerns
    }

    /// The evidence in sentences, a line each.
    pub fn sentences(&self) -> Vec<String> {
        let mut sentences: Vec<String> = self.ceiling.iter().flatten().map(|c| c.statement.clone()).collect();
        sentences.extend(self.lag.iter().flat_map(|l| &l.axes).map(|a| a.statement.clone()));
        sentences.extend(self.integral_action.iter().flat_map(|i| &i.axes).map(|a| a.statement.clone()));
        sentences.extend(self.identifiability.iter().filter_map(|i| i.sampling.as_ref()).map(|s| s.statement.clone()));
        sentences.extend(
            self.agreement.iter().flat_map(|a| std::iter::once(&a.statement).chain(a.parameters.iter().map(|p| &p.statement))).cloned(),
        );
        sentences
    }

    /// True unless the data were judged not to show the parameter.
    pub fn identifiable(&self, parameter: usize) -> bool {
        let verdict = self.identifiability.as_ref().and_then(|i| i.parameters.get(parameter)).map(|j| j.verdict);
        verdict != Some(identifiability::Verdict::Not)
    }

    /// Keys of the `identify` document.
    pub fn document(&self) -> Value {
        json!({
            "identifiability": self.identifiability,
            "lag": self.lag,
            "integral_action": self.integral_action,
            "noise_ceiling": self.ceiling,
            "runs": self.agreement,
        })
    }
}
