//! The numerical pieces against independent ways to the same numbers.

use crate::common;

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use wheelwright_core::channel::Channel;
use wheelwright_core::model::{Parameter, ParameterMap, RegressorModel, Sample};
use wheelwright_core::regression::{Form, Pairing, Settings};
use wheelwright_core::solver::SolveError;
use wheelwright_solvers::triangle::Triangle;
use wheelwright_solvers::{Hold, Quadratic};

/// Plain least squares by QR. (The library's singular values lose ten digits on columns of very different size.)
fn least_squares(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    let qr = a.clone().qr();
    let mut right = b.clone();
    qr.q_tr_mul(&mut right);
    qr.r().solve_upper_triangular(&right.rows(0, a.ncols())).unwrap()
}

/// The minimum within box bounds by trying every one of the 3ⁿ active sets (Stark and Parker 1995, section 1).
fn enumerate(a: &DMatrix<f64>, b: &DVector<f64>, bounds: &[(f64, f64)]) -> Vec<f64> {
    let n = a.ncols();
    let mut best = (f64::INFINITY, vec![0.0; n]);
    for set in 0..3_usize.pow(n as u32) {
        let side: Vec<usize> = (0..n).map(|i| set / 3_usize.pow(i as u32) % 3).collect();
        let mut z: Vec<f64> = (0..n).map(|i| [0.0, bounds[i].0, bounds[i].1][side[i]]).collect();
        let free: Vec<usize> = (0..n).filter(|&i| side[i] == 0).collect();
        if !free.is_empty() {
            let rest = b - a * DVector::from_column_slice(&z);
            let columns = DMatrix::from_fn(a.nrows(), free.len(), |r, c| a[(r, free[c])]);
            let solved = least_squares(&columns, &rest);
            free.iter().zip(solved.iter()).for_each(|(&i, x)| z[i] = *x);
        }
        let inside = z.iter().zip(bounds).all(|(x, (l, u))| *x >= l - 1e-12 && *x <= u + 1e-12);
        let cost = (a * DVector::from_column_slice(&z) - b).norm();
        if inside && cost < best.0 {
            best = (cost, z);
        }
    }
    best.1
}

/// A regression of `n` unknowns with columns of very different size, a truth and bounds around it.
fn regression(n: usize) -> impl Strategy<Value = (DMatrix<f64>, DVector<f64>, Vec<(f64, f64)>)> {
    let entries = prop::collection::vec(-1.0_f64..1.0, 12 * n);
    let response = prop::collection::vec(-1.0_f64..1.0, 12);
    let bounds = prop::collection::vec((-0.5_f64..0.3, 0.0_f64..0.6), n);
    let scales = prop::collection::vec(-2_i32..3, n);
    (entries, response, bounds, scales)
        .prop_map(move |(entries, response, bounds, scales)| {
            let scale = |j: usize| 10.0_f64.powi(scales[j]);
            let a = DMatrix::from_fn(12, n, |i, j| entries[i * n + j] * scale(j));
            let bounds = bounds.iter().enumerate().map(|(j, (l, w))| (l / scale(j), (l + w) / scale(j))).collect();
            (a, DVector::from_vec(response), bounds)
        })
        .prop_filter("columns must be told apart", |(a, _, _)| {
            let mut unit = a.clone();
            unit.column_iter_mut().for_each(|mut c| c /= c.norm().max(1e-300));
            let values = unit.singular_values();
            values.min() > 1e-4 * values.max()
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn bounded_least_squares_equals_enumeration((a, b, bounds) in (1_usize..5).prop_flat_map(regression)) {
        let n = a.ncols();
        let found = Quadratic { a: a.clone(), b: b.clone(), c: DMatrix::identity(n, n), bounds: bounds.clone() }.solve().unwrap();
        let expected = enumerate(&a, &b, &bounds);
        for j in 0..n {
            let scale = a.column(j).norm();
            prop_assert!(((found[j] - expected[j]) * scale).abs() <= 1e-10, "{:?} {:?}", found, expected);
            prop_assert!(found[j] >= bounds[j].0 - 1e-12 / scale && found[j] <= bounds[j].1 + 1e-12 / scale);
        }
    }

    #[test]
    fn bounds_on_combinations_hold_with_the_right_multipliers((a, b, _) in regression(3), limit in -0.3_f64..0.3) {
        // z1 + z2 <= limit: the optimum is the free one if that satisfies it, else the one on the plane.
        let c = DMatrix::from_row_slice(1, 3, &[1.0, 1.0, 0.0]);
        let bounds = vec![(f64::NEG_INFINITY, limit)];
        let found = Quadratic { a: a.clone(), b: b.clone(), c, bounds }.solve().unwrap();
        let free = least_squares(&a, &b);
        let expected = if free[0] + free[1] <= limit {
            free.as_slice().to_vec()
        } else {
            // z1 = limit - z2.
            let reduced = DMatrix::from_columns(&[a.column(1) - a.column(0), a.column(2).into_owned()]);
            let z = least_squares(&reduced, &(&b - a.column(0) * limit));
            vec![limit - z[0], z[0], z[1]]
        };
        for j in 0..3 {
            prop_assert!(((found[j] - expected[j]) * a.column(j).norm()).abs() <= 1e-9, "{:?} {:?}", found, expected);
        }
    }

    #[test]
    fn a_triangle_keeps_the_cost_of_all_its_rows(
        columns in prop::collection::vec(prop::collection::vec(-1.0_f64..1.0, 700), 4),
        cuts in prop::collection::vec(1_usize..700, 3),
        theta in prop::collection::vec(-2.0_f64..2.0, 3),
    ) {
        let mut triangle = Triangle::new(4);
        let mut ends = cuts.clone();
        ends.push(700);
        ends.sort_unstable();
        let mut start = 0;
        for (piece, end) in ends.into_iter().enumerate() {
            // In the second piece the first column is silent.
            let part = |j: usize| if j == 0 && piece == 1 { &[][..] } else { &columns[j][start..end] };
            triangle.append(&[part(0), part(1), part(2), part(3)], end - start);
            start = end;
        }
        let mut cuts = cuts;
        cuts.push(0);
        cuts.sort_unstable();
        let silent = cuts[1]..cuts[2];
        let cost: f64 = (0..700).map(|k| {
            let first = if silent.contains(&k) { 0.0 } else { columns[0][k] };
            (first * theta[0] + columns[1][k] * theta[1] + columns[2][k] * theta[2] - columns[3][k]).powi(2)
        }).sum();
        let point = DVector::from_vec(vec![theta[0], theta[1], theta[2], -1.0]);
        let folded = (triangle.matrix() * point).norm_squared();
        prop_assert!((folded - cost).abs() <= 1e-11 * cost, "{} {}", folded, cost);
        prop_assert_eq!(triangle.rows(), 700);
    }
}

/// Two coupled equations, M x' + K x = u, every entry of M and K a parameter.
#[derive(Debug)]
struct Coupled {
    inputs: [Channel; 2],
    outputs: [Channel; 2],
    parameters: Vec<Parameter>,
}

impl Coupled {
    fn new() -> Self {
        let parameter = |i: usize| Parameter::new(&format!("p{i}"), "1", "an entry", "any motion");
        let channel = |name| Channel::new(name, "1");
        Self {
            inputs: [channel("u1"), channel("u2")],
            outputs: [channel("x1"), channel("x2")],
            parameters: (1..9).map(parameter).collect(),
        }
    }
}

impl RegressorModel for Coupled {
    fn name(&self) -> &str {
        "coupled"
    }
    fn inputs(&self) -> &[Channel] {
        &self.inputs
    }
    fn outputs(&self) -> &[Channel] {
        &self.outputs
    }
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }
    fn regressor(&self, s: Sample<'_>, phi: &mut [f64], y: &mut [f64]) {
        phi.fill(0.0);
        phi[0..4].copy_from_slice(&[s.accelerations[0], s.accelerations[1], s.outputs[0], s.outputs[1]]);
        phi[12..16].copy_from_slice(&[s.accelerations[0], s.accelerations[1], s.outputs[0], s.outputs[1]]);
        y.copy_from_slice(s.inputs);
    }
}

/// θ whose apparent value is given: undoing the hold in a regression that fits perfectly.
fn invert(hold: &Hold, model: &dyn RegressorModel, apparent: &[f64]) -> Option<Vec<f64>> {
    let n = apparent.len();
    let map = ParameterMap::identity(model.parameters());
    let exact = |map: &ParameterMap| {
        let right = DVector::from_column_slice(apparent) - DVector::from_column_slice(&map.offset);
        let solved = DMatrix::from_row_slice(n, n, &map.matrix).lu().solve(&right);
        solved.map(|z| z.as_slice().to_vec()).ok_or_else(|| SolveError::Failed { reason: "singular".to_owned() })
    };
    hold.undo(&map, apparent, exact)
}

fn paired(pairing: Pairing) -> Settings {
    Settings { pairing, ..Settings::default() }
}

#[test]
fn the_hold_law_of_one_channel_is_the_closed_form() {
    let model = common::vw_pd();
    let (theta, period) = (common::KHEPERA, 0.02);
    let a = |th: f64, k: f64| (-period * k / th).exp();
    for (pairing, m) in [(Pairing::Same, 0.0), (Pairing::Mid, 0.5)] {
        let seen = Hold::new(&*model, &paired(pairing), period).unwrap().apparent(&theta).unwrap();
        let law = |th: f64, k: f64| k * period * (1.0 / (1.0 - a(th, k)) - m);
        assert!((seen[0] - law(theta[0], theta[3])).abs() < 1e-14);
        assert!((seen[1] - law(theta[1], theta[5])).abs() < 1e-14);
        assert_eq!(seen[2..], theta[2..]);
    }
    let mid = Hold::new(&*model, &paired(Pairing::Mid), period).unwrap();
    let seen = mid.apparent(&theta).unwrap();
    let back = invert(&mid, &*model, &seen).unwrap();
    let closed = theta[3] * period / (2.0 * (theta[3] * period / (2.0 * seen[0])).atanh());
    assert!((back[0] - theta[0]).abs() < 1e-13 && (closed - theta[0]).abs() < 1e-13);
    assert!(Hold::new(&*model, &paired(Pairing::Previous), period).is_none());
    let integral = Settings { form: Form::Integral, ..paired(Pairing::Same) };
    assert_eq!(Hold::new(&*model, &integral, period).unwrap().apparent(&theta), Some(seen));
}

#[test]
fn a_time_constant_below_what_sampling_shows_cannot_be_undone() {
    let model = common::vw_pd();
    let hold = Hold::new(&*model, &paired(Pairing::Mid), 0.3).unwrap();
    // theta4 Ts / 2 = 0.15: below it there is no time constant, just above it a tiny one.
    assert_eq!(invert(&hold, &*model, &[0.14, 0.4, 0.0, 1.0, 0.0, 1.0]), None);
    let tiny = invert(&hold, &*model, &[0.1501, 0.4, 0.0, 1.0, 0.0, 1.0]).unwrap();
    assert!(tiny[0] > 0.0 && tiny[0] < 0.05, "{tiny:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn the_hold_of_a_coupled_model_is_undone(off in prop::collection::vec(-0.1_f64..0.1, 4), period in 0.01_f64..0.3) {
        let model = Coupled::new();
        let hold = Hold::new(&model, &paired(Pairing::Mid), period).unwrap();
        let free = vec![0.3, off[0], 1.0, off[1], off[2], 0.2, off[3], 0.9];
        let back = invert(&hold, &model, &hold.apparent(&free).unwrap()).unwrap();
        for (a, b) in back.iter().zip(&free) {
            prop_assert!((a - b).abs() < 1e-11, "{:?} {:?}", back, free);
        }
    }
}

/// The law itself: one exact step of the sampled system, with the slope that makes the response constant. For a ramp
/// x_k = c k the exact input is u_k = K [(I − A)⁻¹ c + c k]; delayed by half a period it must equal M_app c/T_s + K x.
#[test]
fn the_hold_law_holds_for_a_sampled_ramp_of_a_coupled_model() {
    let model = Coupled::new();
    let period = 0.1;
    let free = [0.3, 0.05, 1.0, -0.1, 0.02, 0.2, 0.15, 0.9];
    let seen = Hold::new(&model, &paired(Pairing::Mid), period).unwrap().apparent(&free).unwrap();
    let mass = DMatrix::from_row_slice(2, 2, &[free[0], free[1], free[4], free[5]]);
    let stiffness = DMatrix::from_row_slice(2, 2, &[free[2], free[3], free[6], free[7]]);
    let a = (mass.try_inverse().unwrap() * &stiffness * -period).exp();
    let c = DVector::from_vec(vec![0.7, -0.4]);
    let lead = (DMatrix::identity(2, 2) - a).try_inverse().unwrap() * &c;
    let u = |k: f64| &stiffness * (&lead + &c * k);
    let middle = (u(4.0) + u(5.0)) * 0.5;
    let apparent_mass = DMatrix::from_row_slice(2, 2, &[seen[0], seen[1], seen[4], seen[5]]);
    let expected = apparent_mass * &c / period + stiffness * &c * 5.0;
    assert!((middle - expected).norm() < 1e-12);
}
