//! What sampling and noise do to the loop is what the formulas say.

use crate::common::{KHEPERA, PIONEER, Sampled, adaptive, figure_eight, pd_subject};
use wheelwright_controllers::adaptation::{Gamma, Projection};
use wheelwright_controllers::body::Body;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::stability::Axis;
use wheelwright_controllers::trajectory::Line;
use wheelwright_controllers::{AdaptiveConfig, InverseDynamicsConfig};
use wheelwright_core::controller::{ControllerConfig, Gravity, Observation, Plan, Subject};
use wheelwright_core::profile::Limits;
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig};

fn axes(subject: &Subject, theta: &[f64]) -> [Axis; 2] {
    Axis::of(&*subject.model, &Body::of(&*subject.model, &subject.envelope).unwrap(), theta)
}

#[test]
fn axes_of_the_six_parameters() {
    let subject = pd_subject(&KHEPERA, 0.02);
    let [v, omega] = axes(&subject, &KHEPERA);
    assert!((v.inertia - KHEPERA[0]).abs() < 1e-12 && (v.damping - KHEPERA[3]).abs() < 1e-12);
    assert!((omega.inertia - KHEPERA[1]).abs() < 1e-12 && (omega.damping - KHEPERA[5]).abs() < 1e-12);
}

/// The limits of the replication for a controller that believes in all ones.
#[test]
fn the_flip_bounds_of_the_two_robots() {
    let ones = [Axis { inertia: 1.0, damping: 1.0 }; 2];
    for (own, period, expected) in [(KHEPERA, 0.02, [3.43, 6.74]), (PIONEER, 0.1, [5.44, 4.92]), (PIONEER, 0.3, [2.68, 2.54])] {
        let own = axes(&pd_subject(&own, period), &own);
        for ((own, believed), expected) in own.iter().zip(&ones).zip(expected) {
            let found = own.largest_gain(believed, period);
            assert!((found - expected).abs() < 0.006, "{found} {expected}");
        }
    }
}

/// The gain k_v at which a disturbance along a straight line begins to grow.
fn threshold(own: &[f64; 6], period: f64, k1: f64) -> f64 {
    let subject = pd_subject(&[1.0; 6], period);
    let line = Line { length: 10.0, speed: 0.1 }.build(&Envelope::default()).unwrap();
    let grows = |kv: f64| {
        let config = InverseDynamicsConfig { k: [k1, 1.0, 1.0], kv, kw: 1.0, sigma: Sigma::Exact, saturation: false };
        let mut controller = config.build(&subject).unwrap();
        let log =
            Sampled { subject: &subject, own, noise: [0.0; 2], seed: 0, ahead: 0.01 }.track(&mut *controller, &*line, 3000.0 * period);
        let x: Vec<f64> = log.pose.iter().zip(&log.reference).map(|(p, r)| p[0] - r.x).collect();
        // The flip changes the error's sign every period: second differences show it above any slow part.
        (2890..2990).map(|k| (x[k + 2] - 2.0 * x[k + 1] + x[k]).abs()).any(|swing| swing.is_nan() || swing >= 1e-4)
    };
    let (mut low, mut high) = (0.1, 20.0);
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if grows(middle) { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}

#[test]
fn the_stability_bound_is_met_within_half_a_percent() {
    for (own, period, k1) in [(KHEPERA, 0.02, 1.0), (PIONEER, 0.1, 0.5), (PIONEER, 0.3, 0.5)] {
        let [axis, _] = axes(&pd_subject(&own, period), &own);
        let bound = axis.largest_gain(&Axis { inertia: 1.0, damping: 1.0 }, period);
        let kv = threshold(&own, period, k1);
        let found = axis.effective_gain(k1 + kv, k1, kv, period);
        assert!((found / bound - 1.0).abs() < 0.005, "period {period}: {found} {bound}");
    }
}

#[test]
fn noise_drifts_the_parameters_as_predicted() {
    let (period, gamma, duration) = (0.005, 1e-4, 60.0);
    let subject = pd_subject(&KHEPERA, period);
    let eight = figure_eight(0.15, 0.3, 0.3);
    let wheel = 0.003;
    let noise = [wheel / 2f64.sqrt(), wheel * 2f64.sqrt() / 0.089];
    let config = adaptive([1.0, 30.0, 2.0], [2.0; 2], Sigma::Exact, gamma);
    let slopes = |config: &AdaptiveConfig, noise: [f64; 2], seed: u64| -> Vec<f64> {
        let mut controller = config.build(&subject).unwrap();
        let log = Sampled { subject: &subject, own: &KHEPERA, noise, seed, ahead: 0.0 }.track(&mut *controller, &*eight, duration);
        log.theta.iter().map(|series| (series[series.len() - 1] - series[0]) / (gamma * duration)).collect()
    };
    // What sampling alone does is taken off.
    let (seeds, still) = (8, slopes(&config, [0.0; 2], 0));
    let mean = |config: &AdaptiveConfig| {
        let mut slope = [0.0; 6];
        for seed in 0..seeds {
            slope.iter_mut().zip(slopes(config, noise, seed)).zip(&still).for_each(|((sum, s), still)| *sum += (s - still) / seeds as f64);
        }
        slope
    };
    let slope = mean(&config);
    let [v, omega] = axes(&subject, &KHEPERA);
    let variance = |axis: Axis, sigma: f64, gain: f64| sigma * sigma * (1.0 + axis.noise_gain(&axis, gain, period));
    let expected = [(0, 3.0 * variance(v, noise[0], 3.0), 0.2), (1, 4.0 * variance(omega, noise[1], 4.0), 0.1)];
    for (i, expected, tolerance) in expected {
        assert!((slope[i] / expected - 1.0).abs() < tolerance, "theta{}: {} {expected}", i + 1, slope[i]);
    }
    assert!(slope[5] < 0.0 && slope[3] < 0.0, "{slope:?}");
    // Noise that the controller is told of leaves only what the loop feeds back.
    let told = mean(&AdaptiveConfig { noise, ..config });
    let direct = 4.0 * noise[1].powi(2);
    assert!(((slope[1] - told[1]) / direct - 1.0).abs() < 0.02 && told[1] < 0.2 * slope[1], "{told:?} {slope:?} {direct}");
}

#[test]
fn what_is_dangerous_is_said_before() {
    let eight = figure_eight(0.15, 0.3, 0.3);
    let plan = Plan { trajectory: &*eight, duration: 120.0, noise: Some([0.0021, 0.0477]) };
    let own = Some(KHEPERA.to_vec());
    let concerns = |config: &AdaptiveConfig, theta: &[f64]| {
        config.build(&Subject { own: own.clone(), ..pd_subject(theta, 0.02) }).unwrap().assess(&plan)
    };
    // Identified: nothing dangerous, but noise carries theta2 away.
    let identified = concerns(&adaptive([1.0, 30.0, 2.0], [2.0; 2], Sigma::Exact, 1.0), &KHEPERA);
    assert!(identified.iter().all(|c| c.gravity < Gravity::Danger), "{identified:?}");
    assert!(identified.iter().any(|c| c.message.contains("noise carries `theta2`")), "{identified:?}");
    // All ones at k1 + kv = 3.6 is beyond 3.43, and at 3 close to it.
    let gravest = |kv: f64| concerns(&adaptive([1.0, 30.0, 2.0], [kv, 2.0], Sigma::Exact, 1.0), &[1.0; 6]).iter().map(|c| c.gravity).max();
    assert_eq!((gravest(2.6), gravest(2.0)), (Some(Gravity::Danger), Some(Gravity::Warning)));
    // A projection that ends before the bound is safe, a wider one is not.
    let projected = |relative: f64| {
        let projection = Some(Projection { relative: Some(relative), ..Projection::default() });
        let config = AdaptiveConfig { projection, ..adaptive([1.0, 30.0, 2.0], [1.0; 2], Sigma::Exact, 1.0) };
        concerns(&config, &[1.0; 6]).into_iter().filter(|c| c.message.contains("projection lets")).count()
    };
    assert_eq!((projected(0.5), projected(1.0)), (0, 1));
    // A trajectory too fast for the robot.
    let envelope = Envelope { limits: Limits { v: Some(0.1), ..Limits::default() }, ..Envelope::default() };
    let subject = Subject { envelope, ..pd_subject(&KHEPERA, 0.02) };
    let found = adaptive([1.0; 3], [1.0; 2], Sigma::Exact, 0.0).build(&subject).unwrap().assess(&plan);
    assert!(found.iter().any(|c| c.gravity == Gravity::Danger && c.message.contains("forward speed")), "{found:?}");
}

#[test]
fn a_saturated_command_does_not_wind_up_the_parameters() {
    let limits = Limits { wheel_speed: Some(5.0), ..Limits::default() };
    let envelope = Envelope { limits, track_width: Some(0.089), wheel_radius: Some(0.0205) };
    let subject = Subject { envelope, ..pd_subject(&KHEPERA, 0.02) };
    let line = Line { length: 10.0, speed: 0.5 }.build(&Envelope::default()).unwrap();
    // The robot is held at rest, so the error asks for more than the wheels can: nothing is to be learnt from that.
    let grown = |saturation: bool| {
        let config = AdaptiveConfig { saturation, gamma: Gamma::Same(1.0), ..adaptive([1.0, 10.0, 2.0], [2.0; 2], Sigma::Exact, 1.0) };
        let mut controller = config.build(&subject).unwrap();
        let (mut command, mut begun) = ([0.0; 2], None);
        for k in 0..400 {
            let t = 0.02 * f64::from(k);
            controller.step(&Observation { t, reference: line.at(t), pose: [0.0; 3], outputs: &[0.0; 2] }, &mut command);
            // What the step before the first saturated one learnt still comes.
            if k > 250 {
                begun.get_or_insert(controller.theta()[0]);
            }
        }
        assert_eq!(controller.state().share < 1.0, saturation);
        controller.theta()[0] - begun.unwrap()
    };
    assert_eq!(grown(true), 0.0);
    assert!(grown(false) > 1.0);
}

#[test]
fn adaptation_waits_freezes_and_stays_within() {
    let subject = pd_subject(&[1.0; 6], 0.02);
    let eight = figure_eight(0.15, 0.3, 0.3);
    let projection = Some(Projection { relative: Some(0.02), ..Projection::default() });
    let config = AdaptiveConfig {
        start: 5.0,
        frozen: vec!["theta4".to_owned()],
        projection,
        ..adaptive([1.0, 30.0, 2.0], [1.0; 2], Sigma::Exact, 5.0)
    };
    let mut controller = config.build(&subject).unwrap();
    let log = Sampled { subject: &subject, own: &KHEPERA, noise: [0.0; 2], seed: 0, ahead: 0.0 }.track(&mut *controller, &*eight, 20.0);
    let first_change = log.theta[0].iter().position(|t| *t != 1.0).map(|k| log.time[k]).unwrap();
    assert!((5.0..5.1).contains(&first_change), "{first_change}");
    assert!(log.theta[3].iter().all(|t| *t == 1.0));
    assert!(log.theta.iter().flatten().all(|t| (0.98 - 1e-12..=1.02 + 1e-12).contains(t)));
    assert!(log.theta.iter().flatten().any(|t| (*t - 1.02).abs() < 1e-9 || (*t - 0.98).abs() < 1e-9), "no bound was reached");
}
