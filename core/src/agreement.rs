//! Several recordings of one robot: how much every parameter differs from run to run, and whether that is more than noise.
//!
//! Each recording is fitted alone by the same solver. Where the solver gives standard errors, Cochran's Q (a chi-square under
//! agreement) tests each parameter, and all of them jointly; what is more than noise is described by the between-run standard
//! deviation of the random-effects model (DerSimonian and Laird, Controlled Clinical Trials 7, 1986), with the interval of Hartung
//! and Knapp (Statistics in Medicine 20, 2001), which keeps its level also for few runs. Without standard errors only the
//! spread is known.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};

use crate::dataset::Dataset;
use crate::model::{Parameter, ParameterMap, RegressorModel};
use crate::solver::{Problem, SolveError, Solver};

/// Level of every test here.
pub const LEVEL: f64 = 0.05;

/// Values that differ by less than this share are one value: solvers stop no closer to their optimum.
const SAME: f64 = 1e-6;

/// Share of its variance below which a parameter's error is that of others, but for rounding.
const TIED: f64 = 1e-9;

/// What one recording alone gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// What the recording is called in sentences: its path.
    pub label: String,
    /// θ in the model's order.
    pub theta: Vec<f64>,
    /// Standard error of each parameter, if the solver gives honest ones.
    pub std: Option<Vec<f64>>,
    /// Covariance of θ, row-major, if the solver gives one; makes the joint test exact.
    pub covariance: Option<Vec<f64>>,
}

/// A recording that could not be fitted alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Unfitted {
    /// The recording.
    pub label: String,
    /// Why.
    pub error: SolveError,
}

/// One parameter over the runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spread {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Its value in each run.
    pub values: Vec<f64>,
    /// Plain mean.
    pub mean: f64,
    /// Standard deviation of the values from run to run, noise of the estimates included.
    pub spread: f64,
    /// The test, where every run has a standard error.
    pub test: Option<Test>,
    /// The result in a sentence.
    pub statement: String,
}

/// Cochran's test with the random-effects description of one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Test {
    /// Σ w (θ − mean)² with w = 1/σ².
    pub q: f64,
    /// Degrees of freedom: runs − 1.
    pub degrees: usize,
    /// Probability of a Q as large if the runs agree.
    pub p: f64,
    /// The same after Holm's correction for the number of parameters tested, which decides.
    pub adjusted: f64,
    /// Between-run standard deviation after DerSimonian and Laird; zero where the scatter is no more than the noise.
    pub between: f64,
    /// Random-effects mean.
    pub pooled: f64,
    /// Its 95 % interval after Hartung and Knapp.
    pub ci95: (f64, f64),
}

/// Whether runs agree.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Labels of the runs.
    pub runs: Vec<String>,
    /// One entry a parameter.
    pub parameters: Vec<Spread>,
    /// Joint probability: of the chi-square over all parameters where every run has a covariance, else the least p of the
    /// parameters after Holm's correction, which holds however the estimates are correlated. `None` without standard errors.
    pub p: Option<f64>,
    /// The result in a sentence.
    pub statement: String,
}

/// Fits every recording alone. Recordings that cannot be fitted come back with their reason; the others still compare.
pub fn fit_each(
    model: &dyn RegressorModel,
    map: &ParameterMap,
    bounds: &[(f64, f64)],
    seed: u64,
    solver: &dyn Solver,
    recordings: &[(String, Dataset)],
) -> (Vec<Run>, Vec<Unfitted>) {
    let (mut runs, mut unfitted) = (Vec::new(), Vec::new());
    for (label, data) in recordings {
        let problem = Problem { model, data, map: map.clone(), bounds: bounds.to_vec(), seed };
        match solver.solve(&problem) {
            Ok(found) => runs.push(Run { label: label.clone(), theta: found.theta, std: found.std, covariance: found.covariance }),
            Err(error) => unfitted.push(Unfitted { label: label.clone(), error }),
        }
    }
    (runs, unfitted)
}

/// Compares runs; `None` for fewer than two, or if they differ in their number of parameters.
pub fn compare(parameters: &[Parameter], runs: &[Run]) -> Option<Agreement> {
    let n = parameters.len();
    let whole = |r: &Run| {
        r.theta.len() == n && r.std.as_ref().is_none_or(|s| s.len() == n) && r.covariance.as_ref().is_none_or(|c| c.len() == n * n)
    };
    if runs.len() < 2 || !runs.iter().all(whole) {
        return None;
    }
    let mut parameters: Vec<Spread> = parameters.iter().enumerate().map(|(j, p)| spread(p, j, runs)).collect();
    holm(parameters.iter_mut().filter_map(|s| s.test.as_mut()).collect());
    parameters.iter_mut().for_each(|s| s.statement = of_parameter(s));
    let least =
        parameters.iter().filter_map(|s| s.test.map(|t| t.adjusted)).fold(None, |m: Option<f64>, p| Some(m.map_or(p, |m| m.min(p))));
    let p = joint(runs).or(least);
    let statement = statement(&parameters, runs.len(), p);
    Some(Agreement { runs: runs.iter().map(|r| r.label.clone()).collect(), parameters, p, statement })
}

fn spread(parameter: &Parameter, j: usize, runs: &[Run]) -> Spread {
    let values: Vec<f64> = runs.iter().map(|r| r.theta[j]).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let spread = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt();
    let std: Option<Vec<f64>> = runs.iter().map(|r| r.std.as_ref().map(|s| s[j])).collect();
    // A fixed parameter has no error and nothing to test.
    let test = std.filter(|s| s.iter().all(|s| *s > 0.0 && s.is_finite())).and_then(|std| test(&values, &std));
    let (name, unit) = (parameter.name.clone(), parameter.unit.clone());
    Spread { name, unit, values, mean, spread, test, statement: String::new() }
}

fn of_parameter(found: &Spread) -> String {
    let (name, mean, spread) = (&found.name, found.mean, found.spread);
    let unit = if found.unit == "1" { String::new() } else { format!(" {}", found.unit) };
    match found.test {
        None => format!("{name} varies by {spread:.2e}{unit} from run to run about {mean:.4}{unit} (no standard errors to test with)"),
        Some(t) if t.adjusted >= LEVEL => {
            format!(
                "{name} agrees over the runs: they scatter as their standard errors say (Q = {:.2} on {}, p = {:.2})",
                t.q, t.degrees, t.adjusted
            )
        }
        Some(t) => format!(
            "{name} differs between the runs by more than noise (Q = {:.1} on {}, p = {}): between-run standard deviation {:.2e}{unit}, {:.1} % of its mean",
            t.q,
            t.degrees,
            probability(t.adjusted),
            t.between,
            100.0 * t.between / t.pooled.abs()
        ),
    }
}

fn test(values: &[f64], std: &[f64]) -> Option<Test> {
    let weighted = |weights: &[f64]| {
        let sum: f64 = weights.iter().sum();
        let mean = weights.iter().zip(values).map(|(w, x)| w * x).sum::<f64>() / sum;
        let q: f64 = weights.iter().zip(values).map(|(w, x)| w * (x - mean).powi(2)).sum();
        (sum, mean, q)
    };
    let std: Vec<f64> = std.iter().zip(values).map(|(s, x)| s.max(SAME * x.abs())).collect();
    let weights: Vec<f64> = std.iter().map(|s| 1.0 / (s * s)).collect();
    let (sum, _, q) = weighted(&weights);
    let degrees = values.len() - 1;
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    let variance = ((q - degrees as f64) / (sum - squares / sum)).max(0.0);
    let random: Vec<f64> = std.iter().map(|s| 1.0 / (s * s + variance)).collect();
    let (sum, pooled, scatter) = weighted(&random);
    // Hartung and Knapp's variance, not below that of the plain random-effects mean: with few runs chance can make it tiny.
    let error = ((scatter / degrees as f64).max(1.0) / sum).sqrt();
    let quantile = StudentsT::new(0.0, 1.0, degrees as f64).ok()?.inverse_cdf(1.0 - 0.5 * LEVEL);
    let ci95 = (pooled - quantile * error, pooled + quantile * error);
    let p = exceeding(q, degrees)?;
    Some(Test { q, degrees, p, adjusted: p, between: variance.sqrt(), pooled, ci95 })
}

/// Probability of a chi-square on `degrees` above `q`.
fn exceeding(q: f64, degrees: usize) -> Option<f64> {
    ChiSquared::new(degrees as f64).ok().map(|d| d.sf(q))
}

/// Σ (θ − mean)ᵀ C⁻¹ (θ − mean) over the runs with the mean weighted alike, over [`independent`] parameters.
fn joint(runs: &[Run]) -> Option<f64> {
    let n = runs[0].theta.len();
    let covariances: Vec<DMatrix<f64>> =
        runs.iter().map(|r| r.covariance.as_ref().map(|c| floored(DMatrix::from_row_slice(n, n, c), &r.theta))).collect::<Option<_>>()?;
    let free = independent(&covariances);
    let weights: Vec<DMatrix<f64>> =
        covariances.iter().map(|c| c.select_rows(&free).select_columns(&free).cholesky().map(|c| c.inverse())).collect::<Option<_>>()?;
    let values: Vec<DVector<f64>> = runs.iter().map(|r| DVector::from_iterator(free.len(), free.iter().map(|j| r.theta[*j]))).collect();
    let zero = (DMatrix::zeros(free.len(), free.len()), DVector::zeros(free.len()));
    let (sum, right) = weights.iter().zip(&values).fold(zero, |(sum, right), (w, x)| (sum + w, right + w * x));
    let mean = sum.cholesky()?.solve(&right);
    let q: f64 = weights.iter().zip(&values).map(|(w, x)| ((x - &mean).transpose() * w * (x - &mean))[(0, 0)]).sum();
    exceeding(q, (runs.len() - 1) * free.len())
}

/// Parameters that have an error of their own in every run: fixed ones have none, and of tied ones the last has none.
fn independent(covariances: &[DMatrix<f64>]) -> Vec<usize> {
    let n = covariances.first().map_or(0, DMatrix::nrows);
    let mut kept: Vec<usize> = Vec::new();
    for j in 0..n {
        let wider: Vec<usize> = kept.iter().copied().chain([j]).collect();
        let own = |c: &DMatrix<f64>| {
            let correlation = DMatrix::from_fn(wider.len(), wider.len(), |a, b| {
                let (a, b) = (wider[a], wider[b]);
                c[(a, b)] / (c[(a, a)] * c[(b, b)]).sqrt()
            });
            let last = wider.len() - 1;
            correlation.cholesky().is_some_and(|factor| factor.l()[(last, last)].powi(2) > TIED)
        };
        if covariances.iter().all(|c| c[(j, j)] > 0.0 && own(c)) {
            kept = wider;
        }
    }
    kept
}

/// A covariance whose errors are not below what counts as one value; parameters without error stay so.
fn floored(mut covariance: DMatrix<f64>, theta: &[f64]) -> DMatrix<f64> {
    for (j, x) in theta.iter().enumerate().filter(|(j, _)| covariance[(*j, *j)] > 0.0).collect::<Vec<_>>() {
        covariance[(j, j)] = covariance[(j, j)].max((SAME * x).powi(2));
    }
    covariance
}

/// Holm's step-down correction (Scandinavian Journal of Statistics 6, 1979).
fn holm(mut tests: Vec<&mut Test>) {
    tests.sort_by(|a, b| a.p.total_cmp(&b.p));
    let count = tests.len();
    let mut largest = 0.0_f64;
    for (k, test) in tests.into_iter().enumerate() {
        largest = largest.max((count - k) as f64 * test.p).min(1.0);
        test.adjusted = largest;
    }
}

fn statement(parameters: &[Spread], runs: usize, p: Option<f64>) -> String {
    match p {
        None => format!("{runs} runs were fitted alone; the solver gives no standard errors, so only their spread is known"),
        Some(p) if p >= LEVEL => format!("the {runs} runs agree within their standard errors (p = {p:.2})"),
        Some(p) => {
            let differing: Vec<&str> =
                parameters.iter().filter(|s| s.test.is_some_and(|t| t.adjusted < LEVEL)).map(|s| s.name.as_str()).collect();
            let names = if differing.is_empty() { "the parameters taken together".to_owned() } else { differing.join(", ") };
            format!(
                "the {runs} runs do not agree (p = {}): {names} differ by more than noise; intervals of a pooled fit are too narrow for them",
                probability(p)
            )
        }
    }
}

fn probability(p: f64) -> String {
    if p < 1e-4 { "below 0.0001".to_owned() } else { format!("{p:.4}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::tests::Normal;
    use proptest::prelude::*;

    fn parameters(n: usize) -> Vec<Parameter> {
        (0..n).map(|i| Parameter::new(&format!("theta{}", i + 1), "s", "", "")).collect()
    }

    fn runs(values: &[f64], std: &[f64]) -> Vec<Run> {
        let each = values.iter().zip(std).enumerate();
        each.map(|(i, (x, s))| Run { label: format!("run {i}"), theta: vec![*x], std: Some(vec![*s]), covariance: Some(vec![s * s]) })
            .collect()
    }

    /// Values of the formulas in numpy with scipy 1.x:
    ///
    /// ```python
    /// import numpy as np; from scipy import stats
    /// x=np.array([.26,.27,.31,.24]); s=np.array([.01,.012,.008,.02]); w=1/s**2
    /// m=(w*x).sum()/w.sum(); q=(w*(x-m)**2).sum(); p=stats.chi2.sf(q,3)
    /// t2=max(0,(q-3)/(w.sum()-(w**2).sum()/w.sum())); u=1/(s**2+t2); mu=(u*x).sum()/u.sum()
    /// h=np.sqrt(max(1,(u*(x-mu)**2).sum()/3)/u.sum())*stats.t.ppf(.975,3)
    /// ```
    #[test]
    fn one_parameter_as_scipy_has_it() {
        let found = compare(&parameters(1), &runs(&[0.26, 0.27, 0.31, 0.24], &[0.01, 0.012, 0.008, 0.02])).unwrap();
        let test = found.parameters[0].test.unwrap();
        let expected =
            [22.475742574257417, 5.19306936974921e-05, 0.028664582893316026, 0.27239842867737135, 0.22250325911564806, 0.32229359823909465];
        for (found, expected) in [test.q, test.p, test.between, test.pooled, test.ci95.0, test.ci95.1].iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{test:?} {expected}");
        }
        // With one parameter the joint test is that of the parameter.
        assert!((found.p.unwrap() / test.p - 1.0).abs() < 1e-9);
        assert!(found.statement.starts_with("the 4 runs do not agree"), "{}", found.statement);
    }

    #[test]
    fn without_standard_errors_there_is_a_spread_and_no_test() {
        let mut runs = runs(&[1.0, 3.0], &[0.1, 0.1]);
        runs.iter_mut().for_each(|r| (r.std, r.covariance) = (None, None));
        let found = compare(&parameters(1), &runs).unwrap();
        assert_eq!((found.parameters[0].mean, found.parameters[0].test, found.p), (2.0, None, None));
        assert!((found.parameters[0].spread - 2.0_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn what_differs_by_rounding_agrees() {
        let found = compare(&parameters(1), &runs(&[0.25, 0.25 + 1e-10], &[1e-13, 1e-13])).unwrap();
        assert!(found.parameters[0].test.unwrap().p > 0.9 && found.p.unwrap() > 0.9, "{found:?}");
    }

    #[test]
    fn the_correction_is_holms() {
        let blank = Test { q: 0.0, degrees: 1, p: 0.0, adjusted: 0.0, between: 0.0, pooled: 0.0, ci95: (0.0, 0.0) };
        let mut tests = [0.01, 0.04, 0.03, 0.005].map(|p| Test { p, ..blank });
        holm(tests.iter_mut().collect());
        // R: p.adjust(c(.01, .04, .03, .005), "holm")
        for (test, expected) in tests.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((test.adjusted - expected).abs() < 1e-12, "{test:?}");
        }
    }

    #[test]
    fn one_run_has_nothing_to_agree_with() {
        assert_eq!(compare(&parameters(1), &runs(&[1.0], &[0.1])), None);
    }

    #[test]
    fn a_fixed_parameter_is_not_tested() {
        let found = compare(&parameters(1), &runs(&[1.0, 1.0], &[0.0, 0.0])).unwrap();
        assert_eq!(found.parameters[0].test, None);
    }

    #[test]
    fn parameters_that_are_tied_count_once_in_the_joint_test() {
        let run = |x: f64, y: f64| {
            // The second is three times the first, the fourth is fixed; the third is correlated with the first.
            let direction = DMatrix::from_row_slice(4, 2, &[0.1, 0.0, 0.3, 0.0, 0.05, 0.2, 0.0, 0.0]);
            let covariance = &direction * direction.transpose();
            let theta = &direction * DVector::from_vec(vec![x, y]) + DVector::from_vec(vec![1.0, 3.0, 1.0, 1.0]);
            Run { label: String::new(), theta: theta.as_slice().to_vec(), std: None, covariance: Some(covariance.as_slice().to_vec()) }
        };
        // In units of its deviations the difference is (2, 1): a chi-square of (4 + 1)/2 on two.
        let found = compare(&parameters(4), &[run(1.0, 0.0), run(-1.0, -1.0)]).unwrap();
        assert!((found.p.unwrap() - (-1.25_f64).exp()).abs() < 1e-9, "{found:?}");
    }

    /// Correlated estimates of six parameters over five runs: rejections at 5 % level over 2000 draws, agreement holding.
    #[test]
    fn tests_keep_their_level_under_correlation() {
        let mut normal = Normal::new(11);
        let (n, r, draws) = (6, 5, 2000);
        let mixing = DMatrix::from_fn(n, n, |i, j| if i >= j { 1.0 / (1.0 + (i - j) as f64) } else { 0.0 });
        let covariance = &mixing * mixing.transpose();
        let (mut joint, mut holm, mut single) = (0, 0, 0);
        for _ in 0..draws {
            let run = |label: usize, normal: &mut Normal, exact: bool| Run {
                label: label.to_string(),
                theta: (&mixing * DVector::from_fn(n, |_, _| normal.next())).as_slice().to_vec(),
                std: Some(covariance.diagonal().iter().map(|v| v.sqrt()).collect()),
                covariance: exact.then(|| covariance.as_slice().to_vec()),
            };
            let exact: Vec<Run> = (0..r).map(|i| run(i, &mut normal, true)).collect();
            let bare: Vec<Run> = exact.iter().map(|r| Run { covariance: None, ..r.clone() }).collect();
            let found = compare(&parameters(n), &exact).unwrap();
            joint += usize::from(found.p.unwrap() < LEVEL);
            single += usize::from(found.parameters[0].test.unwrap().p < LEVEL);
            holm += usize::from(compare(&parameters(n), &bare).unwrap().p.unwrap() < LEVEL);
        }
        // 5 % of 2000 is 100 with a standard deviation of 10; Holm may stay below.
        assert!((70..=130).contains(&joint), "{joint}");
        assert!((70..=130).contains(&single), "{single}");
        assert!((20..=130).contains(&holm), "{holm}");
    }

    #[test]
    fn the_between_run_deviation_is_found_and_the_interval_covers() {
        let mut normal = Normal::new(12);
        let (between, draws) = (0.02, 400);
        let (mut sum, mut covered) = (0.0, 0);
        for _ in 0..draws {
            let std: Vec<f64> = (0..8).map(|_| 0.005 + 0.01 * normal.uniform()).collect();
            let values: Vec<f64> = std.iter().map(|s| 0.25 + between * normal.next() + s * normal.next()).collect();
            let test = compare(&parameters(1), &runs(&values, &std)).unwrap().parameters[0].test.unwrap();
            sum += test.between.powi(2) / f64::from(draws);
            covered += usize::from(test.ci95.0 <= 0.25 && 0.25 <= test.ci95.1);
        }
        assert!((sum.sqrt() / between - 1.0).abs() < 0.06, "{}", sum.sqrt());
        // 95 % of 400 with a standard deviation of 4.4.
        assert!((367..=395).contains(&covered), "{covered}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn agreement_knows_no_units(values in prop::collection::vec(0.1..1.0f64, 2..6), scale in 1e-3..1e3f64) {
            let std: Vec<f64> = values.iter().map(|x| 0.1 * x + 0.01).collect();
            let scaled = |x: &[f64]| x.iter().map(|x| x * scale).collect::<Vec<_>>();
            let plain = compare(&parameters(1), &runs(&values, &std)).unwrap().parameters[0].test.unwrap();
            let other = compare(&parameters(1), &runs(&scaled(&values), &scaled(&std))).unwrap().parameters[0].test.unwrap();
            prop_assert!((plain.p - other.p).abs() < 1e-9);
            prop_assert!((plain.between * scale - other.between).abs() < 1e-9 * scale);
        }
    }
}
