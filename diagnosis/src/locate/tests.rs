use super::*;
use crate::comparison::Channels;
use crate::fixture::{Case, NOISE, normal};

/// The truth changed by a contribution of which the kind is known.
fn without(case: &Case, change: impl Fn(f64, usize, f64) -> f64) -> Vec<Channels> {
    let pairs = case.data.stretches.iter().zip(&case.truth);
    pairs.map(|(s, run)| (0..2).map(|i| (0..s.len()).map(|k| run[i][k] - change(s.time[k], i, run[i][k])).collect()).collect()).collect()
}

fn located(case: &Case, change: impl Fn(f64, usize, f64) -> f64) -> crate::finding::Location {
    let without = without(case, change);
    case.compare(Some(&without), |c| locate(c, Vec::new()))
}

#[test]
fn a_misfit_of_one_channel_is_in_that_channel() {
    let found = located(&Case::clean(1), |_, i, y| if i == 1 { 0.1 * y } else { 0.0 });
    assert_eq!(found.channels[0], ("v".to_owned(), 0.0));
    assert_eq!(found.channels[1], ("omega".to_owned(), 1.0));
    // Turning is done by both wheels.
    let (left, right) = found.wheels.unwrap();
    assert!((left - right).abs() < 1e-9 && (left + right - 1.0).abs() < 1e-12);
}

#[test]
fn a_misfit_backwards_is_told_as_such() {
    let found = located(&Case::clean(2), |_, i, y| if i == 0 && y < 0.0 { 0.02 } else { 0.0 });
    let region = &found.regions[0];
    assert!(region.of == "v" && region.to < 0.02 && region.share > 0.6 && region.words.starts_with("backwards"), "{region:?}");
}

#[test]
fn seconds_in_which_it_acts_are_the_times() {
    let found = located(&Case::clean(3), |t, _, _| if (70.0..80.0).contains(&t) { 0.05 } else { 0.0 });
    assert_eq!(found.times.len(), 1, "{:?}", found.times);
    let (from, to) = found.times[0];
    assert!((from - 70.0).abs() <= 1.0 && (to - 80.0).abs() <= 1.0, "{from} {to}");
}

#[test]
fn where_the_base_model_bends_to_what_does_not_act_is_no_place() {
    // The base is off all the time, the effects act from 90 s on.
    let case = Case::clean(6);
    let base = without(&case, |_, _, _| 0.05);
    let neutral = without(&case, |t, _, _| if t >= 90.0 { 0.08 } else { 0.0 });
    let at = |since| case.compare(Some(&neutral), |c| locate(&Comparison { base: &base, since, ..*c }, Vec::new()));
    let times = |since| at(since).times;
    let end = *case.data.stretches[1].time.last().unwrap();
    let [(from, to)] = times(None)[..] else { panic!("{:?}", times(None)) };
    assert!((from - 90.0).abs() <= 1.0 && (to - end).abs() <= 1.0, "{from} {to}");
    // What begins is there from then on, to the moment, whether it moves the robot or not.
    assert_eq!(times(Some(90.4))[..], [(90.0, 90.4), (90.4, end)]);
    assert!(at(Some(90.4)).statement.starts_with("it begins at 90.4 s; "), "{}", at(Some(90.4)).statement);
}

#[test]
fn a_slow_misfit_has_low_frequencies() {
    let found = located(&Case::clean(4), |t, _, _| 0.05 * (0.6 * t).sin());
    assert_eq!(found.frequencies_hz, [(0.05, 0.2)]);
}

#[test]
fn a_base_that_fails_from_some_time_on_has_a_change_there() {
    let case = Case::new(5, |t, i, y, _, random| y + NOISE[i] * normal(random) + if t > 78.0 { 0.06 * (2.0 * t).sin() } else { 0.0 });
    let found = case.compare(None, |c| locate(c, Vec::new()));
    let change = &found.changes[0];
    assert!(change.interval.0 <= 78.0 + 1.0 && change.interval.1 >= 77.0 && (change.time - 78.0).abs() < 2.0, "{change:?}");
    assert!(found.times.iter().all(|(from, _)| *from >= 76.0), "{:?}", found.times);
}

#[test]
fn noise_is_nowhere() {
    for seed in 0..10 {
        let found = Case::clean(seed).compare(None, |c| locate(c, Vec::new()));
        assert!(found.changes.is_empty() && found.times.len() <= 1, "{seed}: {found:?}");
    }
}
