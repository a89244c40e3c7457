//! The page of a hand-made diagnosis of each verdict.

use serde_json::json;
use wheelwright_core::effect::{Effect, Place, Scene};
use wheelwright_core::simulation::Readout;
use wheelwright_core::validation::{validate, validate_with_effects};
use wheelwright_core::{Dataset, ModelConfig, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::CoulombFriction;
use wheelwright_diagnosis::finding::*;
use wheelwright_models::VwPdConfig;

use super::*;

const THETA: [f64; 6] = [0.26, 0.19, -0.01, 1.02, 0.05, 1.05];
const ALONE: [f64; 6] = [0.30, 0.22, -0.01, 1.12, 0.06, 1.15];
const FRICTION: [f64; 2] = [0.03, 1.0];

pub(crate) fn model() -> Box<dyn RegressorModel> {
    VwPdConfig::default().build().unwrap()
}

/// Steps through standstill and backwards, at the outputs a model with friction makes of them.
fn data(model: &dyn RegressorModel, start: f64, rows: usize) -> Dataset {
    let time: Vec<f64> = (0..rows).map(|k| start + 0.05 * k as f64).collect();
    let v: Vec<f64> = time.iter().map(|t| 0.3 * (0.5 * t).sin() + 0.1 * (1.7 * t).cos().signum()).collect();
    let w: Vec<f64> = time.iter().map(|t| 0.6 * (0.9 * t).sin()).collect();
    let stretch = Stretch { label: "1".to_owned(), outputs: vec![v.clone(), w.clone()], inputs: vec![v, w], time };
    Dataset { inputs: model.inputs().to_vec(), outputs: model.outputs().to_vec(), stretches: vec![stretch] }
}

fn replay(model: &dyn RegressorModel, mut measured: Dataset, named: bool) -> (Replay, Scene) {
    let scene = Scene::new(&measured, model, 0.34, Some(0.0975), None);
    let friction: [&dyn Effect; 1] = [&CoulombFriction::default()];
    let truth = validate_with_effects(model, &THETA, &friction, &FRICTION, (&scene, Readout::Instantaneous), &measured).unwrap();
    // A little noise, from a generator that needs no crate.
    let mut seed = 12345_u64;
    let mut noise = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.004 * ((seed >> 33) as f64 / f64::from(1_u32 << 30) - 1.0)
    };
    for (stretch, comparison) in measured.stretches.iter_mut().zip(&truth.comparisons) {
        stretch.outputs = comparison.simulated.iter().map(|c| c.iter().map(|y| y + noise()).collect()).collect();
    }
    let before = validate(model, &ALONE, &measured).unwrap();
    let after = validate_with_effects(model, &THETA, &friction, &FRICTION, (&scene, Readout::Instantaneous), &measured).unwrap();
    let runs = |v: &wheelwright_core::validation::Validation| v.comparisons.iter().map(|c| c.simulated.clone()).collect::<Vec<_>>();
    let (before, after) = (runs(&before), runs(&after));
    let after = if named { after } else { before.clone() };
    (Replay { measured, before, after }, scene)
}

/// A diagnosis as it may come, of each verdict.
pub(crate) fn example(verdict: Verdict) -> Diagnosis {
    let model = model();
    let named = matches!(verdict, Verdict::Explained | Verdict::Ambiguous);
    let (training, scene) = replay(&*model, data(&*model, 0.0, 1600), named);
    let (held_out, _) = replay(&*model, data(&*model, 80.0, 800), named);
    let parameter = |name: &str, value: f64, half: f64, unit: &str| FoundParameter {
        name: name.to_owned(),
        value,
        ci95: Some((value - half, value + half)),
        unit: unit.to_owned(),
        label: None,
    };
    let alternatives = vec![Alternative {
        name: "dead_zone".to_owned(),
        gap: 3.2,
        because: "a subtracting dead zone differs from friction only in its phase at reversals".to_owned(),
        always: false,
        open: true,
    }];
    let finding = Finding {
        name: "coulomb_friction".to_owned(),
        place: Place::Dynamics,
        statement: "dry friction uses up 0.0300 m/s (0.0291 to 0.0309) of each wheel's commanded speed; the model had none".to_owned(),
        parameters: vec![parameter("friction", 0.03, 0.0009, "m/s"), parameter("turning_ratio", 1.0, 0.08, "1")],
        values: FRICTION.to_vec(),
        settings: json!({ "type": "coulomb_friction" }),
        delta_bic: 812.4,
        holdout_gain: Some(3.9),
        alternatives: if verdict == Verdict::Ambiguous { alternatives } else { Vec::new() },
    };
    let (before, after) = (vec![91.2, 93.4], if named { vec![98.1, 98.6] } else { vec![91.2, 93.4] });
    let next = Experiment {
        statement: "drive slowly through standstill in both directions for 6 s".to_owned(),
        time: vec![0.0, 1.0, 2.0, 4.0],
        commands: vec![("v_ref".to_owned(), vec![0.1, -0.1, 0.3, 0.0]), ("omega_ref".to_owned(), vec![0.0, 0.5, -0.5, 0.0])],
        separates: vec![("coulomb_friction".to_owned(), "dead_zone".to_owned(), 84.0)],
    };
    let base = model.parameters().iter().zip(ALONE).zip(THETA).map(|((p, before), after)| BaseParameter {
        name: p.name.clone(),
        unit: p.unit.clone(),
        before,
        after,
        ci95: Some((after - 0.01, after + 0.01)),
    });
    let location = Location {
        channels: vec![("v".to_owned(), 0.7), ("omega".to_owned(), 0.3)],
        wheels: Some((0.5, 0.5)),
        times: vec![(12.0, 15.5)],
        changes: vec![ChangePoint { time: 40.0, interval: (39.0, 41.5), words: "the misfit grows".to_owned() }],
        regions: vec![Region { of: "v".to_owned(), from: -0.05, to: 0.05, share: 0.6, expected: 0.2, words: "near standstill".to_owned() }],
        frequencies_hz: vec![(0.0, 0.5)],
        statement: "60 % of the error beyond noise falls in the 20 % of the samples near standstill".to_owned(),
        tests: vec!["commands predict the error at chance 1e-12".to_owned()],
    };
    let headline = match verdict {
        Verdict::NoMismatch => "Nothing beyond noise: the model reproduces this recording as well as its noise allows.",
        Verdict::Explained => {
            "Dry friction is missing from the simulation: with it the held-out fit goes from 91 to 98 %, all that noise allows."
        }
        Verdict::Ambiguous => "Friction or a dead zone is missing; this recording cannot tell which.",
        Verdict::Unexplained => "Something is missing that no effect of the library explains, near standstill.",
    };
    let mismatch = verdict != Verdict::NoMismatch;
    Diagnosis {
        verdict,
        headline: headline.to_owned(),
        effects: if named { vec![finding.clone()] } else { Vec::new() },
        partial: if verdict == Verdict::Unexplained { vec![finding] } else { Vec::new() },
        location: if mismatch { location } else { Location::default() },
        waterfall: vec![
            Rung { effects: Vec::new(), fit: before.clone() },
            Rung { effects: vec!["coulomb_friction".to_owned()], fit: after.clone() },
        ]
        .into_iter()
        .filter(|r| named || r.effects.is_empty())
        .collect(),
        fit: Fits { before, after, noise_ceiling: Some(vec![98.2, 98.7]), narx: Some(vec![95.0, 96.0]) },
        next_experiment: (verdict == Verdict::Ambiguous).then_some(next),
        untestable: vec![Untestable {
            name: "velocity_saturation".to_owned(),
            because: "no command went beyond 0.4 m/s: a limit below that would have been seen".to_owned(),
        }],
        base: base.collect(),
        scene,
        readout: Readout::Instantaneous,
        noise: vec![0.0023, 0.0023],
        training,
        held_out: Some(held_out),
        ranking: vec![("coulomb_friction".to_owned(), 812.4), ("dead_zone".to_owned(), 780.0), ("slope".to_owned(), -9.0)],
        warnings: vec!["the track width is a guess".to_owned()],
    }
}

fn page(found: &Diagnosis) -> String {
    html(&Input {
        title: "drive.csv",
        command: "wheelwright diagnose drive.csv",
        version: "0.0.0",
        model: "vw-pd",
        found,
        comparison: None,
        recordings: &[],
        warnings: &[],
        facts: &[],
    })
}

#[test]
fn each_verdict_has_its_badge_its_sentence_and_what_belongs_to_it() {
    for (verdict, badge, has, lacks) in [
        (Verdict::NoMismatch, "nothing beyond noise", "id=\"untestable\"", "id=\"effects\""),
        (Verdict::Explained, "badge named", "+ coulomb_friction", "id=\"next\""),
        (Verdict::Ambiguous, "badge open", "next_experiment.csv", "badge bad"),
        (Verdict::Unexplained, "badge bad", "A part of it looks like this", "id=\"next\""),
    ] {
        let found = example(verdict);
        let page = page(&found);
        assert!(page.contains(badge) && page.contains(has) && !page.contains(lacks), "{verdict:?}");
        assert!(page.contains(&found.headline.replace('\'', "&#39;")));
        assert!(!page.contains("NaN") && !page.contains("inf "));
        if let Some(folder) = std::env::var_os("WHEELWRIGHT_PAGES") {
            std::fs::write(std::path::Path::new(&folder).join(format!("{verdict:?}.html")), &page).unwrap();
        }
    }
}

#[test]
fn the_worst_window_is_where_the_error_is() {
    let mut found = example(Verdict::Unexplained);
    let replay = found.held_out.as_mut().unwrap();
    replay.before = vec![replay.measured.stretches[0].outputs.clone()];
    for k in 500..520 {
        replay.before[0][1][k] += 0.5;
    }
    let window = pictures::worst(replay, &replay.before, &found.noise).unwrap();
    assert!(window.rows.contains(&500) && window.rows.contains(&519) && window.output == 1, "{window:?}");
    let seconds = 0.05 * window.rows.len() as f64;
    assert!((10.0..=20.0).contains(&seconds), "{seconds} s");
}
