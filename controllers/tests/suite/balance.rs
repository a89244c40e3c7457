//! Adaptation gains of equal pace, against the closed loop integrated.

use crate::common::{KHEPERA, TRUE_THETA, adaptive, figure_eight, pd_subject};
use wheelwright_controllers::AdaptiveConfig;
use wheelwright_controllers::adaptation::{Balanced, Gamma};
use wheelwright_controllers::continuous::Continuous;
use wheelwright_controllers::law::Sigma;
use wheelwright_controllers::trajectory::Line;
use wheelwright_core::controller::{ControllerConfig, Subject};
use wheelwright_core::trajectory::{Envelope, TrajectoryConfig, course};

const NAMES: [&str; 6] = ["theta1", "theta2", "theta3", "theta4", "theta5", "theta6"];

/// Gain of the velocity loop [1/s].
const KV: f64 = 4.0;

fn balanced(time: f64) -> AdaptiveConfig {
    AdaptiveConfig { gamma: Gamma::Balanced(Balanced { time }), ..adaptive([1.0; 3], [KV; 2], Sigma::Exact, 0.0) }
}

/// Each parameter, wrong alone, comes back with the time constant asked for, on robots and courses of different size, if the course is
/// slow against the velocity loop.
#[test]
fn a_parameter_that_is_wrong_alone_fades_with_the_time_constant() {
    for (own, eight) in [(TRUE_THETA, figure_eight(1.0, 1.0, 0.05)), (KHEPERA, figure_eight(0.15, 0.3, 0.1))] {
        let (round, time) = (eight.duration(), 4.0 * eight.duration());
        for wrong in 0..6 {
            let mut theta = own;
            theta[wrong] += 0.02 * own[wrong].abs().max(0.05);
            let subject = Subject { course: course(&*eight, round), ..pd_subject(&theta, 0.02) };
            let frozen = (0..6).filter(|i| *i != wrong).map(|i| NAMES[i].to_owned()).collect();
            let controller = AdaptiveConfig { frozen, ..balanced(time) };
            let mut simulation = Continuous::new(&controller, &subject, &own, &*eight, Continuous::perfect_start(&*eight)).unwrap();
            // Whole rounds from the second on: the first begins with errors that are not yet settled.
            let mut after = |duration: f64| {
                simulation.run(duration, 0.02, usize::MAX).unwrap();
                simulation.state()[5 + wrong] - own[wrong]
            };
            let (begin, end) = (after(round), after(time));
            assert!(((begin / end).ln() - 1.0).abs() < 0.1, "{}: {begin} {end}", NAMES[wrong]);
        }
    }
}

/// A straight line at constant speed asks for damping of v and of nothing else.
#[test]
fn what_is_never_asked_for_is_not_adapted() {
    let line = Line { length: 10.0, speed: 0.2 }.build(&Envelope::default()).unwrap();
    let subject = Subject { course: course(&*line, 50.0), ..pd_subject(&KHEPERA, 0.02) };
    let (_, adaptation) = balanced(20.0).parts(&subject).unwrap();
    let gamma = adaptation.gamma();
    // γ4 E[v²]/(θ1 kv) = 1/20 s.
    assert!((gamma[3] * 0.04 / (KHEPERA[0] * KV) - 0.05).abs() < 1e-12, "{gamma:?}");
    assert!([0, 1, 2, 4, 5].iter().all(|i| gamma[*i] == 0.0), "{gamma:?}");
}

/// However short a time is asked for, velocity loop and adaptation are at most critically damped: γ φ²/D ≤ K²/4.
#[test]
fn no_gain_is_more_than_the_velocity_loop_bears() {
    let eight = figure_eight(0.15, 0.3, 0.3);
    let subject = Subject { course: course(&*eight, eight.duration()), ..pd_subject(&KHEPERA, 0.02) };
    let gamma = |time: f64| balanced(time).parts(&subject).unwrap().1.gamma().to_vec();
    let fastest = subject.course.iter().map(|r| r.v * r.v).fold(0.0, f64::max);
    assert!((gamma(1e-3)[3] * fastest / KHEPERA[0] - 0.25 * KV * KV).abs() < 1e-9);
    assert_eq!(gamma(1e-3), gamma(1e-6));
    assert!(gamma(100.0).iter().zip(gamma(1e-3)).all(|(slow, fast)| *slow < 0.2 * fast));
}

#[test]
fn impossible_settings_name_their_key() {
    let refused = |config: &AdaptiveConfig, subject: &Subject| config.build(subject).unwrap_err().to_string();
    let blank = pd_subject(&KHEPERA, 0.02);
    assert!(refused(&balanced(10.0), &blank).contains("gamma.time"));
    let eight = figure_eight(0.15, 0.3, 0.3);
    let subject = Subject { course: course(&*eight, eight.duration()), ..blank };
    assert!(refused(&balanced(-1.0), &subject).contains("must be a positive number of seconds, not -1"));
    let noisy = AdaptiveConfig { noise: [0.1, -0.1], ..balanced(10.0) };
    assert!(refused(&noisy, &subject).contains("noise"));
    let read: Result<AdaptiveConfig, _> = toml::from_str("k = [1.0, 1.0, 1.0]\nkv = 1.0\nkw = 1.0\ngamma = { time = 10.0 }");
    assert_eq!(read.unwrap().gamma, Gamma::Balanced(Balanced { time: 10.0 }));
}
