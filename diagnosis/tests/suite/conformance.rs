//! Every effect of the library keeps the promises of its trait.

use wheelwright_core::conformance::check_effect;
use wheelwright_diagnosis::effects::{EncoderQuantisation, TimestampJitter, Wheel, WheelRadiusMismatch, library};

#[test]
fn every_effect_keeps_its_promises() {
    let mut all = library();
    // Settings that are for simulation only.
    all.push(Box::new(EncoderQuantisation { counts: true, ..EncoderQuantisation::default() }));
    all.push(Box::new(TimestampJitter { seed: Some(7) }));
    all.push(Box::new(WheelRadiusMismatch { wheel: Some(Wheel::Left), ..WheelRadiusMismatch::default() }));
    let broken: Vec<String> = all
        .iter()
        .filter_map(|effect| check_effect(&**effect).err().map(|violations| (effect, violations)))
        .flat_map(|(effect, violations)| violations.into_iter().map(move |v| format!("{effect:?}: {v}")))
        .collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn no_two_entries_of_the_library_are_the_same() {
    let all = library();
    let mut settings: Vec<String> = all.iter().map(|e| format!("{e:?}")).collect();
    settings.sort();
    let count = settings.len();
    settings.dedup();
    assert_eq!(settings.len(), count);
}
