//! What every effect of the library owes, whichever it is.

use std::collections::BTreeSet;

use crate::rig::{HALF_TRACK, Rig, body, sides};
use proptest::prelude::*;
use wheelwright_core::effect::{
    Direction, Effect, EffectParameter, EffectSimulator, Estimate, Instant, Motion, Place, Scene, Stage, Start,
};
use wheelwright_core::model::ModelError;
use wheelwright_core::simulation::Readout;
use wheelwright_diagnosis::effects::{
    ActuatorLag, Backlash, CastorDrag, CastorKind, CoulombFriction, CoulombFrictionOneWheel, FrictionLaw, StribeckFriction, Wheel, library,
};

/// The names of the contract (section 5).
const NAMES: [&str; 29] = [
    "coulomb_friction",
    "coulomb_friction_one_wheel",
    "stribeck_friction",
    "rolling_resistance",
    "viscous_asymmetry",
    "direction_asymmetry",
    "quadratic_drag",
    "dead_zone",
    "velocity_saturation",
    "slew_limit",
    "torque_saturation",
    "command_delay",
    "actuator_lag",
    "integral_action",
    "gain_asymmetry",
    "wheel_radius_mismatch",
    "track_width_error",
    "lateral_com_offset",
    "wheel_slip",
    "turning_scrub",
    "castor_drag",
    "slope",
    "payload_change",
    "battery_sag",
    "backlash",
    "wheel_eccentricity",
    "encoder_quantisation",
    "timestamp_jitter",
    "sensor_delay",
];

/// Effects of the library that can act on a scene.
fn able(scene: &Scene) -> Vec<Box<dyn Effect>> {
    library().into_iter().filter(|e| e.inapplicable(scene).is_none()).collect()
}

/// A value at a share of the way through a parameter's bounds; infinite bounds count as a thousand times its scale.
fn within(p: &EffectParameter, share: f64) -> f64 {
    let far = 1e3 * p.scale;
    let (low, high) = (p.bounds.0.max(-far), p.bounds.1.min(far));
    low + share * (high - low)
}

#[test]
fn neutral_values_give_the_base_run() {
    for rig in [body(), sides()] {
        let (scene, plain) = (rig.scene(), rig.run(&[], &[]));
        for effect in library() {
            if effect.inapplicable(&scene).is_some() {
                continue;
            }
            let parameters = effect.parameters(&scene);
            let sizes = Start { values: parameters.iter().map(|p| p.scale).collect(), columns: Vec::new(), linear: false };
            for start in effect.starts(&scene).into_iter().chain([sizes]) {
                let values: Vec<f64> = parameters.iter().zip(&start.values).map(|(p, v)| p.neutral.unwrap_or(*v)).collect();
                if parameters.iter().all(|p| p.neutral.is_none()) {
                    continue;
                }
                let run = rig.run(&[&*effect], &values);
                let worst = run.iter().flatten().zip(plain.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst < 1e-9, "{} at {values:?}: {worst}", effect.name());
            }
        }
    }
}

/// A lag shorter than any step of the simulation came a step late, and that had evidence; a resonance above half the sampling rate is none.
#[test]
fn a_lag_too_short_to_be_one_gives_the_base_run() {
    for rig in [body(), sides()] {
        let (period, plain) = (rig.scene().scales.period, rig.run(&[], &[]));
        for (resonant, values) in [(false, vec![1e-9 * period]), (true, vec![1e-9 * period, 0.2]), (true, vec![0.3 * period, 0.2])] {
            let run = rig.run(&[&ActuatorLag { resonant, ..ActuatorLag::default() }], &values);
            assert!(run.iter().flatten().zip(plain.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-9), "{values:?}");
        }
    }
}

/// What calls itself by a narrower name is that: the same run, and only where a part of it does nothing.
#[test]
fn an_effect_part_of_which_does_nothing_is_the_narrower_one() {
    let (rig, scene) = (body(), body().scene());
    let each = CoulombFrictionOneWheel { wheel: None };
    let left = CoulombFrictionOneWheel { wheel: Some(Wheel::Left) };
    let (rise, plain) = (StribeckFriction::default(), CoulombFriction::default());
    let check = |wide: &dyn Effect, [idle, active]: [&[f64]; 2], narrow: &dyn Effect, values: &[f64]| {
        assert_eq!((wide.narrower(idle, &scene), wide.narrower(active, &scene)), (Some(narrow.name()), None));
        let (wide, narrow) = (rig.run(&[wide], idle), rig.run(&[narrow], values));
        assert!(wide.iter().flatten().zip(narrow.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-9));
    };
    check(&each, [&[0.03, 0.0, 1.2], &[0.03, 0.001, 1.2]], &left, &[0.03, 1.2]);
    check(&rise, [&[0.03, 0.0, 0.05, 1.2], &[0.03, 0.001, 0.05, 1.2]], &plain, &[0.03, 1.2]);
}

/// What is told by another name has its parameters and its motion, whatever the values.
#[test]
fn an_effect_that_is_told_as_another_one_is_that() {
    let each = CoulombFrictionOneWheel { wheel: None };
    let told = [[0.02, 0.04, 1.2], [0.021, 0.04, 1.2], [0.0, 0.04, 1.2], [0.04, 0.04, 1.2]].map(|values| each.told_as(&values));
    assert_eq!(told, [None, Some("coulomb_friction"), None, Some("coulomb_friction")]);
    assert_eq!(CoulombFrictionOneWheel { wheel: Some(Wheel::Left) }.told_as(&[0.02, 1.2]), None);
    for rig in [body(), sides()] {
        let scene = rig.scene();
        let parameters = each.parameters(&scene);
        let all = library();
        let same = |e: &&dyn Effect| e.name() == "coulomb_friction" && e.parameters(&scene) == parameters;
        let sided = all.iter().map(|e| &**e).find(same).unwrap();
        let values = [0.03, 0.02, 1.2];
        assert_eq!(rig.run(&[&each], &values[..parameters.len()]), rig.run(&[sided], &values[..parameters.len()]));
    }
}

#[test]
fn names_are_of_the_contract() {
    let names: BTreeSet<String> = library().iter().map(|e| e.name().to_owned()).collect();
    for effect in library() {
        // A constant offset is no hidden physics of the contract, but the rival of many.
        let known = NAMES.contains(&effect.name()) || effect.name() == "command_offset";
        assert!(known, "{} is no name of the contract", effect.name());
        for confusion in effect.confusions() {
            let theta = confusion.with.strip_prefix("theta").is_some_and(|n| n.parse::<u8>().is_ok());
            let named = names.contains(confusion.with) || NAMES.contains(&confusion.with) || theta;
            assert!(named, "{} is confused with {}, which is nothing", effect.name(), confusion.with);
            assert!(confusion.with != effect.name());
            assert!(confusion.because.len() > 20 && !confusion.because.ends_with('.'), "{}", confusion.because);
        }
    }
}

#[test]
fn parameters_and_starts_fit_together() {
    for rig in [body(), sides()] {
        let scene = rig.scene();
        for effect in able(&scene) {
            let (parameters, starts) = (effect.parameters(&scene), effect.starts(&scene));
            // What only adds scatter is found by tests of what is left over, not by fits; what only gives another effect its name, not at all.
            let scales: Vec<f64> = parameters.iter().map(|p| p.scale).collect();
            let told = |other: &dyn Effect| other.told_as(&scales) == Some(effect.name()) && other.parameters(&scene) == parameters;
            let fitted = effect.stage().place() != Place::Measurement && !library().iter().any(|other| told(&**other));
            assert!(!parameters.is_empty() && (!fitted || !starts.is_empty()), "{}", effect.name());
            for p in &parameters {
                assert!(p.scale > 0.0 && p.bounds.0 < p.bounds.1, "{}: {p:?}", effect.name());
                assert!(p.neutral.is_none_or(|n| n.is_infinite() || (p.bounds.0 <= n && n <= p.bounds.1)), "{}: {p:?}", effect.name());
                assert!(!p.unit.is_empty() && !p.name.is_empty());
            }
            for start in &starts {
                assert_eq!(start.values.len(), parameters.len(), "{}", effect.name());
                for (value, p) in start.values.iter().zip(&parameters) {
                    assert!(p.bounds.0 <= *value && *value <= p.bounds.1, "{}: start {value} of {p:?}", effect.name());
                }
                let columns: Vec<usize> = start.columns.iter().flatten().copied().collect();
                assert!(!columns.is_empty() && columns.iter().all(|i| *i < parameters.len()), "{}", effect.name());
            }
        }
    }
}

#[test]
fn sentences_are_sentences() {
    for rig in [body(), sides()] {
        let scene = rig.scene();
        for effect in able(&scene) {
            let sizes = || effect.parameters(&scene).iter().map(|p| p.scale).collect();
            let start = &effect.starts(&scene).first().map_or_else(sizes, |s| s.values.clone());
            for sign in [1.0, -1.0] {
                let estimate = |(p, value): (&EffectParameter, &f64)| {
                    let value = if sign * value < p.bounds.0 { *value } else { sign * value };
                    Estimate { value, ci95: Some((value - 0.1 * p.scale, value + 0.1 * p.scale)) }
                };
                let values: Vec<Estimate> = effect.parameters(&scene).iter().zip(start).map(estimate).collect();
                let says = effect.statement(&values, &scene);
                println!("{}: {says}", effect.name());
                assert!(says.chars().any(|c| c.is_ascii_digit()), "{says}");
                assert!(!says.contains("NaN") && !says.contains("inf") && !says.contains("  ") && !says.ends_with('.'), "{says}");
                assert!(says.contains("the model"), "{says}");
            }
            assert!(effect.about().len() > 10 && effect.excitation().len() > 10);
        }
    }
}

#[test]
fn effects_are_plain_data() {
    for effect in library() {
        let json = serde_json::to_value(&effect).unwrap();
        let back: Box<dyn Effect> = serde_json::from_value(json.clone()).unwrap();
        assert_eq!(format!("{effect:?}"), format!("{back:?}"));
        assert_eq!(json, serde_json::to_value(&back).unwrap());
    }
}

/// Friction in all its forms takes energy and gives none: load against motion, weighted as forces and moments are.
#[test]
fn friction_never_drives() {
    let passive = [
        "coulomb_friction",
        "coulomb_friction_one_wheel",
        "stribeck_friction",
        "rolling_resistance",
        "direction_asymmetry",
        "quadratic_drag",
        "turning_scrub",
        "castor_drag",
    ];
    for rig in [body(), sides()] {
        let scene = rig.scene();
        let at = Instant::of_sample(rig.stretch(), 0, &scene.tracks[0], &scene, Readout::default());
        let effects = able(&scene);
        // What holds a robot straight answers what turns it, and not the turning alone.
        for effect in effects.iter().filter(|e| passive.contains(&e.name()) && e.stage() < Stage::Contact) {
            let parameters = effect.parameters(&scene);
            // What bends gives back what it has stored, and takes while it slides.
            let bends = parameters.iter().any(|p| p.name == "presliding");
            let mut lost: f64 = 0.0;
            for i in 0..2000_u32 {
                let share = |j: u32| f64::from((i * 7919 + j * 104_729) % 1009) / 1009.0;
                let p: Vec<f64> = parameters.iter().enumerate().map(|(j, p)| within(p, share(j as u32))).collect();
                let outputs = [4.0 * share(11) - 2.0, 4.0 * share(12) - 2.0];
                let mut state = vec![0.0; effect.states(&scene)];
                let before = if bends { outputs } else { [4.0 * share(13) - 2.0, 4.0 * share(14) - 2.0] };
                effect.begin(&p, &at, &[0.0; 2], &before, &mut state);
                let mut load = [0.0; 2];
                effect.load(&p, &at, &outputs, &state, &mut load);
                let (inertia, held) = ([0.26, 0.0, 0.0, 0.19], [0.0; 2]);
                let motion = Motion { u: &held, outputs: &outputs, inertia: &inertia, drag: &inertia, held: &held };
                let mut drive = [0.0; 2];
                effect.drive(&p, &at, &motion, &state, &mut drive);
                load.iter_mut().zip(drive).for_each(|(load, drive)| *load -= drive);
                let ratio = parameters.iter().position(|p| p.name == "turning_ratio").map_or(1.0, |j| p[j]);
                let (force, motion) = (scene.frame.body(&load), scene.frame.body(&outputs));
                let power = force[0] * motion[0] + HALF_TRACK * HALF_TRACK / ratio * force[1] * motion[1];
                assert!(power >= -1e-9 * force[0].hypot(force[1]), "{} gives {power} at {p:?}, {outputs:?}", effect.name());
                lost = lost.max(power);
            }
            assert!(lost > 0.0);
        }
    }
}

/// A step in a parameter has the response of two halves: nothing jumps, so that differences are derivatives.
#[test]
fn responses_are_smooth_in_the_parameters_of_the_dynamics() {
    for rig in [body(), sides()] {
        let scene = rig.scene();
        // A castor ahead of the axle is on its head when this drive reverses, and goes round one way or the other: its law is that of one behind.
        let ahead = CastorDrag { kind: CastorKind::Leading, ..CastorDrag::default() }.about();
        let geared = CoulombFriction { law: FrictionLaw::Geared }.about();
        // Motors that rebound meet again and again, each time later or sooner by more: no slope leads anywhere, and they are walked to.
        let rebounding = Backlash { at_motor: true, bouncing: true }.about();
        // What is two at once is the sum of two laws, which are asked by themselves.
        let alone = |e: &dyn Effect| e.stage().place() == Place::Dynamics && e.at_once().is_none();
        let smooth = |e: &dyn Effect| alone(e) && ![&ahead, &rebounding].contains(&&e.about());
        for effect in able(&scene).into_iter().filter(|e| smooth(&**e)) {
            let (parameters, starts) = (effect.parameters(&scene), effect.starts(&scene));
            // What only gives another effect its name has that one's law.
            // Where no drag is behind the gap a motor floats in it, and every step is another motion: the next start has some.
            let middle = starts.len() / 2 + usize::from(effect.rugged() && effect.senses());
            let Some(Start { values: start, .. }) = starts.get(middle) else { continue };
            let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&*effect], &scene).unwrap();
            simulator.set_substeps(8);
            let mut run = |values: &[f64], follows: bool| {
                simulator.set(&rig.theta, values).unwrap();
                simulator.set_following(follows);
                let mut run = vec![Vec::new(); 2];
                simulator.run(0, rig.stretch(), &rig.start, &mut run).unwrap();
                run.concat()
            };
            for (i, p) in parameters.iter().enumerate() {
                // A time has no size that would say how finely it shows: its zero is anywhere.
                let size = if p.unit == "s" && p.bounds.0 > 0.0 { p.scale } else { p.scale.max(start[i].abs()) };
                // At the start itself of this one an interval changes to finer steps, of a hundred sizes beside it at none.
                let from = if effect.about() == geared { 0.01 * size } else { 0.0 };
                let mut at = |share: f64, follows: bool| {
                    let mut values = start.clone();
                    values[i] += from + share * size;
                    run(&values, follows)
                };
                // As a fit takes them: with the steps of the run beside which they are.
                let base = at(0.0, false);
                let mut response = |share: f64| at(share, true).iter().zip(&base).map(|(a, b)| a - b).collect::<Vec<f64>>();
                let (whole, half) = (response(0.002), response(0.001));
                let norm = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>().sqrt();
                let bend = norm(&mut whole.iter().zip(&half).map(|(w, h)| w - 2.0 * h)) / norm(&mut whole.iter().copied()).max(1e-9);
                // Where teeth meet a wheel's speed jumps, and what dry friction holds comes off in one step or in the next: what of that falls on
                // a sample does not grow evenly.
                let held = effect.name() == "turning_scrub" && effect.stage() == Stage::Contact;
                let most = if effect.name() == "backlash" {
                    0.5
                } else if held {
                    0.2
                } else {
                    0.1
                };
                assert!(bend < most, "{} ({}), {} from {}: {bend}", effect.name(), effect.about(), p.name, start[i]);
            }
        }
    }
}

fn run_at(rig: &Rig, shares: &[f64]) -> Result<(), TestCaseError> {
    let scene = rig.scene();
    for effect in able(&scene) {
        let values: Vec<f64> = effect.parameters(&scene).iter().enumerate().map(|(i, p)| within(p, shares[i % shares.len()])).collect();
        let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&*effect], &scene).unwrap();
        simulator.set(&rig.theta, &values).unwrap();
        simulator.set_substeps(1);
        let mut stretch = rig.stretch().clone();
        stretch.time.truncate(120);
        let mut run = vec![Vec::new(); 2];
        match simulator.run(0, &stretch, &rig.start, &mut run) {
            Ok(()) => prop_assert!(run.iter().flatten().all(|x| x.is_finite()), "{} at {values:?}", effect.name()),
            Err(ModelError::Diverged { .. }) => {}
            Err(other) => prop_assert!(false, "{} at {values:?}: {other}", effect.name()),
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_value_within_bounds_breaks_a_simulation(
        shares in prop::collection::vec(prop_oneof![Just(0.0), Just(1.0), Just(0.5), 0.0..1.0_f64], 6),
    ) {
        run_at(&body(), &shares)?;
        run_at(&sides(), &shares)?;
    }
}

/// Tangents are what runs near by differ by, under every effect that has them, for the model's parameters, those of forces, and the initial outputs.
#[test]
fn tangents_are_what_runs_near_by_differ_by() {
    const BY: f64 = 1e-4;
    let (mut effects, mut forces) = (0, 0);
    for (rig, readout) in [(body(), Readout::Instantaneous), (sides(), Readout::Instantaneous), (body(), Readout::IntervalMean)] {
        let scene = rig.scene();
        for effect in able(&scene).iter().filter(|e| !e.starts(&scene).is_empty()) {
            let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&**effect], &scene).unwrap().with_readout(readout);
            if !simulator.has_tangents() {
                continue;
            }
            simulator.set_substeps(8);
            let (parameters, all) = (rig.theta.len(), [&rig.theta[..], &effect.starts(&scene)[0].values, &rig.start].concat());
            let values = parameters..all.len() - 2;
            let carried: Vec<usize> =
                (0..values.end).filter(|j| *j < parameters || simulator.has_tangent(j - parameters, rig.stretch())).collect();
            (effects, forces) = (effects + 1, forces + carried.len() - parameters);
            let moved = |j: usize, by: f64| {
                let mut there = all.clone();
                there[j] += by;
                there
            };
            let along = |j: &usize| {
                let there = moved(*j, BY);
                Direction { theta: there[..parameters].to_vec(), values: there[values.clone()].to_vec(), by: BY }
            };
            let directions: Vec<Direction> = carried.iter().map(along).collect();
            let mut run = vec![Vec::new(); 2];
            simulator.set(&rig.theta, &all[values.clone()]).unwrap();
            let tangents = simulator.tangents(0, rig.stretch(), &rig.start, &directions, &mut run).unwrap();
            simulator.set_following(true);
            let mut at = |there: &[f64]| {
                simulator.set(&there[..parameters], &there[values.clone()]).unwrap();
                simulator.run(0, rig.stretch(), &there[values.end..], &mut run).unwrap();
                run.concat()
            };
            let here = at(&all);
            for (tangent, j) in tangents.iter().zip(carried.iter().copied().chain(values.end..all.len())) {
                let ahead = at(&moved(j, BY));
                let size = |of: &dyn Fn(usize) -> f64| (0..ahead.len()).map(|k| of(k).powi(2)).sum::<f64>().sqrt();
                let (tangent, difference) = (tangent.concat(), |k: usize| (ahead[k] - here[k]) / BY);
                let off = size(&|k| tangent[k] - difference(k));
                assert!(off <= 0.02 * size(&difference), "{} {j} {readout:?}: {off} of {}", effect.name(), size(&difference));
            }
        }
    }
    assert!(effects > 40 && forces > 40, "{effects} {forces}");
}
