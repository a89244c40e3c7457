//! Every registered model, in every variant a configuration can ask for, keeps the promises of the trait.

use wheelwright_core::config::{names, tagged};
use wheelwright_core::conformance::check_model;
use wheelwright_core::model::{ModelConfig, RegressorModel};
use wheelwright_models as _;

/// Tables that build each registered model.
const TABLES: &[&str] = &[
    "type = 'vw-pd'",
    "type = 'wheel-pd'",
    "type = 'wheel-pd'\nconstrained = true\ntrack_width = 0.089",
    "type = 'wheel-voltage'",
    "type = 'wheel-voltage'\nstatic_friction = false",
    "type = 'wheel-voltage'\nsymmetric = true",
    "type = 'wheel-voltage'\nsymmetric = true\nstatic_friction = false",
    "type = 'expression'\nname = 'drag'\ninputs = { u = 'N' }\noutputs = { v = 'm/s' }\nequations = ['u = mass*der(v) + drag*v*abs(v)']
    parameters = { mass = { unit = 'kg', min = 0 }, drag = { unit = 'kg/m' } }",
];

fn build(table: &str) -> Box<dyn RegressorModel> {
    let config: Box<dyn ModelConfig> = tagged(toml::from_str(table).unwrap()).unwrap();
    assert!(!config.about().is_empty());
    config.build().unwrap()
}

#[test]
fn every_registered_model_conforms() {
    for name in names::<Box<dyn ModelConfig>>() {
        let tables: Vec<_> = TABLES.iter().filter(|t| t.contains(&format!("type = '{name}'"))).collect();
        assert!(!tables.is_empty(), "no table builds `{name}`");
        for table in tables {
            assert_eq!(check_model(&*build(table)), Ok(()), "{table}");
        }
    }
}

#[test]
fn the_built_in_models_are_registered() {
    assert_eq!(names::<Box<dyn ModelConfig>>(), ["expression", "vw-pd", "wheel-pd", "wheel-voltage"]);
}
