//! What docs/models.md and the example say is what the models do.

use wheelwright_core::Stretch;
use wheelwright_core::channel::{OMEGA_REF, V_REF};
use wheelwright_core::config::tagged;
use wheelwright_core::conformance::check_model;
use wheelwright_core::excitation::Excitation;
use wheelwright_core::excitation::thesis::ThesisPioneer;
use wheelwright_core::model::{ModelConfig, RegressorModel};
use wheelwright_core::simulation::Simulator;
use wheelwright_models::VwPdConfig;
use wheelwright_models::physics::INFLUENCES;

const DOCUMENT: &str = include_str!("../../../docs/models.md");

#[test]
fn every_configuration_in_the_document_builds_a_conforming_model() {
    let blocks: Vec<&str> = DOCUMENT.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert_eq!(blocks.len(), 4);
    for block in blocks {
        assert_eq!(check_model(&*model_of(block)), Ok(()), "{block}");
    }
}

#[test]
fn the_example_without_drag_runs_as_the_built_in_model() {
    let example = model_of(include_str!("../../../examples/model_in_toml.toml"));
    assert_eq!(check_model(&*example), Ok(()));
    let theta = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768];
    let run = |model: &dyn RegressorModel, theta: &[f64]| Simulator::new(model, theta).unwrap().run_measured(&thesis_run()).unwrap();
    let built_in = run(&*VwPdConfig::default().build().unwrap(), &theta);
    let written = run(&*example, &[&theta[..], &[0.0]].concat());
    for (a, b) in built_in.iter().flatten().zip(written.iter().flatten()) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    // With drag it is another robot: slower by what the term says, some percent of 0.4 m/s.
    let slowed = run(&*example, &[&theta[..], &[0.1]].concat());
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    assert!((0.01..0.05).contains(&(mean(&built_in[0]) - mean(&slowed[0]))), "{} {}", mean(&built_in[0]), mean(&slowed[0]));
}

fn model_of(document: &str) -> Box<dyn RegressorModel> {
    let mut document: toml::Table = toml::from_str(document).unwrap();
    let Some(toml::Value::Table(table)) = document.remove("model") else { unreachable!("no [model] in {document}") };
    let config: Box<dyn ModelConfig> = tagged(table).unwrap();
    config.build().unwrap()
}

/// The commands that drove the Pioneer, every 0.1 s, from rest.
fn thesis_run() -> Stretch {
    let time: Vec<f64> = (0..1500).map(|k| f64::from(k) * 0.1).collect();
    let mut inputs = vec![Vec::new(); 2];
    for t in &time {
        let mut command = [0.0; 2];
        ThesisPioneer::default().command(*t, &[V_REF, OMEGA_REF], &mut command);
        inputs.iter_mut().zip(command).for_each(|(column, value)| column.push(value));
    }
    Stretch { label: "0".to_owned(), outputs: vec![vec![0.0; time.len()]; 2], inputs, time }
}

#[test]
fn the_table_of_constants_is_that_of_the_library() {
    let thetas = |names: &[&str]| match names {
        [] => "–".to_owned(),
        names => names.iter().map(|n| n.replace("theta", "θ")).collect::<Vec<_>>().join(" "),
    };
    for i in INFLUENCES {
        let row = format!("| `{}` | {} | {} | {} | {} | {} |", i.key, i.symbol, i.unit, thetas(i.wheel_pd), thetas(i.vw_pd), i.does);
        assert!(DOCUMENT.contains(&row), "not in docs/models.md: {row}");
    }
}
