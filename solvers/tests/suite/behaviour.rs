//! What each solver promises beyond its equation: maps, bounds, errors that name what is missing, stretches, stamps.

use crate::common::{KHEPERA, PIONEER, dataset, khepera_reference, pioneer_reference, record, sines, times, vw_pd};
use wheelwright_core::config::{names, tagged};
use wheelwright_core::model::{ModelConfig, ParameterMap, RegressorModel};
use wheelwright_core::regression::{Form, Settings, build, visit};
use wheelwright_core::signal::{Butterworth, Padding, ZeroPhase};
use wheelwright_core::simulation::Simulator;
use wheelwright_core::solver::{Problem, SolveError, Solver, Status};
use wheelwright_core::{Dataset, Stretch};
use wheelwright_models::{WheelPdConfig, WheelVoltageConfig};
use wheelwright_solvers::{BoundedSolver, Ols, SteadyState, Thesis};

fn solver(text: &str) -> Box<dyn Solver> {
    tagged(toml::from_str(text).unwrap()).unwrap()
}

fn pioneer() -> Dataset {
    record(PIONEER, times(0.1, 1501), pioneer_reference, 0.01)
}

fn khepera() -> Dataset {
    record(KHEPERA, times(0.02, 6001), khepera_reference, 0.005)
}

/// A map that fixes some parameters.
fn fixing(model: &dyn RegressorModel, values: &[(usize, f64)]) -> ParameterMap {
    let full = ParameterMap::identity(model.parameters());
    let kept: Vec<usize> = (0..full.free.len()).filter(|j| values.iter().all(|(i, _)| i != j)).collect();
    let p = full.offset.len();
    let mut offset = vec![0.0; p];
    values.iter().for_each(|(i, v)| offset[*i] = *v);
    let matrix = (0..p).flat_map(|i| kept.iter().map(move |&j| if i == j { 1.0 } else { 0.0 })).collect();
    ParameterMap { free: kept.iter().map(|&j| full.free[j].clone()).collect(), matrix, offset }
}

#[test]
fn all_four_are_registered_and_refuse_unknown_keys() {
    let registered = names::<Box<dyn Solver>>();
    for name in ["box", "ols", "steady-state", "thesis"] {
        assert!(registered.contains(&name.to_owned()), "{registered:?}");
        assert_eq!(solver(&format!("type = '{name}'")).name(), name);
        let wrong = tagged::<Box<dyn Solver>>(toml::from_str(&format!("type = '{name}'\ncutof = 1.0")).unwrap()).unwrap_err();
        assert!(wrong.to_string().contains("unknown field `cutof`"), "{wrong}");
    }
    let wrong = tagged::<Box<dyn Solver>>(toml::from_str("type = 'ols'\n[conditioning]\ncutof_hz = 1.0").unwrap()).unwrap_err();
    assert!(wrong.to_string().contains("did you mean `cutoff_hz`"), "{wrong}");
}

#[test]
fn settings_from_a_configuration_are_those_in_code() {
    let text = "type = 'ols'\nundo_hold = false\n[conditioning]\ncutoff_hz = 1.0\ntrim_s = 5.0\npairing = 'mid'\npadding = 'matlab'";
    let (model, data) = (vw_pd(), pioneer());
    let configured = solver(text).solve(&Problem::new(&*model, &data)).unwrap();
    let conditioning = Settings { cutoff_hz: Some(1.0), trim_s: Some(5.0), padding: Padding::Matlab, ..Settings::default() };
    let coded = Ols { conditioning, undo_hold: false }.solve(&Problem::new(&*model, &data)).unwrap();
    assert_eq!(configured.theta, coded.theta);
}

#[test]
fn fixed_parameters_stay_and_the_others_are_found() {
    let (model, data) = (vw_pd(), khepera());
    let mut problem = Problem::new(&*model, &data);
    problem.map = fixing(&*model, &[(2, KHEPERA[2]), (5, KHEPERA[5])]);
    for solver in ["type = 'ols'", "type = 'box'"] {
        let theta = solver_theta(solver, &problem);
        assert_eq!((theta[2], theta[5]), (KHEPERA[2], KHEPERA[5]));
        assert!((theta[0] / KHEPERA[0] - 1.0).abs() < 3e-3 && (theta[4] - KHEPERA[4]).abs() < 1e-3, "{theta:?}");
    }
    problem.map = fixing(&*model, &KHEPERA.iter().copied().enumerate().collect::<Vec<_>>());
    assert_eq!(solver_theta("type = 'ols'", &problem), KHEPERA);
    assert_eq!(solver_theta("type = 'box'", &problem), KHEPERA);
}

fn solver_theta(text: &str, problem: &Problem<'_>) -> Vec<f64> {
    solver(text).solve(problem).unwrap().theta
}

#[test]
fn equalities_of_a_model_are_kept() {
    let text = "type = 'wheel-pd'\nconstrained = true\ntrack_width = 0.34";
    let config: Result<Box<dyn ModelConfig>, _> = tagged(toml::from_str(text).unwrap());
    let model = config.unwrap().build().unwrap();
    assert_eq!(model.map().free.len(), 4, "the test needs the constrained model");
    let truth = [0.16, 0.18, -0.03 * 0.34 * 0.34 / 4.0, 1.02, -0.03, 1.02];
    let data = record(truth, times(0.1, 1501), pioneer_reference, 0.01);
    for solver in ["type = 'ols'", "type = 'box'", "type = 'ols'\n[conditioning]\nform = 'integral'"] {
        let theta = solver_theta(solver, &Problem::new(&*model, &data));
        assert_eq!(theta[3], theta[5]);
        assert!((theta[2] - 0.34 * 0.34 / 4.0 * theta[4]).abs() < 1e-12);
        for (found, expected) in theta.iter().zip(truth) {
            assert!((found - expected).abs() < 3e-3 * expected.abs().max(0.3), "{solver}: {theta:?}");
        }
    }
}

#[test]
fn motors_driven_by_voltage_are_found_too() {
    let model = WheelVoltageConfig { static_friction: false, ..WheelVoltageConfig::default() }.build().unwrap();
    let p = model.parameters().len();
    let truth: Vec<f64> =
        (0..p).map(|i| if model.parameters()[i].name.contains('V') { 2.2 + 0.1 * i as f64 } else { 0.4 + 0.05 * i as f64 }).collect();
    let time = times(0.02, 3001);
    let inputs: Vec<[f64; 2]> = time.iter().map(|&t| [1.5 * sines(t, 0.0), 1.5 * sines(t, 1.0)]).collect();
    let mut data = dataset(&*model, time, &inputs, &vec![[0.0; 2]; 3001]);
    data.stretches[0].outputs = Simulator::new(&*model, &truth).unwrap().run_measured(&data.stretches[0]).unwrap();
    for solver in ["type = 'ols'", "type = 'box'", "type = 'ols'\n[conditioning]\nform = 'integral'"] {
        let theta = solver_theta(solver, &Problem::new(&*model, &data));
        for (found, expected) in theta.iter().zip(&truth) {
            assert!((found / expected - 1.0).abs() < 2e-3, "{solver}: {theta:?} {truth:?}");
        }
    }
}

#[test]
fn what_a_drive_does_not_show_is_named_with_the_motion_that_would() {
    let model = vw_pd();
    let straight = record(PIONEER, times(0.1, 1501), |t| [pioneer_reference(t)[0], 0.0], 0.01);
    for name in ["ols", "box", "thesis"] {
        let error = solver(&format!("type = '{name}'")).solve(&Problem::new(&*model, &straight)).unwrap_err();
        let SolveError::NotIdentifiable { parameters, missing } = &error else { panic!("{error}") };
        assert_eq!(parameters, &["theta2", "theta3", "theta5", "theta6"], "{name}");
        let excitation = &model.parameters()[1].excitation;
        assert!(missing.contains(excitation.as_str()), "{missing}");
    }
    // omega constant: nothing shows theta2. With v constant as well, v omega and omega are one column.
    let mut steady = pioneer();
    steady.stretches[0].outputs[1].fill(0.5);
    let error = Ols::default().solve(&Problem::new(&*model, &steady)).unwrap_err();
    let SolveError::NotIdentifiable { parameters, .. } = &error else { panic!("{error}") };
    assert_eq!(parameters, &["theta2"]);
    steady.stretches[0].outputs[0].fill(0.3);
    let mut problem = Problem::new(&*model, &steady);
    problem.map = fixing(&*model, &[(0, 0.2), (1, 0.2), (2, 0.0)]);
    let error = Ols::default().solve(&problem).unwrap_err();
    let SolveError::NotIdentifiable { parameters, .. } = &error else { panic!("{error}") };
    assert_eq!(parameters, &["theta5", "theta6"]);
}

#[test]
fn collinear_columns_that_move_are_named_too() {
    let model = vw_pd();
    let mut data = pioneer();
    // omega = sqrt(v): omega^2 equals v.
    data.stretches[0].outputs[1] = data.stretches[0].outputs[0].iter().map(|v| v.abs().sqrt()).collect();
    let error = Ols::default().solve(&Problem::new(&*model, &data)).unwrap_err();
    let SolveError::NotIdentifiable { parameters, .. } = &error else { panic!("{error}") };
    assert_eq!(parameters, &["theta3", "theta4"]);
}

/// Cuts a data set into pieces of so many samples.
fn cut(data: &Dataset, samples: usize) -> Dataset {
    let whole = &data.stretches[0];
    let piece = |i: usize| Stretch { label: format!("piece {i}"), ..whole.slice(i * samples..((i + 1) * samples).min(whole.len())) };
    Dataset { stretches: (0..whole.len() / samples).map(piece).collect(), ..data.clone() }
}

#[test]
fn short_segments_serve_and_too_short_ones_are_left_out_with_a_warning() {
    let (model, data) = (vw_pd(), khepera());
    // Segments of 6 s: five seconds at both ends would leave nothing; the rule leaves about half.
    let solution = Ols::default().solve(&Problem::new(&*model, &cut(&data, 300))).unwrap();
    assert!((solution.theta[0] / KHEPERA[0] - 1.0).abs() < 0.02, "{:?}", solution.theta);
    assert!(solution.warnings.is_empty());
    let mut mixed = cut(&data, 300);
    mixed.stretches.push(Stretch { label: "stub".to_owned(), ..mixed.stretches[0].slice(0..40) });
    let solution = Ols::default().solve(&Problem::new(&*model, &mixed)).unwrap();
    assert!(solution.warnings[0].starts_with("1 of 21 stretch(es) shorter than"), "{:?}", solution.warnings);
    assert!(solution.warnings[0].contains("`stub`"));
    let error = solver("type = 'ols'\n[conditioning]\ntrim_s = 5.0").solve(&Problem::new(&*model, &cut(&data, 300))).unwrap_err();
    let SolveError::TooFewSamples { what, .. } = &error else { panic!("{error}") };
    assert_eq!(what, "filtering and dropping 5.00 s at both ends of 20 stretch(es)");
}

#[test]
fn nothing_passes_from_one_segment_to_another() {
    let (model, data) = (vw_pd(), khepera());
    let parts = cut(&data, 1000);
    let (before, _) = build(&*model, &parts, &Settings::default()).unwrap();
    let mut shaken = parts.clone();
    for i in [2, 4] {
        shaken.stretches[i].outputs[0].iter_mut().for_each(|v| *v = -*v);
    }
    let (after, _) = build(&*model, &shaken, &Settings::default()).unwrap();
    assert!(before[3] == after[3], "rows of a segment changed with its neighbours");
    assert!(before[2] != after[2]);
}

#[test]
fn a_long_stretch_worked_through_in_parts_gives_the_rows_of_the_whole() {
    let model = vw_pd();
    let n = 40_000;
    let time: Vec<f64> = (0..n).map(|k| 0.02 * k as f64).collect();
    let wave = |f: f64| time.iter().enumerate().map(|(k, t)| 0.5 + (f * t).sin() + 0.1 * ((k * k % 97) as f64)).collect::<Vec<f64>>();
    let stretch =
        Stretch { label: String::new(), inputs: vec![wave(1.0), wave(1.3)], outputs: vec![wave(1.1), wave(0.7)], time: time.clone() };
    let data = Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] };
    for settings in
        [Settings { order: 3, cutoff_hz: Some(0.3), ..Settings::default() }, Settings { form: Form::Integral, ..Settings::default() }]
    {
        let mut calls = 0;
        visit(&*model, &data, &settings, &mut |_| calls += 1).unwrap();
        assert!(calls > 2, "the test needs several parts");
        let (rows, preparation) = build(&*model, &data, &settings).unwrap();
        assert_eq!((rows.len(), rows[0].time.len()), (1, preparation.rows));
        assert!(rows[0].time.windows(2).all(|w| (w[1] - w[0] - 0.02).abs() < 1e-9));
        let (v, w) = (&data.stretches[0].outputs[0], &data.stretches[0].outputs[1]);
        let mut product: Vec<f64> = v.iter().zip(w).map(|(v, w)| v * w).collect();
        if settings.form == Form::Derivative {
            let filter = Butterworth::low_pass(3, 0.3, 1.0 / 0.02).unwrap();
            let trim = filter.settling();
            ZeroPhase::new(filter, Padding::Scipy).apply(&mut [&mut product]).unwrap();
            product = product[trim..n - trim].to_vec();
        } else {
            let interval = |k: usize| 0.5 * (product[k] + product[k + 1]) * (time[k + 1] - time[k]);
            product = (0..n - 10).map(|k| (k..k + 10).map(interval).sum()).collect();
        }
        // Of vw-pd, theta5 multiplies v omega in the second equation.
        let column = &rows[0].equations[1].columns[4];
        assert_eq!(column.len(), product.len());
        let worst = column.iter().zip(&product).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-11, "{worst:e}");
    }
}

#[test]
fn uneven_stamps_are_resampled_and_said_to_be() {
    let model = vw_pd();
    let mut t = 0.0;
    // Steps of 0.1 s, thirty per cent up or down.
    let time: Vec<f64> = (0..1500)
        .map(|k| {
            let now = t;
            t += 0.1 * (1.0 + 0.3 * ((k * k) as f64 * 0.7).sin());
            now
        })
        .collect();
    let data = record(PIONEER, time, pioneer_reference, 0.01);
    let solution = Ols::default().solve(&Problem::new(&*model, &data)).unwrap();
    assert!(solution.steps[0].starts_with("resampled 1 of 1 stretch(es) to an even grid"), "{:?}", solution.steps);
    assert!((solution.theta[0] / PIONEER[0] - 1.0).abs() < 0.03, "{:?}", solution.theta);
    let integral = Ols { conditioning: Settings { form: Form::Integral, ..Settings::default() }, undo_hold: true };
    let solution = integral.solve(&Problem::new(&*model, &data)).unwrap();
    assert!(!solution.steps[0].contains("resampled"), "the integral form needs no even grid");
    assert!((solution.theta[0] / PIONEER[0] - 1.0).abs() < 0.03, "{:?}", solution.theta);
}

#[test]
fn a_time_constant_below_the_sampling_period_is_warned_of() {
    let model = vw_pd();
    let fast = [0.01, 0.01, 0.0, 1.0, 0.0, 1.0];
    let data = record(fast, times(0.3, 801), pioneer_reference, 0.002);
    let mut noisy = data.clone();
    // Half a millisecond of lead is enough to cross the limit of 0.15 s.
    noisy.stretches[0].outputs.iter_mut().for_each(|x| {
        let before = x.clone();
        (1..x.len()).for_each(|k| x[k] = before[k] + 0.15 * (before[k] - before[k - 1]));
    });
    let solution = Ols::default().solve(&Problem::new(&*model, &noisy)).unwrap();
    assert!(solution.warnings.iter().any(|w| w.contains("theta1, theta2") && w.contains("0.3000 s")), "{:?}", solution.warnings);
}

#[test]
fn a_cut_off_above_nyquist_is_refused_with_both_numbers() {
    let (model, data) = (vw_pd(), pioneer());
    let error = solver("type = 'ols'\n[conditioning]\ncutoff_hz = 6.0").solve(&Problem::new(&*model, &data)).unwrap_err();
    assert!(error.to_string().contains("cut-off of 6 Hz") && error.to_string().contains("5.0000"), "{error}");
    let error = solver("type = 'ols'\n[conditioning]\ncutoff_hz = -1.0").solve(&Problem::new(&*model, &data)).unwrap_err();
    assert!(error.to_string().contains("`cutoff_hz`"), "{error}");
}

#[test]
fn bounds_hold_on_theta_after_the_hold_is_undone() {
    let (model, data) = (vw_pd(), khepera());
    let problem = Problem::new(&*model, &data);
    let free = Ols::default().solve(&problem).unwrap();
    let loose = solver("type = 'box'\n[bounds]\ntheta1 = [0.0, 1.0]").solve(&problem).unwrap();
    assert_eq!((loose.status, loose.at_bound.len()), (Status::Solved, 0));
    for (a, b) in loose.theta.iter().zip(&free.theta) {
        assert!((a - b).abs() < 1e-9, "{:?} {:?}", loose.theta, free.theta);
    }
    let tight = solver("type = 'box'\n[bounds]\ntheta1 = [0.0, 0.02]\ntheta5 = [0.0, 0.05]").solve(&problem).unwrap();
    assert_eq!((tight.theta[0], tight.theta[4]), (0.02, 0.05));
    assert_eq!((tight.status, &tight.at_bound[..]), (Status::SolvedAtBound, &[0, 4][..]));
    // The optimum within bounds is that with the active ones fixed: the sampling law included.
    let mut held = problem.clone();
    held.map = fixing(&*model, &[(0, 0.02), (4, 0.05)]);
    let held = solver("type = 'box'").solve(&held).unwrap();
    for (a, b) in tight.theta.iter().zip(&held.theta) {
        assert!((a - b).abs() < 1e-9, "{:?} {:?}", tight.theta, held.theta);
    }
}

#[test]
fn impossible_bounds_are_refused() {
    let (model, data) = (vw_pd(), khepera());
    let solve = |text: &str| solver(text).solve(&Problem::new(&*model, &data)).unwrap_err();
    let error = solve("type = 'box'\n[bounds]\ntheta5 = [0.2, 0.1]");
    assert_eq!(error, SolveError::EmptyBounds { parameter: "theta5".to_owned(), lower: 0.2, upper: 0.1 });
    let error = solve("type = 'box'\n[bounds]\ntheta7 = [0.0, 0.1]");
    assert!(error.to_string().contains("`bounds.theta7`") && error.to_string().contains("theta6"), "{error}");
}

/// Constant commands of five seconds each, with the outputs of a table after two seconds of settling.
fn table(rows: &[[f64; 4]]) -> Dataset {
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    for [v_ref, w_ref, v, w] in rows {
        for k in 0..50 {
            inputs.push([*v_ref, *w_ref]);
            let rise = 1.0 - (-f64::from(k) * 0.1 / 0.05).exp();
            outputs.push([v * rise, w * rise]);
        }
    }
    dataset(&*vw_pd(), times(0.1, inputs.len()), &inputs, &outputs)
}

fn straight_and_turning(v: [[f64; 2]; 3], w: [[f64; 2]; 3]) -> Dataset {
    let rows = v.iter().map(|[r, m]| [*r, 0.0, *m, 0.0]).chain(w.iter().map(|[r, m]| [0.0, *r, 0.0, *m]));
    table(&rows.collect::<Vec<_>>())
}

// Laut (2011), Tables 4.3 and 4.4.
#[test]
fn steady_state_reproduces_the_tables_of_the_thesis() {
    let given = "type = 'steady-state'\n[given]\ntheta1 = 0.2\ntheta2 = 0.2\ntheta3 = 0.0\ntheta5 = 0.0";
    let model = vw_pd();
    let cases = [
        ([[0.1, 0.1], [0.2, 0.1999], [0.3, 0.3001]], [[2.0, 1.9987], [4.0, 4.0004], [6.0, 5.999]], [0.9999, 1.0001]),
        ([[0.1, 0.0999], [0.2, 0.1999], [0.3, 0.2935]], [[2.0, 1.9987], [4.0, 3.9987], [6.0, 5.9207]], [1.0142, 1.0087]),
        ([[0.1, 0.0985], [0.3, 0.2927], [0.5, 0.4784]], [[0.5, 0.4771], [1.0, 0.9821], [1.5, 1.4597]], [1.0389, 1.0263]),
        ([[0.1, 0.0985], [0.3, 0.2917], [0.5, 0.4721]], [[0.5, 0.4840], [1.0, 0.9847], [1.5, 1.4756]], [1.0495, 1.0174]),
    ];
    for (v, w, expected) in cases {
        let solution = solver(given).solve(&Problem::new(&*model, &straight_and_turning(v, w))).unwrap();
        assert!((solution.theta[3] - expected[0]).abs() < 5.1e-5, "{:?}", solution.theta);
        assert!((solution.theta[5] - expected[1]).abs() < 5.1e-5, "{:?}", solution.theta);
        assert_eq!((solution.theta[0], solution.theta[2]), (0.2, 0.0));
        assert!(solution.steps[0].starts_with("estimated theta4, theta6 from 6 constant stretch(es)"), "{:?}", solution.steps);
    }
}

#[test]
fn steady_state_leaves_the_dynamics_to_least_squares() {
    let model = vw_pd();
    // Steps of five seconds, straight, on the spot and in curves.
    let levels = [[0.2, 0.0], [0.4, 0.0], [0.0, 0.8], [0.0, -1.2], [0.3, 0.9], [0.5, -0.7], [-0.3, 0.4], [0.2, 1.3]];
    let reference = |t: f64| levels[(t / 5.0 + 1e-9) as usize % levels.len()];
    let data = record(PIONEER, times(0.05, 1600), reference, 0.01);
    let solution = SteadyState::default().solve(&Problem::new(&*model, &data)).unwrap();
    for i in [2, 3, 4, 5] {
        assert!((solution.theta[i] - PIONEER[i]).abs() < 1e-4, "{:?}", solution.theta);
    }
    assert!(
        (solution.theta[0] / PIONEER[0] - 1.0).abs() < 0.02 && (solution.theta[1] / PIONEER[1] - 1.0).abs() < 0.02,
        "{:?}",
        solution.theta
    );
    assert_eq!(solution.steps.len(), 6, "{:?}", solution.steps);
}

#[test]
fn a_little_drift_while_driving_straight_does_not_make_a_parameter() {
    let model = vw_pd();
    let mut data = straight_and_turning([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3]], [[2.0, 2.0], [4.0, 4.0], [6.0, 6.0]]);
    for k in 0..150 {
        data.stretches[0].outputs[1][k] = 0.03 + 0.01 * f64::from(k as u32).sin();
    }
    let given = "type = 'steady-state'\n[given]\ntheta1 = 0.05\ntheta2 = 0.05\ntheta3 = 0.0";
    let solution = solver(given).solve(&Problem::new(&*model, &data)).unwrap();
    // v omega is only ever that drift, so theta5 is left to least squares.
    assert!(solution.steps[0].starts_with("estimated theta4, theta6 from 6 constant"), "{:?}", solution.steps);
    assert!((solution.theta[3] - 1.0).abs() < 1e-12 && (solution.theta[5] - 1.0).abs() < 1e-3, "{:?}", solution.theta);
}

#[test]
fn steady_state_says_what_it_lacks() {
    let (model, moving) = (vw_pd(), pioneer());
    let error = SteadyState::default().solve(&Problem::new(&*model, &moving)).unwrap_err();
    let SolveError::NotIdentifiable { parameters, missing } = &error else { panic!("{error}") };
    assert_eq!(parameters, &["theta3", "theta4", "theta5", "theta6"]);
    assert!(missing.starts_with("3 s or more of constant command"), "{missing}");
    let straight = table(&[[0.1, 0.0, 0.1, 0.0], [0.3, 0.0, 0.3, 0.0]]);
    let error = SteadyState::default().solve(&Problem::new(&*model, &straight)).unwrap_err();
    let SolveError::NotIdentifiable { parameters, missing } = &error else { panic!("{error}") };
    assert!(!parameters.contains(&"theta4".to_owned()) && missing.contains("`given`"), "{error}");
    let error = solver("type = 'steady-state'\n[given]\ntheta9 = 1.0").solve(&Problem::new(&*model, &moving)).unwrap_err();
    assert!(error.to_string().contains("`given.theta9`"), "{error}");
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let (model, data) = (vw_pd(), cut(&khepera(), 700));
    for solver in [&Ols::default() as &dyn Solver, &BoundedSolver::default(), &Thesis::default()] {
        let problem = Problem::new(&*model, &data);
        assert_eq!(solver.solve(&problem), solver.solve(&problem));
    }
    // One configuration type is named here so that it stays linked.
    let _ = WheelPdConfig::default();
}
