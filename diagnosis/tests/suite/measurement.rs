//! Effects between motion and record against integrations with very small steps, each equation written anew.

use crate::common::{HALF_TRACK, THETA, base, data, held, model, reference};
use wheelwright_core::effect::{Effect, EffectSimulator, Instant, Motion, Scene};
use wheelwright_core::simulation::Readout;
use wheelwright_core::{Dataset, RegressorModel, Stretch};
use wheelwright_diagnosis::effects::{
    Backlash, EncoderQuantisation, Ripple, SensorDelay, Speeds, TimestampJitter, TrackWidthError, Wheel, WheelEccentricity,
    WheelRadiusMismatch,
};

const RADIUS: f64 = 0.09;

struct Rig {
    model: Box<dyn RegressorModel>,
    data: Dataset,
    scene: Scene,
}

fn rig() -> Rig {
    let model = model();
    let data = data(&*model);
    let scene = Scene::new(&data, &*model, 2.0 * HALF_TRACK, Some(RADIUS), None);
    Rig { model, data, scene }
}

impl Rig {
    fn stretch(&self) -> &Stretch {
        &self.data.stretches[0]
    }

    fn run(&self, effect: &dyn Effect, values: &[f64], readout: Readout) -> Vec<Vec<f64>> {
        let mut simulator = EffectSimulator::new(&*self.model, &THETA, &[effect], &self.scene).unwrap().with_readout(readout);
        simulator.set(&THETA, values).unwrap();
        simulator.choose_substeps(&self.data.stretches).unwrap();
        let mut run = vec![Vec::new(); 2];
        simulator.run(0, self.stretch(), &[0.3, 0.2], &mut run).unwrap();
        run
    }

    /// The true motion, with the distances travelled, at the samples and at further times.
    fn truth(&self, further: &[f64]) -> Vec<(f64, [f64; 4])> {
        let mut fine = self.stretch().clone();
        fine.time.extend(further.iter().filter(|t| **t > 0.0 && **t < self.stretch().time[self.stretch().len() - 1]));
        fine.time.sort_by(f64::total_cmp);
        fine.time.dedup();
        fine.inputs = (0..2).map(|i| fine.time.iter().map(|t| held(self.stretch(), *t)[i]).collect()).collect();
        fine.outputs = vec![vec![0.0; fine.time.len()]; 2];
        let run = reference(&fine, [0.3, 0.2, 0.0, 0.0], &[], |t, x| {
            let a = base(held(self.stretch(), t), x);
            [a[0], a[1], x[0], x[1]]
        });
        fine.time.iter().copied().zip(run).collect()
    }

    /// Root mean square difference of the record from what it should be, relative to the outputs'.
    fn difference(&self, run: &[Vec<f64>], expected: impl Fn(usize) -> [f64; 2]) -> f64 {
        let sum: f64 = (0..self.stretch().len())
            .map(|k| (0..2).map(|i| ((run[i][k] - expected(k)[i]) / self.scene.scales.outputs[i]).powi(2)).sum::<f64>())
            .sum();
        (sum / (2 * self.stretch().len()) as f64).sqrt()
    }
}

fn at(truth: &[(f64, [f64; 4])], time: f64) -> [f64; 4] {
    if time <= 0.0 {
        let mut first = truth[0].1;
        first[2] = 0.3 * time;
        first[3] = 0.2 * time;
        return first;
    }
    truth[truth.partition_point(|(t, _)| *t < time - 1e-9)].1
}

#[test]
fn a_late_sensor_records_what_was() {
    let rig = rig();
    let tau = 0.083;
    let time = rig.stretch().time.clone();
    let mut further: Vec<f64> = time.iter().map(|t| t - tau).collect();
    further.extend(time.windows(2).map(|w| w[0] - tau));
    let truth = rig.truth(&further);
    let run = rig.run(&SensorDelay::default(), &[tau], Readout::Instantaneous);
    let error = rig.difference(&run, |k| {
        let x = at(&truth, time[k] - tau);
        [x[0], x[1]]
    });
    assert!(error < 5e-5, "{error}");
    // A late mean is the mean over an interval as long, and as late.
    let lengths: Vec<f64> = (1..time.len()).map(|k| time[k] - tau - (time[k] - time[k - 1])).collect();
    let truth = rig.truth(&[further, lengths].concat());
    let run = rig.run(&SensorDelay::default(), &[tau], Readout::IntervalMean);
    let error = rig.difference(&run, |k| {
        if k == 0 {
            return [0.3, 0.2];
        }
        let span = time[k] - time[k - 1];
        let (now, before) = (at(&truth, time[k] - tau), at(&truth, time[k] - tau - span));
        [(now[2] - before[2]) / span, (now[3] - before[3]) / span]
    });
    assert!(error < 5e-4, "{error}");
}

#[test]
fn a_running_mean_is_of_twice_what_it_is_late() {
    let rig = rig();
    let tau = 0.064;
    let time = rig.stretch().time.clone();
    let truth = rig.truth(&time.iter().map(|t| t - 2.0 * tau).collect::<Vec<_>>());
    let mean = SensorDelay { averaging: true, ..SensorDelay::default() };
    let error = |readout: Readout| {
        rig.difference(&rig.run(&mean, &[tau], readout), |k| {
            let (now, before) = (at(&truth, time[k]), at(&truth, time[k] - 2.0 * tau));
            [2, 3].map(|i| (now[i] - before[i]) / (2.0 * tau))
        })
    };
    // A mean of what counts that are differenced tell goes back as far.
    assert!(error(Readout::Instantaneous) < 5e-4, "{}", error(Readout::Instantaneous));
    assert!(error(Readout::IntervalMean) < 5e-4, "{}", error(Readout::IntervalMean));
    assert_eq!(rig.run(&mean, &[0.0], Readout::Instantaneous), rig.run(&SensorDelay::default(), &[0.0], Readout::Instantaneous));
}

#[test]
fn a_sensor_of_each_axis_is_late_by_itself() {
    let rig = rig();
    let late = [0.021, 0.094];
    let time = rig.stretch().time.clone();
    let truth = rig.truth(&late.iter().flat_map(|tau| time.iter().map(move |t| t - tau)).collect::<Vec<_>>());
    let run = rig.run(&SensorDelay { each_axis: true, ..SensorDelay::default() }, &late, Readout::Instantaneous);
    let error = rig.difference(&run, |k| [0, 1].map(|i| at(&truth, time[k] - late[i])[i]));
    assert!(error < 5e-5, "{error}");
    let one = rig.run(&SensorDelay { each_axis: true, ..SensorDelay::default() }, &[0.0, late[1]], Readout::Instantaneous);
    let now = rig.run(&SensorDelay::default(), &[0.0], Readout::Instantaneous);
    let error = rig.difference(&one, |k| [now[0][k], run[1][k]]);
    assert!(error < 5e-5, "{error}");
}

#[test]
fn wrong_radii_and_a_wrong_track_scale_what_is_recorded() {
    let rig = rig();
    let (truth, e) = (rig.truth(&[]), 0.06);
    let sides = |x: &[f64]| [x[0] - HALF_TRACK * x[1], x[0] + HALF_TRACK * x[1]];
    let back = |[l, r]: [f64; 2]| [0.5 * (l + r), (r - l) / (2.0 * HALF_TRACK)];
    let opposed = rig.run(&WheelRadiusMismatch::default(), &[e], Readout::Instantaneous);
    let opposed = rig.difference(&opposed, |k| {
        let [l, r] = sides(&truth[k].1);
        back([l * (1.0 - 0.5 * e), r * (1.0 + 0.5 * e)])
    });
    let left = rig.run(&WheelRadiusMismatch { wheel: Some(Wheel::Left), ..WheelRadiusMismatch::default() }, &[e], Readout::Instantaneous);
    let left = rig.difference(&left, |k| {
        let [l, r] = sides(&truth[k].1);
        back([l * (1.0 + e), r])
    });
    let track = rig.run(&TrackWidthError {}, &[e], Readout::Instantaneous);
    let track = rig.difference(&track, |k| [truth[k].1[0], (1.0 + e) * truth[k].1[1]]);
    assert!(opposed < 5e-5 && left < 5e-5 && track < 5e-5, "{opposed} {left} {track}");
}

/// The claim of its docstring: a wrong track and other parameters record the same.
#[test]
fn a_wrong_track_is_absorbed_by_the_parameters() {
    let (rig, e) = (rig(), 0.06);
    let wrong = rig.run(&TrackWidthError {}, &[e], Readout::Instantaneous);
    let k = 1.0 + e;
    let [a, b, c, d, f, g] = THETA;
    let theta = [a, b / k, c / (k * k), d, f / k, g / k];
    let mut simulator = EffectSimulator::new(&*rig.model, &theta, &[], &rig.scene).unwrap();
    simulator.set_substeps(8);
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, rig.stretch(), &[0.3, 0.2 * k], &mut run).unwrap();
    let error = rig.difference(&wrong, |i| [run[0][i], run[1][i]]);
    assert!(error < 5e-5, "{error}");
}

/// The angle of a wheel of radius r (1 + a cos φ + b sin φ) that has rolled so far, in terms of r: it turns further on what is smaller.
fn angle(rolled: f64, a: f64, b: f64) -> f64 {
    (0..60).fold(rolled, |angle, _| rolled - a * angle.sin() + b * angle.cos())
}

#[test]
fn an_eccentric_wheel_ripples_once_a_turn() {
    let rig = rig();
    let truth = rig.truth(&[]);
    let (a, b, radius) = (0.03, -0.05, 0.093);
    let run = rig.run(
        &WheelEccentricity { wheel: Some(Wheel::Right), ripple: Ripple::Reading, oval: false },
        &[a, b, radius],
        Readout::Instantaneous,
    );
    // The recorded distance of the right wheel, by the trapezoidal rule.
    let s = rig.stretch();
    let mut distance = vec![0.0];
    for k in 1..s.len() {
        let speed = |k: usize| s.outputs[0][k] + HALF_TRACK * s.outputs[1][k];
        distance.push(distance[k - 1] + 0.5 * (speed(k - 1) + speed(k)) * (s.time[k] - s.time[k - 1]));
    }
    let error = rig.difference(&run, |k| {
        let [v, w, ..] = truth[k].1;
        let (phase, right) = (angle(distance[k] / radius, a, b), v + HALF_TRACK * w);
        let ripple = right * (a * phase.cos() + b * phase.sin());
        [v + 0.5 * ripple, w + ripple / (2.0 * HALF_TRACK)]
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn a_wheel_off_its_axle_is_driven_unevenly_carries_weight_is_sped_up_and_scrubs() {
    let rig = rig();
    let effect = WheelEccentricity { wheel: Some(Wheel::Left), ripple: Ripple::Rolling, oval: false };
    let (a, b, carried, spin_up, scrub, ratio, radius) = (0.03, -0.05, 0.3, 0.04, 1.2, 1.7, 0.093);
    // Where a metre a second squared takes 0.2 m/s of command, the robot's weight is worth 1.96 m/s.
    let weight = carried * 0.2 * 9.80665;
    let row = rig.stretch().len() / 2;
    let at = Instant::of_sample(rig.stretch(), row, &rig.scene.tracks[0], &rig.scene, Readout::Instantaneous);
    let (v, w) = (0.35, -0.8);
    let loads = |spin_up: f64, scrub: f64| {
        let mut drive = [0.0; 2];
        let motion = Motion { u: &[0.0; 2], outputs: &[v, w], inertia: &[0.2, 0.0, 0.0, 0.1], drag: &[0.0; 4], held: &[0.0; 2] };
        effect.drive(&[a, b, carried, spin_up, scrub, ratio, radius], &at, &motion, &[], &mut drive);
        drive.map(|drive| -drive)
    };
    let phase = angle(rig.scene.tracks[0].distance[0][row] / radius, a, b);
    // The loop keeps s (1 − ε) where it would keep s; the weight pushes the left wheel, and so does what a wheel and its motor take to follow
    // the rate s (1 − ε)/r at a steady s, here by the difference of an angle gone on.
    let speed = v - HALF_TRACK * w;
    let kept = |angle: f64| -speed * (a * angle.cos() + b * angle.sin());
    let driven = kept(phase);
    let on = 1e-5;
    let gained = (kept(phase + on * speed / radius) - kept(phase - on * speed / radius)) / (2.0 * on);
    // Lifting the weight takes as much as its height changes over the wheel's angle.
    let slope = b * phase.cos() - a * phase.sin();
    let pushed = weight * slope;
    // The angle is exact to the cube of the ripple.
    let least = a.hypot(b).powi(3);
    for (spin_up, pushed) in [(0.0, pushed), (spin_up, pushed + spin_up * gained)] {
        // The weight on the wheel by its lever is the push at the rim times the radius; the tyre is dragged across the whole of that lever.
        let dragged = -scrub * weight * slope.abs() * radius / (2.0 * HALF_TRACK * HALF_TRACK) * ratio;
        for (scrub, dragged) in [(0.0, 0.0), (scrub, dragged)] {
            let load = loads(spin_up, scrub);
            let wanted = [0.5 * (driven + pushed), -(driven + ratio * pushed) / (2.0 * HALF_TRACK) + dragged];
            assert!((load[0] - wanted[0]).abs() < least && (load[1] - wanted[1]).abs() < least, "{load:?} {wanted:?}");
        }
    }
}

#[test]
fn an_encoder_records_means_on_a_lattice() {
    let rig = rig();
    let (truth, time, q) = (rig.truth(&[]), &rig.stretch().time, 0.004);
    let mean = |k: usize| {
        let span = if k == 0 { 1.0 } else { time[k] - time[k - 1] };
        let before = if k == 0 { [0.0; 4] } else { truth[k - 1].1 };
        if k == 0 { [0.3, 0.2] } else { [(truth[k].1[2] - before[2]) / span, (truth[k].1[3] - before[3]) / span] }
    };
    for readout in [Readout::Instantaneous, Readout::IntervalMean] {
        let run = rig.run(&EncoderQuantisation::default(), &[q], readout);
        let error = rig.difference(&run, mean);
        assert!(error < 5e-5, "{error}");
    }
    let run = rig.run(&EncoderQuantisation { counts: true, ..EncoderQuantisation::default() }, &[q], Readout::Instantaneous);
    let (mut counted, mut worst) = ([0.0; 2], 0.0_f64);
    for k in 1..time.len() {
        let span = time[k] - time[k - 1];
        for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
            let counts = (run[0][k] + sign * HALF_TRACK * run[1][k]) * span / q;
            assert!((counts - counts.round()).abs() < 1e-6, "{counts}");
            counted[side] += counts * q;
            worst = worst.max((counted[side] - truth[k].1[2] - sign * HALF_TRACK * truth[k].1[3]).abs());
        }
    }
    // Nothing is lost: the sum of all counts is the distance to within one.
    assert!(worst < 1.01 * q, "{worst}");
}

#[test]
fn a_readout_records_multiples_of_its_steps() {
    let (rig, steps) = (rig(), [0.02, 0.07]);
    let truth = rig.truth(&[]);
    let run = rig.run(&EncoderQuantisation { readout: true, ..EncoderQuantisation::default() }, &steps, Readout::Instantaneous);
    for (i, step) in steps.into_iter().enumerate() {
        let between = |x: f64, y: f64| (x / step - (x / step).round()).abs() < 1e-9 && (x - y).abs() < 0.51 * step;
        assert!(run[i].iter().zip(&truth).all(|(x, (_, y))| between(*x, y[i])), "{i}");
    }
}

#[test]
fn jitter_scatters_by_the_acceleration_and_not_without_a_seed() {
    let rig = rig();
    let (plain, sigma) = (rig.run(&TimestampJitter::default(), &[0.01], Readout::Instantaneous), 0.01);
    let run = rig.run(&TimestampJitter { seed: Some(4) }, &[sigma], Readout::Instantaneous);
    let s = rig.stretch();
    let (mut sum, mut expected) = (0.0, 0.0);
    for k in 1..s.len() {
        let x = [plain[0][k], plain[1][k]];
        let a = base(held(s, s.time[k] - 1e-9), &x)[0];
        sum += (run[0][k] - x[0]).powi(2);
        expected += (sigma * a).powi(2);
    }
    assert!((sum / expected - 1.0_f64).abs() < 0.2, "{sum} {expected}");
    assert_eq!(run, rig.run(&TimestampJitter { seed: Some(4) }, &[sigma], Readout::Instantaneous));
    let none = rig.run(&SensorDelay::default(), &[0.0], Readout::Instantaneous);
    assert_eq!(plain, none);
}

/// What sensors make of the motion is late with the record: what loops keep, what ripples with a wheel's turning, what runs ahead at the motors.
#[test]
fn a_late_record_is_late_by_all_that_sensors_show() {
    const SAMPLES: usize = 3;
    let mut rig = rig();
    let stretch = &mut rig.data.stretches[0];
    stretch.time = (0..stretch.len()).map(|k| 0.05 * k as f64).collect();
    rig.scene = Scene::new(&rig.data, &*rig.model, 2.0 * HALF_TRACK, Some(RADIUS), None);
    let encoders = WheelRadiusMismatch { speeds: Speeds::Encoders, ..WheelRadiusMismatch::default() };
    let ring = WheelEccentricity { wheel: Some(Wheel::Left), ..WheelEccentricity::default() };
    let all: [Box<dyn Effect>; 4] = [Box::new(encoders), Box::new(ring), Box::new(Backlash::default()), Box::new(TrackWidthError {})];
    let late = SensorDelay::default();
    for effect in &all {
        let values = effect.starts(&rig.scene).pop().map_or_else(|| vec![0.1], |start| start.values);
        // What sensors add to means is known from sample to sample only, and what jumps in between is smoothed.
        for (readout, smoothed) in [(Readout::Instantaneous, 1e-6), (Readout::IntervalMean, 0.02)] {
            let run = |effects: &[&dyn Effect], values: &[f64]| {
                let mut simulator = EffectSimulator::new(&*rig.model, &THETA, effects, &rig.scene).unwrap().with_readout(readout);
                simulator.set(&THETA, values).unwrap();
                simulator.set_substeps(8);
                let mut run = vec![Vec::new(); 2];
                simulator.run(0, rig.stretch(), &[0.3, 0.2], &mut run).unwrap();
                run
            };
            let (plain, prompt) = (run(&[], &[]), run(&[&**effect], &values));
            let seen = run(&[&late, &**effect], &[&[0.05 * SAMPLES as f64], &values[..]].concat());
            let name = effect.name();
            let squares = |of: &dyn Fn(usize, usize) -> f64| -> f64 {
                (0..2).flat_map(|i| (SAMPLES + 1..rig.stretch().len()).map(move |k| (i, k))).map(|(i, k)| of(i, k).powi(2)).sum()
            };
            let shows = squares(&|i, k| prompt[i][k] - plain[i][k]);
            let missed = squares(&|i, k| seen[i][k] - prompt[i][k - SAMPLES]);
            assert!(shows > 0.0 && missed < smoothed * shows, "{name}, {readout:?}: {missed} of {shows}");
        }
    }
}
