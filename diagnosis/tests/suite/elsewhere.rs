//! What training data leave open between two places far from each other.

use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use wheelwright_core::ModelConfig;
use wheelwright_core::effect::Effect;
use wheelwright_diagnosis::effects::{
    ActuatorLag, Axis, CastorDrag, CastorKind, CommandDelay, DeadZone, EncoderQuantisation, SensorDelay, SlewLimit, VelocitySaturation,
};
use wheelwright_diagnosis::{Question, Verdict, diagnose};
use wheelwright_models::VwPdConfig;

use super::drive::{Drive, blur};
use super::recorded::{NOISE, TRACK, add_noise, commands, counted, driven, half_averaged, model, names, record};

/// Two lags in series are one mathematics either way round, but for what couples the outputs behind the first.
#[test]
fn a_lag_is_told_from_the_models_own() {
    let (model, hidden) = (VwPdConfig::default().build().unwrap(), ActuatorLag::default());
    let drive = Drive { samples: 1600, change: 0.05, forward: 0.0..0.8, turning: -2.0..2.0, seed: 21 };
    let (mut data, mut random) = drive.driven(&*model, &[0.08, 0.05, 0.0, 1.0, 0.3, 1.0], 0.34, &hidden, &[0.19]);
    blur(&mut data, [0.004, 0.012], &mut random);
    let library: Vec<Box<dyn Effect>> =
        vec![Box::new(ActuatorLag::default()), Box::new(ActuatorLag { each_axis: true, ..ActuatorLag::default() })];
    let mut question = Question::new(&*model, &data, &library);
    question.track_width = Some(0.34);
    let answer = diagnose(&question).unwrap();
    let found = &answer.effects[0].values;
    assert!(answer.effects.len() == 1 && found.iter().all(|lag| (lag - 0.19).abs() < 0.01), "{}", answer.headline);
}

/// A limit that the wheels reach on straight ways only has a size at every track; turns tell the right one.
#[test]
fn a_track_that_only_held_out_driving_shows_is_taken_from_it() {
    let (model, hidden) = (VwPdConfig::default().build().unwrap(), VelocitySaturation::default());
    let recorded = |seed: u64, straight: bool| {
        let mut random = StdRng::seed_from_u64(seed);
        let mut stretch = commands(&mut random, 1600, true);
        let [forward, turning] = &mut stretch.inputs[..] else { panic!("two commands") };
        for (v, w) in forward.iter_mut().zip(turning) {
            *w *= if straight && *v > 0.2 { 0.0 } else { 0.5 };
            *v = v.max(0.0);
        }
        driven(NOISE, 0.9, &mut random, stretch, &[(&hidden, &[0.4])], 0.0)
    };
    let (data, held) = (recorded(31, true), recorded(32, false));
    let library: Vec<Box<dyn Effect>> = vec![Box::new(VelocitySaturation::default())];
    let mut question = Question::new(&*model, &data, &library);
    question.held_out = Some(&held);
    let answer = diagnose(&question).unwrap();
    assert_eq!(answer.verdict, Verdict::Explained, "{} {:?}", answer.headline, answer.warnings);
    let said = answer.warnings.iter().find(|w| w.contains("holds on the held-out data")).unwrap();
    let width: f64 = said.split(" m, which").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((width / 0.9 - 1.0).abs() < 0.06, "{said}");
}

/// When a wheel's command crosses a threshold depends on the track: nearer than a person measures it.
#[test]
fn a_threshold_at_the_wheels_tells_that_a_profile_is_off() {
    let (model, hidden) = (model(), DeadZone::default());
    let recorded = |seed: u64| {
        let mut random = StdRng::seed_from_u64(seed);
        let mut stretch = commands(&mut random, 1600, true);
        let waves = |size: f64, rate: f64| stretch.time.iter().map(|t| size * (rate * t + seed as f64).sin()).collect();
        stretch.inputs = vec![waves(0.3, 0.5), waves(1.2, 0.37)];
        driven(NOISE, TRACK, &mut random, stretch, &[(&hidden, &[0.12])], 0.0)
    };
    let (data, held) = (recorded(33), recorded(34));
    let library: Vec<Box<dyn Effect>> = vec![Box::new(DeadZone::default())];
    for factor in [0.98, 1.0, 1.02] {
        let mut question = Question::new(&*model, &data, &library);
        (question.held_out, question.track_width) = (Some(&held), Some(factor * TRACK));
        let answer = diagnose(&question).unwrap();
        assert_eq!((answer.verdict, names(&answer)), (Verdict::Explained, vec!["dead_zone"]), "{factor}: {}", answer.headline);
        let width = 2.0 * answer.scene.frame.half_track();
        assert!((width / TRACK - 1.0).abs() < 0.005, "{factor}: {width}");
        let said = answer.warnings.iter().any(|w| w.contains("what acts at the wheels is explained best if the track is"));
        assert_eq!(said, factor != 1.0, "{factor}: {:?}", answer.warnings);
    }
}

/// Speeds in whole counts of the wheels are differences of counts: late by half a sample for that, and not by a delay, whatever hides beside it.
#[test]
fn whole_counts_say_that_means_are_recorded() {
    let (model, limit) = (model(), VelocitySaturation::default());
    let library: Vec<Box<dyn Effect>> =
        vec![Box::new(CommandDelay::default()), Box::new(VelocitySaturation::default()), Box::new(EncoderQuantisation::default())];
    for seed in [41, 46] {
        let data = counted(seed, 1600, &[(&limit, &[0.25])], 6e-4);
        let mut question = Question::new(&*model, &data, &library);
        question.track_width = Some(TRACK);
        let answer = diagnose(&question).unwrap();
        assert_eq!((answer.verdict, names(&answer)), (Verdict::Explained, vec!["velocity_saturation", "encoder_quantisation"]), "{seed}");
    }
}

/// A late command and a late sensor are one mathematics, but only messages are late each by a time of its own.
#[test]
fn what_is_late_by_another_time_each_message_is_the_command() {
    let (rows, finer, step) = (1600, 10, 0.005);
    let mut random = StdRng::seed_from_u64(81);
    let sent = commands(&mut random, rows, true);
    let mut fine = commands(&mut random, rows * finer, true);
    let times: Vec<f64> = (0..rows * finer).map(|k| step * k as f64).collect();
    for (fine, sent) in fine.inputs.iter_mut().zip(&sent.inputs) {
        // When the message in force came, and the next one comes.
        let (mut now, mut arrivals) = (sent[0], Vec::new());
        for k in 1..rows {
            if sent[k] != sent[k - 1] {
                arrivals.push((sent[k], 0.05 * k as f64 + random.random_range(0.05..0.15)));
            }
        }
        let mut next = arrivals.into_iter().peekable();
        for (u, t) in fine.iter_mut().zip(&times) {
            while let Some((command, _)) = next.next_if(|(_, at)| at <= t) {
                now = command;
            }
            *u = now;
        }
    }
    fine.time = times;
    let moved = driven(0.0, TRACK, &mut random, fine, &[], 0.0);
    let mut data = record(81, rows, true, &[], 0.0);
    let sampled = |series: &Vec<f64>| series.iter().copied().step_by(finer).collect::<Vec<f64>>();
    data.stretches[0].inputs = sent.inputs;
    data.stretches[0].outputs = moved.stretches[0].outputs.iter().map(sampled).collect();
    add_noise(&mut data.stretches[0].outputs, 81, rows);
    // Among equals the first of the library would be told.
    let library: Vec<Box<dyn Effect>> = vec![Box::new(SensorDelay::default()), Box::new(CommandDelay::default())];
    let model = model();
    let mut question = Question::new(&*model, &data, &library);
    question.track_width = Some(TRACK);
    let answer = diagnose(&question).unwrap();
    assert_eq!((answer.verdict, names(&answer)), (Verdict::Explained, vec!["command_delay"]), "{} {:?}", answer.headline, answer.warnings);
    assert!(answer.location.tests.iter().any(|t| t.contains("comes late by a time of its own")), "{:?}", answer.location.tests);
    assert_eq!(answer.effects[0].alternatives.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(), ["sensor_delay"]);
}

/// Where turning is gentle nothing tells whether it is read as a mean too; held-out steps do.
#[test]
fn a_reading_that_held_out_data_contradict_is_none() {
    let (model, library): (_, Vec<Box<dyn Effect>>) = (model(), vec![Box::new(EncoderQuantisation::default())]);
    let (data, held) = (half_averaged(71, 1600, false), half_averaged(72, 1600, true));
    for (held_out, told) in [(None, true), (Some(&held), false)] {
        let mut question = Question::new(&*model, &data, &library);
        (question.held_out, question.track_width) = (held_out, Some(TRACK));
        let answer = diagnose(&question).unwrap();
        let means = answer.effects.iter().chain(&answer.partial).any(|e| e.name == "encoder_quantisation");
        assert_eq!(means, told, "{}", answer.headline);
    }
}

/// A ramp that forward driving never reaches in training limits the held-out driving: the same cause, and nothing against the explanation.
#[test]
fn what_limits_one_axis_may_limit_the_other_elsewhere() {
    let ramp = |axis: Axis| SlewLimit { axis: Some(axis), ..SlewLimit::default() };
    let (model, forward, turning) = (model(), ramp(Axis::V), ramp(Axis::Omega));
    let recorded = |seed: u64, steps: bool| {
        let mut random = StdRng::seed_from_u64(seed);
        let mut stretch = commands(&mut random, 1600, true);
        if !steps {
            // Forward commands that change slowly.
            let times = stretch.time.iter();
            stretch.inputs[0] = times.map(|t| 0.2 * (1.0 - (0.7 * t).cos())).collect();
        }
        driven(NOISE, TRACK, &mut random, stretch, &[(&forward, &[0.5]), (&turning, &[2.0])], 0.0)
    };
    let (data, held) = (recorded(51, false), recorded(52, true));
    let library: Vec<Box<dyn Effect>> = vec![Box::new(CommandDelay::default()), Box::new(ramp(Axis::V)), Box::new(ramp(Axis::Omega))];
    let mut question = Question::new(&*model, &data, &library);
    (question.held_out, question.track_width) = (Some(&held), Some(TRACK));
    let answer = diagnose(&question).unwrap();
    assert_eq!((answer.verdict, names(&answer)), (Verdict::Explained, vec!["slew_limit"]), "{} {:?}", answer.headline, answer.warnings);
    let said = answer.warnings.iter().find(|w| w.contains("never reach")).unwrap();
    assert!(said.contains("forward command changes by at most 0.5"), "{said}");
}

/// On the way from behind the axle to before it a castor does less and less: no step of a fit leads there.
#[test]
fn a_castor_ahead_of_the_axle_is_found_there() {
    let (model, castor) = (model(), CastorDrag::default());
    let kinds = [CastorKind::Swivel, CastorKind::Leading];
    let library: Vec<Box<dyn Effect>> =
        kinds.into_iter().map(|kind| Box::new(CastorDrag { kind, ..CastorDrag::default() }) as Box<dyn Effect>).collect();
    for place in [-0.29, 0.26] {
        let data = record(61, 1600, true, &[(&castor, &[0.06, place, 0.05, 1e-4, 0.0, 0.4, 1.0])], 0.0);
        let mut question = Question::new(&*model, &data, &library);
        question.track_width = Some(TRACK);
        let answer = diagnose(&question).unwrap();
        assert_eq!(names(&answer), ["castor_drag"], "{}", answer.headline);
        let found = answer.effects[0].values[1];
        assert!((found / place - 1.0).abs() < 0.1, "{place}: {found}");
    }
}
