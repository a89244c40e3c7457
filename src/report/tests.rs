//! Pages as a whole: a good fit, a poor one over many stretches, a failure.

use wheelwright_core::channel::{Channel, OMEGA, OMEGA_REF, V, V_REF};
use wheelwright_core::identification::{Estimate, Identification};
use wheelwright_core::model::{Parameter, RegressorModel, Sample};
use wheelwright_core::solver::{RegressionRows, Solution, Status};
use wheelwright_core::validation::validate;
use wheelwright_core::{Dataset, Stretch};

use super::*;

/// The equations of `vw-pd`, written here so that pages are tested without the crate of models.
#[derive(Debug)]
struct Drive {
    inputs: [Channel; 2],
    outputs: [Channel; 2],
    parameters: Vec<Parameter>,
}

const THETA: [f64; 6] = [0.26, 0.22, -0.005, 0.999, -0.028, 1.014];

impl Drive {
    fn new() -> Self {
        let parameter = |name, unit, meaning| Parameter::new(name, unit, meaning, "changes of speed");
        let parameters = vec![
            parameter("theta1", "s", "Time constant of the forward motion: how slowly v follows v_ref."),
            parameter("theta2", "s", "Time constant of the turning motion: how slowly omega follows omega_ref."),
            parameter("theta3", "m s", "How much turning pushes the robot forward, from a centre of mass ahead of the axle."),
            parameter("theta4", "1", "Forward command needed for each m/s at constant speed."),
            parameter("theta5", "s/m", "How much driving forward resists turning, from a centre of mass ahead of the axle."),
            parameter("theta6", "1", "Turning command needed for each rad/s at constant speed."),
        ];
        Self { inputs: [V_REF, OMEGA_REF], outputs: [V, OMEGA], parameters }
    }
}

impl RegressorModel for Drive {
    fn name(&self) -> &str {
        "vw-pd"
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
        let ([v, omega], [v_dot, omega_dot]) = ([s.outputs[0], s.outputs[1]], [s.accelerations[0], s.accelerations[1]]);
        phi.copy_from_slice(&[v_dot, 0.0, -omega * omega, v, 0.0, 0.0, 0.0, omega_dot, 0.0, 0.0, v * omega, omega]);
        y.copy_from_slice(s.inputs);
    }
}

/// Reproducible noise of about unit size.
fn noise(seed: &mut u64) -> f64 {
    let mut uniform = || {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

/// One stretch driven by sines and steps, simulated with [`THETA`], with noise on top.
fn driven(model: &Drive, rows: usize, start: f64, noisy: f64) -> Stretch {
    let time: Vec<f64> = (0..rows).map(|i| start + 0.05 * i as f64).collect();
    let v_ref =
        time.iter().map(|t| 0.4 * (0.9 * t).sin() + 0.2 * (2.3 * t).sin() + if (t / 8.0) as i64 % 2 == 0 { 0.2 } else { -0.1 }).collect();
    let omega_ref = time.iter().map(|t| 0.9 * (0.7 * t).cos() + if (t / 5.0) as i64 % 3 == 0 { 0.6 } else { -0.3 }).collect();
    let zeros = vec![0.0; rows];
    let mut stretch = Stretch { label: "0".to_owned(), time, inputs: vec![v_ref, omega_ref], outputs: vec![zeros.clone(), zeros] };
    let mut run = vec![Vec::new(), Vec::new()];
    wheelwright_core::simulation::Simulator::new(model, &THETA).unwrap().run(&stretch, &[0.0, 0.0], &mut run).unwrap();
    let mut seed = 7;
    for column in &mut run {
        column.iter_mut().for_each(|x| *x += noisy * noise(&mut seed));
    }
    stretch.outputs = run;
    stretch
}

fn dataset(model: &Drive, stretches: Vec<Stretch>) -> Dataset {
    Dataset { inputs: model.inputs.to_vec(), outputs: model.outputs.to_vec(), stretches }
}

/// An identification with the given parameters and a regression from central differences.
fn identified(model: &Drive, theta: &[f64; 6], std: Option<&[f64; 6]>, data: &Dataset, share: f64) -> Identification {
    let (train, held_out) = data.hold_out(share);
    let mut rows = RegressionRows { phi: vec![Vec::new(); 2], y: vec![Vec::new(); 2], integrated: false };
    for s in &train.stretches {
        for i in 1..s.len() - 1 {
            let rate = |c: &Vec<f64>| (c[i + 1] - c[i - 1]) / (s.time[i + 1] - s.time[i - 1]);
            let (mut phi, mut y) = ([0.0; 12], [0.0; 2]);
            let [inputs, outputs] = [&s.inputs, &s.outputs].map(|c| [c[0][i], c[1][i]]);
            let accelerations = [rate(&s.outputs[0]), rate(&s.outputs[1])];
            model.regressor(Sample { inputs: &inputs, outputs: &outputs, accelerations: &accelerations }, &mut phi, &mut y);
            for e in 0..2 {
                rows.phi[e].extend(&phi[6 * e..6 * e + 6]);
                rows.y[e].push(y[e]);
            }
        }
    }
    let ci95 = std.map(|s| theta.iter().zip(s).map(|(t, s)| (t - 1.96 * s, t + 1.96 * s)).collect::<Vec<_>>());
    let solution = Solution {
        theta: theta.to_vec(),
        std: std.map(|s| s.to_vec()),
        ci95,
        covariance: None,
        status: Status::Solved,
        condition: 12.3,
        at_bound: if std.is_none() { vec![2] } else { Vec::new() },
        steps: vec!["Filtered every column and the response alike: Butterworth, order 4, 2 Hz, zero phase.".to_owned()],
        warnings: Vec::new(),
        regression: Some(rows),
    };
    let estimates = model.parameters.iter().enumerate().map(|(i, parameter)| Estimate {
        parameter: parameter.clone(),
        value: theta[i],
        std: std.map(|s| s[i]),
        ci95: solution.ci95.as_ref().map(|c| c[i]),
        at_bound: solution.at_bound.contains(&i),
    });
    Identification {
        model: "vw-pd".to_owned(),
        solver: if std.is_some() { "ols" } else { "box" }.to_owned(),
        estimates: estimates.collect(),
        train: validate(model, theta, &train).unwrap(),
        held_out: (!held_out.stretches.is_empty()).then(|| validate(model, theta, &held_out).unwrap()),
        solution,
    }
}

fn facts_of(path: &str, data: &Dataset) -> RecordingFacts {
    RecordingFacts {
        path: path.to_owned(),
        used_for: "identification".to_owned(),
        format: "csv".to_owned(),
        samples: data.samples(),
        segments: data.stretches.len(),
        duration_s: data.duration(),
        rate_hz: 20.0,
        sha256: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08".to_owned(),
        clock: ClockReport { source: "column".to_owned(), offset_s: Some(0.0123), jitter_s: Some((0.0004, 0.0021)) },
        warnings: vec!["1 gap(s) longer than 0.250 s, the longest 0.400 s at t = 12.300 s: treated as breaks between segments".to_owned()],
    }
}

/// Renders a page about `path`.
fn page(model: &Drive, path: &str, outcome: Outcome<'_>, data: &Dataset) -> String {
    let steps = ["Read 12000 rows in 26 segments.", "Held out 30 % of the samples before anything else."].map(str::to_owned);
    let facts = [("held out", "30 % of the samples"), ("seed", "0")].map(|(k, v)| (k.to_owned(), v.to_owned()));
    html(&ReportInput {
        title: path,
        subtitle: "identification of vw-pd",
        command: &format!("wheelwright identify {path} --model vw-pd --holdout 0.3"),
        version: "0.1.0",
        model,
        model_about: "velocity-controlled drive: PD loops on v and omega (Laut 2011, appendix A.3)",
        outcome,
        recordings: &[facts_of(path, data)],
        steps: &steps,
        evidence: &[],
        warnings: &[],
        facts: &facts,
    })
}

const STD: [f64; 6] = [0.0021, 0.0018, 0.0061, 0.0032, 0.0044, 0.0012];

fn good_page(path: &str) -> String {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 3000, 0.0, 0.008)]);
    page(&model, path, Outcome::Identified(&identified(&model, &THETA, Some(&STD), &data, 0.3)), &data)
}

fn failure_page() -> String {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 600, 0.0, 0.008), driven(&model, 600, 40.0, 0.008)]);
    let error = "the data cannot determine theta3, theta5: missing is turning while driving <fast>";
    page(&model, "straight.csv", Outcome::Failed { error, data: &data }, &data)
}

fn count(html: &str, what: &str) -> usize {
    html.matches(what).count()
}

#[test]
fn all_sections_in_order_held_out_first() {
    let html = good_page("drive.csv");
    let place = |what: &str| html.find(what).unwrap_or_else(|| panic!("no {what}"));
    let order = ["class=\"verdict\"", "class=\"warnings\"", "id=\"held-out\"", "id=\"training\"", "id=\"parameters\"", "id=\"regression\""];
    let order: Vec<usize> = order
        .into_iter()
        .chain(["id=\"spectra\"", "id=\"excitation\"", "id=\"data\"", "id=\"recordings\"", "id=\"repeat\""])
        .map(place)
        .collect();
    assert!(order.is_sorted(), "{order:?}");
    // 2 outputs × 2 parts of the data, 2 × (3 parameters + response), 2 spectra, 2 input spectra, 1 coverage.
    assert_eq!(count(&html, "<figure class=\"plot\">"), 17);
    assert!(html.contains("A close fit: in free run the model reproduces 9"), "the sentence");
    assert!(html.contains("data-label=\"95 % interval\"") && html.contains(">−0.0050</td>") && html.contains("could be zero"));
    for axis in ["v [m/s]", "omega [rad/s]", "dv/dt, own part [m/s²]", "v·omega, own part [(m/s)·(rad/s)]", "−omega², own part [(rad/s)²]"]
    {
        assert!(html.contains(axis), "no axis {axis}");
    }
    assert!(html.contains("density of v [(m/s)²/Hz]") && html.contains("wheelwright identify drive.csv --model vw-pd --holdout 0.3"));
}

#[test]
fn same_input_same_bytes_and_nothing_from_outside() {
    let html = good_page("drive.csv");
    assert_eq!(html, good_page("drive.csv"));
    for outside in ["http://", "https://", "src=", "@import", "url("] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert!(html.contains("default-src 'none'"));
}

#[test]
fn a_file_name_cannot_write_markup() {
    let html = good_page("</title><script>alert(1)</script>\"'.csv");
    assert!(!html.contains("<script>alert") && html.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
}

#[test]
fn a_failure_shows_the_error_and_the_data() {
    let html = failure_page();
    assert!(html.contains("No parameters were identified.") && html.contains("turning while driving &lt;fast&gt;"));
    // 2 outputs, 2 input spectra, 1 coverage.
    assert_eq!(count(&html, "<figure class=\"plot\">"), 5);
    assert!(!html.contains("id=\"parameters\"") && html.contains("id=\"measured\"") && html.contains("id=\"recordings\""));
}

#[test]
fn a_simulation_that_diverged_is_shown_as_far_as_it_went() {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 2000, 0.0, 0.0)]);
    let mut unstable = THETA;
    unstable[0] = -0.001;
    let html = page(&model, "a.csv", Outcome::Identified(&identified(&model, &unstable, None, &data, 0.3)), &data);
    assert!(html.contains("its simulation diverges") && html.contains("Free run on held-out data: model <code>vw-pd</code>"));
    assert!(html.contains("at its bound") && html.contains("states no uncertainty"));
    assert_eq!(count(&html, "<figure class=\"plot\">"), 17);
}

#[test]
fn a_wild_simulation_does_not_flatten_the_measurement() {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 2000, 0.0, 0.0)]);
    let growing = [-5.0, THETA[1], THETA[2], THETA[3], THETA[4], THETA[5]];
    let html = page(&model, "a.csv", Outcome::Identified(&identified(&model, &growing, None, &data, 0.3)), &data);
    assert!(html.contains("Beyond the axis, and cut off there: parts of simulated."));
    assert!(html.contains("does worse than a constant on v"));
    assert!(!good_page("drive.csv").contains("Beyond the axis"));
}

#[test]
fn long_recordings_stay_small_and_say_so() {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 24_000, 0.0, 0.01)]);
    let html = page(&model, "long.csv", Outcome::Identified(&identified(&model, &THETA, Some(&STD), &data, 0.3)), &data);
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
    assert!(html.contains("of 16\u{202f}800 samples, every minimum and maximum among them"));
}

#[test]
fn without_held_out_data_the_page_says_so() {
    let model = Drive::new();
    let data = dataset(&model, vec![driven(&model, 1000, 0.0, 0.01)]);
    let html = page(&model, "a.csv", Outcome::Identified(&identified(&model, &THETA, Some(&STD), &data, 0.0)), &data);
    assert!(html.contains("on the data it was fitted to (none was held out)") && !html.contains("id=\"held-out\""));
}

#[test]
fn terms_are_named_from_what_they_do() {
    let found = terms::equations(&Drive::new());
    let labels = |e: usize| found[e].columns.iter().map(|c| c.as_ref().map(|t| t.label.as_str())).collect::<Vec<_>>();
    assert_eq!(labels(0), [Some("dv/dt"), None, Some("−omega²"), Some("v"), None, None]);
    assert_eq!(labels(1), [None, Some("domega/dt"), None, None, Some("v·omega"), Some("omega")]);
    assert_eq!(found[1].response, terms::Term { label: "omega_ref".to_owned(), unit: Some("rad/s".to_owned()) });
    let mut integrated = found[0].clone();
    integrated.integrate();
    assert_eq!(integrated.columns[3], Some(terms::Term { label: "∫ v dt".to_owned(), unit: Some("(m/s)·s".to_owned()) }));
}

/// Reads one of the shared CSV recordings, a stretch a segment.
fn warthog(path: &std::path::Path, model: &Drive) -> Option<Dataset> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next()?.split(',').collect();
    let at = |name: &str| header.iter().position(|h| *h == name);
    let columns = [at("v_ref")?, at("omega_ref")?, at("v")?, at("omega")?];
    let (t, segment) = (at("t")?, at("segment")?);
    let mut stretches: Vec<Stretch> = Vec::new();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        if stretches.last().is_none_or(|s| s.label != cells[segment]) {
            let empty = vec![Vec::new(), Vec::new()];
            stretches.push(Stretch { label: cells[segment].to_owned(), time: Vec::new(), inputs: empty.clone(), outputs: empty });
        }
        let last = stretches.last_mut()?;
        last.time.push(cells[t].parse().ok()?);
        let [v_ref, omega_ref, v, omega] = columns.map(|c| cells[c].parse::<f64>().unwrap_or(0.0));
        for (target, value) in last.inputs.iter_mut().chain(&mut last.outputs).zip([v_ref, omega_ref, v, omega]) {
            target.push(value);
        }
    }
    Some(dataset(model, stretches))
}

#[test]
#[ignore = "writes pages to look at into the folder named by WHEELWRIGHT_PAGES"]
fn pages_to_look_at() {
    let folder = std::path::PathBuf::from(std::env::var_os("WHEELWRIGHT_PAGES").expect("WHEELWRIGHT_PAGES names a folder"));
    let shared = std::env::var("WHEELWRIGHT_SHARED").unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../shared").to_owned());
    std::fs::write(folder.join("good.html"), good_page("drive.csv")).unwrap();
    std::fs::write(folder.join("failure.html"), failure_page()).unwrap();
    let model = Drive::new();
    match warthog(&std::path::Path::new(&shared).join("recordings/warthog/asphalt.csv"), &model) {
        None => println!("skipped the page of a real recording: no shared folder"),
        Some(data) => {
            let theta = [0.45, 0.5, 0.0, 1.0, 0.0, 1.25];
            let found = identified(&model, &theta, None, &data, 0.3);
            std::fs::write(folder.join("warthog.html"), page(&model, "asphalt.csv", Outcome::Identified(&found), &data)).unwrap();
        }
    }
}
