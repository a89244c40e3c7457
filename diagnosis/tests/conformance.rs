//! Every effect of the library keeps the promises of its trait, also at values that nobody would choose.

#![allow(clippy::unwrap_used)]

mod common;

use common::{THETA, data, model, scene};
use proptest::prelude::*;
use wheelwright_core::Effect;
use wheelwright_core::conformance::check_effect;
use wheelwright_core::effect::{EffectSimulator, Place};
use wheelwright_core::model::ModelError;
use wheelwright_diagnosis::effects::{EncoderQuantisation, TimestampJitter, Wheel, WheelRadiusMismatch, library};

#[test]
fn every_effect_keeps_its_promises() {
    let mut all = library();
    // Settings that are for simulation only.
    all.push(Box::new(EncoderQuantisation { counts: true }));
    all.push(Box::new(TimestampJitter { seed: Some(7) }));
    all.push(Box::new(WheelRadiusMismatch { wheel: Some(Wheel::Left) }));
    let broken: Vec<String> = all
        .iter()
        .filter_map(|effect| check_effect(&**effect).err().map(|violations| (effect, violations)))
        .flat_map(|(effect, violations)| violations.into_iter().map(move |v| format!("{effect:?}: {v}")))
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// The contract's list, but for what another library brings.
#[test]
fn no_two_entries_of_the_library_are_the_same() {
    let all = library();
    let mut settings: Vec<String> = all.iter().map(|e| format!("{e:?}")).collect();
    settings.sort();
    let count = settings.len();
    settings.dedup();
    assert_eq!(settings.len(), count);
}

#[test]
fn what_an_effect_is_confused_with_exists() {
    let all = library();
    let scene = scene();
    let theta = model().parameters().iter().map(|p| p.name.clone()).collect::<Vec<_>>();
    for effect in &all {
        for confusion in effect.confusions() {
            let known = all.iter().any(|e| e.name() == confusion.with) || theta.iter().any(|name| name == confusion.with);
            assert!(known || to_come(confusion.with), "{}: {}", effect.name(), confusion.with);
            assert_ne!(confusion.with, effect.name());
        }
        assert!(effect.stage().place() != Place::Measurement || effect.family() != "friction");
        assert!(!effect.parameters(&scene).is_empty());
    }
}

/// Names of the contract that the library does not have yet.
fn to_come(name: &str) -> bool {
    ["wheel_slip", "payload_change", "turning_scrub", "backlash", "slope", "lateral_com_offset", "castor_drag"].contains(&name)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Whatever the values within bounds, a run ends with finite numbers or says when it ran away.
    #[test]
    fn runs_end_well_at_any_values(shares in prop::collection::vec(0.0..1.0_f64, 8), which in 0..library().len()) {
        let (model, scene) = (model(), scene());
        let mut data = data(&*model);
        data.stretches[0].time.truncate(200);
        let stretch = &data.stretches[0];
        let effect = &library()[which];
        prop_assume!(effect.inapplicable(&scene).is_none());
        let end = |x: f64, scale: f64| if x.is_finite() { x } else { 1e3 * scale * x.signum() };
        let values: Vec<f64> = effect
            .parameters(&scene)
            .iter()
            .zip(&shares)
            .map(|(p, share)| end(p.bounds.0, p.scale) + share * (end(p.bounds.1, p.scale) - end(p.bounds.0, p.scale)))
            .collect();
        let effects: [&dyn Effect; 1] = [&**effect];
        let mut simulator = EffectSimulator::new(&*model, &THETA, &effects, &scene).unwrap();
        simulator.set(&THETA, &values).unwrap();
        simulator.set_substeps(2);
        let mut run = vec![Vec::new(); 2];
        match simulator.run(0, stretch, &[0.3, 0.2], &mut run) {
            Ok(()) => prop_assert!(run.iter().flatten().all(|x| x.is_finite())),
            Err(error) => prop_assert!(matches!(error, ModelError::Diverged { .. }), "{}", error),
        }
    }
}
