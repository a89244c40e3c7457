//! What docs/models.md says is what the models do.

#![allow(clippy::unwrap_used)] // a failed step is a failed test

use wheelwright_core::config::tagged;
use wheelwright_core::conformance::check_model;
use wheelwright_core::model::ModelConfig;
use wheelwright_models::physics::INFLUENCES;

const DOCUMENT: &str = include_str!("../../docs/models.md");

#[test]
fn every_configuration_in_the_document_builds_a_conforming_model() {
    let blocks: Vec<&str> = DOCUMENT.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert_eq!(blocks.len(), 4);
    for block in blocks {
        let mut document: toml::Table = toml::from_str(block).unwrap();
        let Some(toml::Value::Table(table)) = document.remove("model") else { panic!("no [model] in {block}") };
        let config: Box<dyn ModelConfig> = tagged(table).unwrap();
        assert_eq!(check_model(&*config.build().unwrap()), Ok(()), "{block}");
    }
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
