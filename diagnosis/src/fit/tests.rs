//! The fit against truths that are known, and the score where nothing is hidden.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_core::simulation::Readout;
use wheelwright_models::VwPdConfig;

use super::algebra::dot;
use super::base::{best_from, fit, renew, tamed};
use super::layout::Layout;
use super::search::{Effort, Fit, evaluate};
use super::setting::{Runner, Setting};
use super::whitening::Whitening;
use crate::effects::{CoulombFriction, GainAsymmetry, SlewLimit};
use crate::fixture::{Case, NOISE, THETA};
use crate::noise::Noise;
use crate::question::Question;
use crate::screen::{Current, Projected, Projection, responses};

const EFFORT: Effort = Effort { trials: 20, worthwhile: 0.01, target: f64::NEG_INFINITY };

/// The base fit of a case under its true noise, in the hands of `f`.
fn fitted<T>(case: &Case, f: impl FnOnce(&Setting<'_>, &Whitening, &Fit) -> T) -> T {
    let model = VwPdConfig::default().build().unwrap();
    let question = Question::new(&*model, &case.data, &[]);
    let layout = Layout::of(&case.data, &case.scene);
    let mut setting = Setting {
        model: &*model,
        map: question.map.clone(),
        bounds: question.bounds.clone(),
        data: &case.data,
        scene: &case.scene,
        readout: Readout::Instantaneous,
        measured: layout.flat(&case.data),
        rounded: vec![0.0; 2],
        steps: Vec::new(),
        rough: None,
        floor: vec![1e-6; 2],
        substeps: 1,
        tolerance: 0.0,
        work: std::cell::Cell::new(0),
        most_steps: u64::MAX,
        layout,
    };
    let rough = fit(&mut setting, &question).unwrap();
    let mut runner = Runner::new(&setting, &[], &rough.point).unwrap();
    let noise = Noise::white(&NOISE, &setting.layout);
    let (whitening, base) = renew(&setting, &mut runner, noise, &rough, EFFORT).unwrap();
    f(&setting, &whitening, &base)
}

#[test]
fn a_start_whose_coupling_is_beyond_stability_is_tamed() {
    fitted(&Case::clean(5), |setting, _, base| {
        let mut setting = setting.clone();
        let mut wild = THETA.to_vec();
        (wild[2], wild[4]) = (0.005, -30.0);
        assert!(best_from(&mut setting, &[wild.clone()]).is_none(), "this start was to run away");
        let found = best_from(&mut setting, &tamed(&[wild])).unwrap();
        let apart = (0..THETA.len()).map(|j| (found.point.x[j] - base.point.x[j]).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-2, "{:?} for {:?}", found.point.x, base.point.x);
    });
}

#[test]
fn the_base_fit_finds_the_truth_within_its_standard_errors_and_leaves_the_noise() {
    fitted(&Case::clean(5), |setting, _, base| {
        let information = base.information(setting);
        let covariance = information.try_inverse().unwrap();
        for (j, truth) in THETA.iter().enumerate() {
            let z = (base.point.x[j] - truth) / covariance[(j, j)].sqrt();
            assert!(z.abs() < 4.0, "theta{}: {} for {truth}, {z} standard errors", j + 1, base.point.x[j]);
        }
        for squares in &base.squares {
            let ratio = squares / setting.layout.counted() as f64;
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
        assert_eq!(base.rank(setting), 6);
    });
}

#[test]
fn at_the_optimum_the_residual_is_orthogonal_to_every_column_and_every_start() {
    // Stretches so short that their starts show in all they have.
    let mut case = Case::clean(6);
    let whole = case.data.stretches[0].clone();
    case.data.stretches = (0..50).map(|i| whole.slice(20 * i..20 * (i + 1))).collect();
    case.scene = case.scene.like(&case.data, None);
    fitted(&case, |setting, whitening, base| {
        let weights = base.weights(setting);
        for column in &base.columns {
            let along: f64 =
                (0..2).map(|c| weights[c] * dot(&base.residual[setting.layout.output(c)], &column[setting.layout.output(c)])).sum();
            let length: f64 = (0..2).map(|c| weights[c] * dot(&column[setting.layout.output(c)], &column[setting.layout.output(c)])).sum();
            assert!(along.abs() / length.sqrt() < 0.2, "{along}");
        }
        // A residual moved by a start's response is the same after projection.
        let none: [&dyn Effect; 0] = [];
        let mut runner = Runner::new(setting, &none, &base.point).unwrap();
        let mut moved = base.point.clone();
        moved.starts[1][0] += 0.02;
        let again = evaluate(setting, &mut runner, whitening, &moved).unwrap();
        let change: f64 = again.residual.iter().zip(&base.residual).map(|(a, b)| (a - b).powi(2)).sum();
        assert!(change < 0.05, "{change}");
        let left = setting.measured.iter().zip(&again.simulated).map(|(y, s)| y - s).collect();
        let (found, was) = (whitening.likeliest(left, &moved.starts)[1][0], base.point.starts[1][0]);
        assert!((found - was).abs() < 0.002, "the start is found again: {found} for {was}");
    });
}

/// What the rows that count say of the start of a stretch is little, and a misfit says it wrongly: the first sample knows better.
#[test]
fn a_misfit_moves_no_start_far_from_its_first_sample() {
    let mut case = Case::clean(7);
    for stretch in &mut case.data.stretches {
        // Pushed while the start still shows a little.
        stretch.outputs[0].iter_mut().skip(22).take(20).for_each(|x| *x += 0.02);
    }
    fitted(&case, |setting, _, base| {
        for (stretch, starts) in setting.data.stretches.iter().zip(&base.point.starts) {
            let off = (starts[0] - stretch.outputs[0][0]).abs() / setting.scene.scales.outputs[0];
            assert!(off < 0.6, "{off}");
        }
    });
}

/// Where nothing is hidden the gain of one free amplitude is chi-squared with one degree of freedom: mean 1, and beyond 6.6 in one of
/// a hundred.
#[test]
fn the_score_of_an_effect_under_the_null_is_chi_squared() {
    let (asymmetry, friction) = (GainAsymmetry::default(), CoulombFriction::default());
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..12 {
        fitted(&Case::clean(100 + seed), |setting, whitening, base| {
            let current = Current::new(setting, &[], base);
            let all = responses(&current, &[(0, &asymmetry), (1, &friction)]);
            let projection = Projection::new(setting, whitening, base, &[]);
            let gains: Vec<f64> = all.iter().enumerate().map(|(i, r)| projection.candidate(i, r, &mut Projected::default()).gain).collect();
            assert!(gains.iter().all(|g| (-1e-6..12.0).contains(g)), "{gains:?}");
            sum += gains[0];
            count += 1.0;
        });
    }
    let mean = sum / count;
    // The mean of twelve has a standard deviation of 0.41.
    assert!((0.2..2.4).contains(&mean), "{mean}");
}

/// Beside a slow ramp the linear answer is a robot that follows at once, and from there no search finds back.
#[test]
fn a_start_makes_no_model_faster_than_can_be_seen() {
    fitted(&Case::clean(5), |setting, whitening, base| {
        let ramp = SlewLimit::default();
        let projection = Projection::new(setting, whitening, base, &[]);
        let all = responses(&Current::new(setting, &[], base), &[(0, &ramp)]);
        let at = |(i, response)| projection.start(response, &projection.candidate(i, response, &mut Projected::default()));
        let starts: Vec<Vec<f64>> = all.iter().enumerate().map(at).collect();
        assert!(starts.iter().all(|start| setting.rate(start) <= setting.fastest(&base.point.x)));
        assert!(starts.iter().any(|start| start[0] < 0.2 * base.point.x[0]), "a ramp was to take the lag's place");
    });
}
