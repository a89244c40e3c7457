#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use super::*;
use crate::comparison::wrapped;
use crate::effects::library;
use crate::fixture::{Case, NOISE, RADIUS, TRACK, normal};
use rand::SeedableRng;
use rand::rngs::StdRng;
use wheelwright_core::effect::Effect;
use wheelwright_core::{Dataset, ModelConfig};
use wheelwright_models::VwPdConfig;

const H: f64 = 0.5 * TRACK;

/// Headings and wheel rates of a robot that moves as recorded in truth, `seen` being the velocities that each of them sees.
fn others(case: &Case, heading: impl Fn(f64, f64) -> f64, wheels: impl Fn(f64, f64) -> [f64; 2]) -> (Vec<Vec<f64>>, Vec<[Vec<f64>; 2]>) {
    let mut random = StdRng::seed_from_u64(5);
    let each = case.data.stretches.iter().zip(&case.truth);
    each.map(|(stretch, run)| {
        let (mut angle, mut headings) = (3.0, Vec::new());
        let mut rates = [Vec::new(), Vec::new()];
        for k in 0..stretch.len() {
            if k > 0 {
                let step = stretch.time[k] - stretch.time[k - 1];
                let mean = |i: usize| 0.5 * (run[i][k] + run[i][k - 1]);
                angle += heading(mean(0), mean(1)) * step;
            }
            // As a compass writes it, between −π and π.
            headings.push(wrapped(angle) + 0.002 * normal(&mut random));
            let [left, right] = wheels(run[0][k], run[1][k]);
            rates[0].push(left / RADIUS + NOISE[0] / RADIUS * normal(&mut random));
            rates[1].push(right / RADIUS + NOISE[0] / RADIUS * normal(&mut random));
        }
        (headings, rates)
    })
    .unzip()
}

fn ask(case: &Case, headings: Option<Vec<Vec<f64>>>, rates: Option<Vec<[Vec<f64>; 2]>>, without: &str) -> Beside {
    let model = VwPdConfig::default().build().unwrap();
    let library: Vec<Box<dyn Effect>> = library().into_iter().filter(|e| e.name() != without).collect();
    let held: Dataset = case.data.clone();
    let mut question = Question::new(&*model, &held, &library);
    question.training_headings = headings;
    question.training_wheel_rates = rates;
    question.wheel_radius = Some(RADIUS);
    Beside::of(&question, &case.scene)
}

/// Middle of what the radii's error lies between.
fn middle(beside: &Beside, scene: &Scene) -> f64 {
    let (low, high) = beside.radii.as_ref().unwrap().0.parameters(scene)[0].bounds;
    0.5 * (low + high)
}

#[test]
fn a_heading_that_agrees_says_nothing_and_one_that_does_not_tells_what_is_wrong() {
    let case = Case::clean(21);
    let (same, rates) = others(&case, |_, w| w, |v, w| [v - H * w, v + H * w]);
    let found = ask(&case, Some(same), Some(rates), "");
    assert!(found.radii.is_none() && found.track.is_none());

    // The right wheel 3 % larger than reckoned, the left one as much smaller: the heading turns with forward motion.
    let (turned, _) = others(&case, |v, w| w + 0.03 * v / H, |v, w| [v - H * w, v + H * w]);
    let found = ask(&case, Some(turned.clone()), None, "");
    let error = middle(&found, &case.scene);
    assert!((error + 0.06).abs() < 0.004, "{error}");
    assert!(found.track.is_none());
    // As far as what was measured lets it go is not as far as radii can differ.
    let told = &found.radii.as_ref().unwrap().0.parameters(&case.scene)[0];
    assert_eq!(told.usual.map(|(value, _)| value), Some(error));
    assert!(told.extreme(told.bounds.0).is_none());
    assert!(ask(&case, Some(turned), None, "wheel_radius_mismatch").radii.is_none());

    // A track that is reckoned 7 % too narrow: velocities tell of more turning.
    let (less, _) = others(&case, |_, w| w / 1.07, |v, w| [v - H * w, v + H * w]);
    let found = ask(&case, Some(less), None, "");
    assert!(found.radii.is_none());
    assert!((found.track.unwrap().values[0] - 0.07).abs() < 0.004);
}

/// Encoders that reckon with one wheel's radius wrong tell of too much turning as well, and of no other track; a track that is wrong besides shows.
#[test]
fn the_radius_of_one_wheel_is_no_track_error() {
    let case = Case::clean(25);
    // The left wheel 8 % smaller than reckoned: it rolls 0.92 of what its encoder says.
    let heading = |track: f64| move |v: f64, w: f64| ((v + H * w) - 0.92 * (v - H * w)) / (2.0 * H * track);
    let asked = |track: f64| {
        let (headings, _) = others(&case, heading(track), |v, w| [v - H * w, v + H * w]);
        ask(&case, Some(headings), None, "")
    };
    let (plain, wide) = (asked(1.0), asked(1.07));
    assert!((middle(&plain, &case.scene).abs() - 0.08).abs() < 0.004 && plain.track.is_none());
    assert!(wide.radii.is_some() && wide.track.is_some());
}

#[test]
fn wheels_tell_against_the_robots_own_motion_beyond_what_a_person_measures() {
    let case = Case::clean(22);
    let wheels = |e: f64, t: f64| move |v: f64, w: f64| [(v - H * w / t) / (1.0 - e), (v + H * w / t) / (1.0 + e)];
    let (_, rates) = others(&case, |_, w| w, wheels(0.02, 1.0));
    let found = ask(&case, None, Some(rates), "");
    let error = middle(&found, &case.scene);
    assert!((error - 0.04).abs() < 0.004 && found.track.is_none(), "{error}");
    let (_, rates) = others(&case, |_, w| w, wheels(0.0, 1.08));
    let found = ask(&case, None, Some(rates), "");
    assert!(found.radii.is_none());
    assert!((found.track.unwrap().values[0] - (1.0 / 1.08 - 1.0)).abs() < 0.005);
    // A profile that is 2 % off is as good as a person measures.
    let (_, rates) = others(&case, |_, w| w, wheels(0.0, 1.02));
    assert!(ask(&case, None, Some(rates), "").track.is_none());
}

#[test]
fn wheels_tell_dimensions_that_nobody_measured() {
    let case = Case::clean(23);
    let (_, rates) = others(&case, |_, w| w, |v, w| [v - H * w, v + H * w]);
    let model = VwPdConfig::default().build().unwrap();
    let library = library();
    let mut question = Question::new(&*model, &case.data, &library);
    assert!(dimensions(&question).is_none());
    question.training_wheel_rates = Some(rates);
    let found = dimensions(&question).unwrap();
    assert!((found.wheel_radius / RADIUS - 1.0).abs() < 0.005, "{}", found.wheel_radius);
    assert!((found.track_width / TRACK - 1.0).abs() < 0.005, "{}", found.track_width);
    // What a person measured stands.
    question.track_width = Some(1.1 * TRACK);
    assert!(dimensions(&question).is_none());
}

/// Velocities that are recorded a fifth of a second after they were true are held against what tells them in time.
#[test]
fn a_late_record_tells_the_same_geometry() {
    let mut case = Case::clean(24);
    case.data.stretches.iter_mut().for_each(|stretch| stretch.outputs.iter_mut().for_each(|y| y.rotate_right(4)));
    let (less, rates) = others(&case, |_, w| w / 1.07, |v, w| [v - H * w / 1.07, v + H * w / 1.07]);
    let error = |found: Beside| found.track.unwrap().values[0];
    let by_heading = error(ask(&case, Some(less), None, ""));
    let by_wheels = error(ask(&case, None, Some(rates), ""));
    assert!((by_heading - 0.07).abs() < 0.004 && (by_wheels - (1.0 / 1.07 - 1.0)).abs() < 0.004, "{by_heading} {by_wheels}");
}
