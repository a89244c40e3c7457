use rand::SeedableRng;
use rand::rngs::StdRng;

use wheelwright_core::ModelConfig;
use wheelwright_core::simulation::Simulator;
use wheelwright_models::VwPdConfig;

use super::*;
use crate::fixture::{Case, NOISE, RADIUS, THETA, TRACK, normal, stamps};
use crate::noise::whitener;

#[test]
fn clean_recordings_raise_no_alarm() {
    let (mut largest, mut sum) = (f64::NEG_INFINITY, 0.0);
    for seed in 0..40 {
        let found = Case::clean(seed).compare(None, |c| examine(c, seed));
        largest = largest.max(found.structure.z);
        sum += found.structure.z;
        assert!(
            found.bursts.is_empty()
                && found.events.is_none()
                && found.memory.is_none()
                && found.order.is_none()
                && found.rhythm.is_none()
                && found.rounding.is_none()
                && found.jitter.is_none()
                && found.lattices.is_empty()
                && found.counts.is_none(),
            "{seed}: {found:?}"
        );
    }
    // z has mean zero and, T being nearly chi-square, deviation one.
    assert!(largest < 4.0 && (sum / 40.0).abs() < 0.5, "largest {largest}, mean {}", sum / 40.0);
}

/// Student's t with three degrees of freedom, of unit variance.
fn student(random: &mut StdRng) -> f64 {
    let chi: f64 = (0..3).map(|_| normal(random).powi(2)).sum();
    normal(random) / chi.sqrt()
}

#[test]
fn heavy_tails_raise_no_alarm() {
    for seed in 0..20 {
        let case = Case::new(seed, |_, i, y, _, random| y + NOISE[i] * student(random));
        let found = case.compare(None, |c| examine(c, seed));
        assert!(
            !found.structure.significant()
                && found.bursts.is_empty()
                && found.events.is_none()
                && found.order.is_none()
                && found.rhythm.is_none()
                && found.lattices.is_empty(),
            "{seed}: {found:?}"
        );
    }
}

#[test]
fn a_value_far_out_where_a_command_is_large_is_no_structure() {
    let mut case = Case::clean(5);
    let stretch = &mut case.data.stretches[0];
    let peak = (0..stretch.time.len()).max_by(|a, b| stretch.inputs[0][*a].total_cmp(&stretch.inputs[0][*b])).unwrap();
    // One command and one value, as far out as Student's t with three degrees of freedom goes in a long recording.
    stretch.inputs[0][peak] *= 4.0;
    (1..=8).for_each(|k| stretch.outputs[0][peak + k] += 25.0 * NOISE[0] * f64::from(u8::from(k % 4 == 0)));
    let found = case.compare(None, |c| examine(c, 5)).structure;
    assert!(!found.significant(), "{found:?}");
}

#[test]
fn friction_that_was_left_out_is_structure_of_signs() {
    let case = Case::new(1, |_, i, y, _, random| y + NOISE[i] * normal(random) - if i == 0 { 0.01 * (y / 0.005).tanh() } else { 0.0 });
    let found = case.compare(None, |c| examine(c, 1)).structure;
    assert!(found.significant() && found.output == 0 && found.of.contains("sign"), "{found:?}");
}

#[test]
fn a_push_is_a_burst_at_its_time() {
    let case = Case::new(2, |t, i, y, _, random| y + NOISE[i] * normal(random) + if (30.0..31.5).contains(&t) { 0.02 } else { 0.0 });
    let bursts = case.compare(None, |c| examine(c, 2)).bursts;
    assert!(bursts.iter().any(|b| b.time.0 >= 29.0 && b.time.1 <= 33.0), "{bursts:?}");
    assert!(bursts.iter().all(|b| b.time.1 > 29.0 && b.time.0 < 33.0), "{bursts:?}");
}

/// What a robot does that stops for a moment every few seconds, and then comes up to its speed again.
#[test]
fn stops_that_come_again_are_events_and_noise_far_out_that_is_remembered_is_none() {
    let case = Case::new(6, |t, i, y, _, random| {
        let since = t % 7.0;
        let stop = if since < 0.2 { since / 0.2 } else { (-(since - 0.2) / 0.4).exp() };
        y + NOISE[i] * normal(random) - if i == 0 { 20.0 * NOISE[0] * stop } else { 0.0 }
    });
    let found = case.compare(None, events::find).expect("events");
    assert!(found.output == 0 && found.count >= 5 && found.first < 1.0, "{found:?}");
    // Values of heavy tails of which the next sample remembers 0.8.
    for seed in 0..20 {
        let mut state = [0.0; 2];
        let case = Case::new(seed, |_, i, y, _, random| {
            state[i] = 0.8 * state[i] + 0.6 * student(random);
            y + NOISE[i] * state[i]
        });
        let white = case.compare(None, |c| {
            let (white, _) = by_its_past(c);
            events::find(&Comparison { white: &white, ..*c })
        });
        assert!(white.is_none(), "{seed}: {white:?}");
    }
}

/// Now and then an output jumps for four samples; a model that has these jumps two samples early misses each of them twice.
#[test]
fn what_an_effect_does_a_little_late_is_no_event() {
    let jump = |t: f64| if (t + 1e-6).rem_euclid(7.0) < 0.2 { 20.0 * NOISE[0] } else { 0.0 };
    let mut case = Case::new(6, |t, i, y, _, random| y + NOISE[i] * normal(random) + if i == 0 { jump(t - 0.1) } else { 0.0 });
    let without = case.truth.clone();
    for (stretch, run) in case.data.stretches.iter().zip(&mut case.truth) {
        run[0].iter_mut().zip(&stretch.time).for_each(|(y, t)| *y += jump(*t));
    }
    let found = |moments: bool| case.compare(Some(&without), |c| events::find(&Comparison { moments, ..*c })).map(|events| events.count);
    assert!(found(false).is_some_and(|count| count > 5), "{:?}", found(false));
    assert_eq!(found(true), None);
}

/// What is left behind the last whole second of a stretch may be a single sample.
#[test]
fn a_value_far_out_in_the_last_sample_is_no_burst() {
    let mut case = Case::clean(4);
    for (stretch, truth) in case.data.stretches.iter_mut().zip(&mut case.truth) {
        let rows = stretch.time.len();
        assert_eq!(rows % 20, 0, "whole seconds at 20 Hz");
        let cut = |values: &mut Vec<f64>| values.truncate(rows - 19);
        cut(&mut stretch.time);
        stretch.inputs.iter_mut().chain(&mut stretch.outputs).chain(truth).for_each(cut);
        stretch.outputs[0][rows - 20] += 6.0 * NOISE[0];
    }
    let found = case.compare(None, |c| bursts::find(c, 4, None));
    assert!(found.is_empty(), "{found:?}");
}

/// An autoregression of first order and unit variance for each output, one stretch after the other.
fn coloured(coefficient: f64) -> impl FnMut(usize, &mut StdRng) -> f64 {
    let mut state = [0.0; 2];
    move |i, random| {
        state[i] = coefficient * state[i] + (1.0 - coefficient * coefficient).sqrt() * normal(random);
        state[i]
    }
}

/// A rest whitened by its own past, and what whitens each output so.
fn by_its_past(c: &Comparison<'_>) -> (Vec<Channels>, [impl Fn(&mut [f64]) + use<>; 2]) {
    let past = [0, 1].map(|i| whitener(&c.white.iter().map(|stretch| stretch[i].clone()).collect::<Vec<_>>(), &[], 0.0));
    let mut white = c.white.to_vec();
    white.iter_mut().flat_map(|stretch| stretch.iter_mut().zip(&past)).for_each(|(series, past)| past(series));
    (white, past)
}

/// The structure of a rest that is whitened by its own past, whatever makes it.
fn whitened_by_itself(case: &Case) -> Structure {
    case.compare(None, |c| {
        let (white, past) = by_its_past(c);
        let mut jacobian = c.jacobian.to_vec();
        for (matrix, past) in jacobian.iter_mut().zip(&past) {
            for mut column in matrix.column_iter_mut() {
                c.ranges().into_iter().for_each(|rows| past(&mut column.as_mut_slice()[rows]));
            }
        }
        let whiten = |i: usize, series: &mut [f64]| {
            (c.whiten)(i, series);
            past[i](series);
        };
        structure::measure(&Comparison { white: &white, whiten: &whiten, jacobian: &jacobian, ..*c }, None)
    })
}

#[test]
fn misfit_that_passes_for_slow_noise_is_structure_and_slow_noise_is_none() {
    for seed in 0..10 {
        let mut noise = coloured(0.9);
        let sensors = Case::new(seed, |_, i, y, _, random| y + NOISE[i] * noise(i, random));
        let dragged = Case::new(seed, |_, i, y, _, random| y + NOISE[i] * normal(random) - if i == 0 { 0.2 * y * y.abs() } else { 0.0 });
        let [slow, misfit] = [sensors, dragged].map(|case| whitened_by_itself(&case));
        assert!(slow.z < 4.0 && misfit.significant(), "{seed}: {slow:?} {misfit:?}");
    }
}

#[test]
fn what_lasts_or_comes_again_is_a_memory_and_coloured_noise_is_none() {
    for seed in 0..20 {
        let mut noise = coloured(0.9);
        let sensors = Case::new(seed, |_, i, y, _, random| y + NOISE[i] * noise(i, random));
        assert_eq!(sensors.compare(None, |c| examine(c, seed)).memory, None, "{seed}");
        // Correlated over 2.5 s, beside as much white noise.
        let mut wind = coloured(0.98);
        let blown =
            Case::new(seed, |_, i, y, _, random| y + NOISE[i] * (normal(random) + if i == 1 { 2.0 * wind(i, random) } else { 0.0 }));
        let memory = blown.compare(None, |c| examine(c, seed)).memory.unwrap();
        assert!(memory.output == 1 && memory.correlation > 0.25 && memory.share > 0.2, "{seed}: {memory:?}");
        // What swings within two seconds is nothing of itself after one, and all of itself after two.
        let swung =
            Case::new(seed, |t, i, y, _, random| y + NOISE[i] * (normal(random) + if i == 0 { 2.0 * (3.1 * t).sin() } else { 0.0 }));
        let memory = swung.compare(None, |c| examine(c, seed)).memory.unwrap();
        let swings = memory.lag * 3.1 / std::f64::consts::TAU;
        assert!(memory.output == 0 && (swings - swings.round()).abs() < 0.1 && memory.correlation > 0.5, "{seed}: {memory:?}");
    }
}

/// Commands as a driver takes them that knows multiples of a step only.
fn rounded(seed: u64, input: usize, step: f64, cut_off: bool) -> Case {
    let mut case = Case::clean(seed);
    let model = VwPdConfig::default().build().unwrap();
    let mut simulator = Simulator::new(&*model, &THETA).unwrap();
    for (stretch, truth) in case.data.stretches.iter_mut().zip(&case.truth) {
        let mut taken = stretch.clone();
        taken.inputs[input].iter_mut().for_each(|u| *u = step * if cut_off { (*u / step).trunc() } else { (*u / step).round() });
        let mut run = vec![Vec::new(); 2];
        simulator.run(&taken, &[0.0, 0.0], &mut run).unwrap();
        for (i, series) in stretch.outputs.iter_mut().enumerate() {
            series.iter_mut().zip(&run[i]).zip(&truth[i]).for_each(|((y, with), without)| *y += with - without);
        }
    }
    case
}

#[test]
fn commands_in_steps_are_a_rounding_and_a_dead_zone_is_none() {
    for (seed, input, step, cut_off) in [(1, 0, 0.03, false), (2, 1, 0.06, false), (3, 0, 0.05, true)] {
        let found = rounded(seed, input, step, cut_off).compare(None, |c| examine(c, seed)).rounding.unwrap();
        assert!(found.input == Some(input) && (found.step / step - 1.0).abs() < 0.01, "{found:?}");
    }
    // One step that holds all but the largest commands is a dead zone.
    assert_eq!(rounded(4, 0, 0.4, true).compare(None, |c| examine(c, 4)).rounding, None);
}

/// A push that comes and goes every seven seconds, along a heading that turns or not.
#[test]
fn a_swell_is_a_rhythm() {
    for turning in [0.0, 0.3] {
        let case = Case::new(4, |t, i, y, _, random| {
            let swell = if i == 0 { (std::f64::consts::TAU / 7.0 * t).sin() * (turning * t).cos() } else { 0.0 };
            y + NOISE[i] * (normal(random) + swell)
        });
        let rhythm = case.compare(None, |c| examine(c, 3)).rhythm.unwrap();
        assert!((rhythm.frequency - 1.0 / 7.0).abs() < 0.02 + turning / std::f64::consts::TAU, "{rhythm:?}");
    }
}

#[test]
fn a_cogging_gear_is_a_line_at_its_order() {
    let mut angle = [0.0; 2];
    let mut speeds = [0.0; 2];
    let mut seen = f64::NAN;
    let plain = Case::clean(3);
    // Angle of the right wheel along the true course.
    let right: Vec<f64> =
        plain.truth.iter().flat_map(|run| (0..run[0].len()).map(|k| run[0][k] + 0.5 * TRACK * run[1][k]).collect::<Vec<_>>()).collect();
    let mut row = 0;
    let case = Case::new(3, |t, i, y, _, random| {
        if i == 0 {
            if t != seen {
                angle[1] += 0.05 * right[row % right.len()] / RADIUS;
                speeds[1] = right[row % right.len()];
                row += 1;
                seen = t;
            }
            return y + NOISE[0] * normal(random) + 0.004 * (7.0 * angle[1]).sin();
        }
        y + NOISE[i] * normal(random)
    });
    let line = case.compare(None, |c| examine(c, 3)).order.unwrap();
    assert!(line.wheel == 1 && (line.order - 7.0).abs() < 0.05 && !line.kinematic, "{line:?}");
}

#[test]
fn jittering_stamps_show_their_jitter() {
    let mut hits = 0;
    for seed in 0..10 {
        let case = Case::jittering(seed, 0.015);
        if let Some(jitter) = case.compare(None, |c| examine(c, seed)).jitter {
            hits += usize::from((jitter.deviation - 0.015).abs() < 3.0 * jitter.error);
        }
    }
    assert!(hits >= 9, "{hits} of 10");
}

/// Less than a tenth of the noise's variance on the whole, but more where speeds change.
#[test]
fn jitter_counts_where_it_scatters() {
    let jitters = |seed: u64| {
        let case = Case::jittering(seed, 0.003);
        case.compare(None, |c| examine(c, seed)).jitter.is_some()
    };
    assert!((0..10).filter(|seed| jitters(*seed)).count() >= 9);
}

/// A few samples at which the simulated output jumps would have all the weight.
#[test]
fn a_jump_does_not_hide_jitter() {
    let jitters = |seed: u64| {
        let mut case = Case::jittering(seed, 0.015);
        for (run, stretch) in case.truth.iter_mut().zip(&mut case.data.stretches) {
            run.iter_mut().chain(&mut stretch.outputs).for_each(|series| series[400] += 3.0);
        }
        case.compare(None, |c| examine(c, seed)).jitter.is_some()
    };
    assert!((0..10).filter(|seed| jitters(*seed)).count() >= 9);
}

/// At stamps as far off as they are apart an estimate may say a little more.
#[test]
fn stamps_may_be_off_by_their_distance_and_not_by_twice_that() {
    let found = |share: f64, seed: u64| {
        let case = Case::jittering(seed, 0.05 * share);
        case.compare(None, |c| examine(c, seed)).jitter.is_some()
    };
    assert!((0..10).filter(|seed| found(1.0, *seed)).count() >= 9);
    assert!((0..10).all(|seed| !found(2.0, seed)));
}

#[test]
fn counts_are_a_lattice_and_its_quantum_is_found() {
    let quantum = 0.012;
    let mut case =
        Case::new(
            5,
            |_, i, y, _, random| {
                if i == 0 { ((y + 0.001 * normal(random)) / quantum).round() * quantum } else { y + NOISE[1] * normal(random) }
            },
        );
    case.noise = [quantum * 0.3, NOISE[1]];
    let lattices = case.compare(None, |c| examine(c, 5)).lattices;
    assert!(lattices.len() == 1 && lattices[0].output == 0, "{lattices:?}");
    // The same values are multiples of its fractions too.
    assert!((quantum / lattices[0].quantum - 1.0).abs() < 0.01 && lattices[0].coherence > 0.9, "{lattices:?}");
}

/// Counts of both wheels as forward speed and turning, computed with a track `wrong` times the true one, with noise beside.
fn counted(seed: u64, travel: f64, noise: f64, wrong: f64) -> Option<Counts> {
    let plain = Case::new(seed, |_, _, y, _, _| y);
    let period = 0.05;
    let mut case = Case::clean(seed);
    for (stretch, truth) in case.data.stretches.iter_mut().zip(&plain.truth) {
        let (mut angle, mut random) = ([0.3 * travel, 0.7 * travel], StdRng::seed_from_u64(seed));
        for (k, (v, omega)) in truth[0].iter().zip(&truth[1]).enumerate() {
            let sides = [v - 0.5 * TRACK * omega, v + 0.5 * TRACK * omega];
            let counts = [0, 1].map(|i| {
                let before = (angle[i] / travel).floor();
                angle[i] += sides[i] * period;
                ((angle[i] / travel).floor() - before) * travel / period
            });
            stretch.outputs[0][k] = 0.5 * (counts[0] + counts[1]) + noise * normal(&mut random);
            stretch.outputs[1][k] = (counts[1] - counts[0]) / (wrong * TRACK) + noise / TRACK * normal(&mut random);
        }
    }
    let rounding = travel / period / 24.0_f64.sqrt();
    case.noise = [f64::hypot(noise, rounding), f64::hypot(noise / TRACK, rounding / (0.5 * TRACK))];
    case.compare(None, |c| examine(c, seed)).counts
}

#[test]
fn counts_of_wheels_are_found_behind_noise_and_a_track_that_is_a_little_off() {
    let travel = 0.0012;
    // Without noise the steps of both outputs tell the track themselves.
    for (noise, wrong) in [(0.0, 1.0), (0.004, 1.0), (0.004, 1.015), (0.0, 1.6)] {
        let found = counted(8, travel, noise, wrong).expect("counts");
        assert!((found.travel / travel - 1.0).abs() < 0.02, "{noise} {wrong}: {found:?}");
    }
    assert_eq!(counted(8, travel, 0.03, 1.0), None, "behind so much noise none are seen");
}

#[test]
fn a_readout_of_few_digits_is_no_count() {
    let digits = [0.012, 0.07];
    let mut case = Case::new(9, |_, i, y, _, random| ((y + 0.2 * digits[i] * normal(random)) / digits[i]).round() * digits[i]);
    case.noise = digits.map(|q| 0.35 * q);
    let found = case.compare(None, |c| examine(c, 9));
    assert!(found.lattices.len() == 2 && found.counts.is_none(), "{found:?}");
}

#[test]
fn readouts_that_happen_to_suit_the_track_are_no_counts() {
    let digits = 0.012;
    for share in [0.6, 0.8, 0.9, 0.98, 1.0, 1.02, 1.1, 1.3] {
        // A step of turning that moves a wheel by about as much as a step of forward speed.
        let steps = [digits, share * digits / (0.5 * TRACK)];
        let mut case = Case::new(9, |_, i, y, _, random| ((y + 0.4 * steps[i] * normal(random)) / steps[i]).round() * steps[i]);
        case.noise = steps.map(|q| 0.5 * q);
        let found = case.compare(None, |c| examine(c, 9));
        assert!(found.counts.is_none(), "{share}: {:?}", found.counts);
    }
}

/// Rounding is silent within a step and loud on the way from one to the next.
#[test]
fn a_readout_that_is_loud_in_motion_is_no_jitter() {
    let found = |deviation: f64| {
        let jitters = |seed: u64| {
            let off = stamps(seed);
            let mut case = Case::new(seed, |t, i, y, slope, random| {
                let step = 6.0 * NOISE[i];
                ((y + deviation * slope * off(t) + 0.4 * NOISE[i] * normal(random)) / step).round() * step
            });
            // That of the readings, as a fit knows it.
            case.noise = NOISE.map(|noise| noise * (0.4_f64.powi(2) + 6.0_f64.powi(2) / 12.0).sqrt());
            case.compare(None, |c| examine(c, seed)).jitter.is_some()
        };
        (0..6).filter(|seed| jitters(*seed)).count()
    };
    // What is left of the rows hides it once.
    let (rounded, jittering) = (found(0.0), found(0.03));
    assert!(rounded == 0 && jittering >= 5, "{rounded} {jittering}");
}

#[test]
fn motion_that_is_missed_while_speeding_up_is_no_jitter() {
    for seed in 0..10 {
        let case = Case::new(seed, |_, i, y, slope, random| y + NOISE[i] * normal(random) + 0.03 * slope);
        assert_eq!(case.compare(None, |c| examine(c, seed)).jitter, None, "{seed}");
    }
}

/// A stamp moves all outputs of its row.
#[test]
fn what_scatters_in_each_output_by_itself_is_no_jitter() {
    let by_itself = |seed: u64| Case::new(seed, |_, i, y, slope, random| y + NOISE[i] * normal(random) + 0.015 * slope * normal(random));
    assert!((0..10).all(|seed| by_itself(seed).compare(None, |c| examine(c, seed)).jitter.is_none()));
}

/// As much less as two standard errors are of one output alone.
#[test]
fn both_outputs_tell_of_jitter_that_neither_is_sure_of() {
    let jitters = |seed: u64| Case::jittering(seed, 0.0022).compare(None, |c| examine(c, seed)).jitter.is_some();
    assert!((0..10).filter(|seed| jitters(*seed)).count() >= 9);
}

#[test]
fn where_stamps_jitter_scatter_is_no_structure() {
    let mut significant = 0;
    for seed in 0..10 {
        let case = Case::jittering(seed, 0.03);
        significant += usize::from(case.compare(None, |c| examine(c, seed)).structure.significant());
    }
    assert_eq!(significant, 0);
}

#[test]
fn steady_speeds_are_no_lattice() {
    // All speeds multiples of 0.05 m/s with little noise: clusters, but of the commands.
    for seed in 0..10 {
        let case = Case::new(seed, |_, i, y, _, random| (y / 0.05).round() * 0.05 + NOISE[i] * normal(random));
        let lattices = case.compare(None, |c| examine(c, seed)).lattices;
        assert!(lattices.is_empty(), "{seed}: {lattices:?}");
    }
}

/// What a coarse readout adds is there again whenever the robot drives alike.
#[test]
fn a_coarse_readout_is_no_memory() {
    for slow in [1.0, 4.0] {
        let (mut case, mut random) = (Case::clean(3), StdRng::seed_from_u64(9));
        for (stretch, truth) in case.data.stretches.iter_mut().zip(&mut case.truth) {
            let motion: Vec<f64> = stretch.time.iter().map(|t| 0.4 * (t / slow).sin() + 0.1).collect();
            for (i, y) in stretch.outputs.iter_mut().enumerate() {
                let step = 8.0 * NOISE[i];
                *y = motion.iter().map(|x| (x / step).round() * step + NOISE[i] * normal(&mut random)).collect();
                truth[i].clone_from(&motion);
            }
        }
        let found = case.compare(None, |c| examine(c, 3));
        let coarse: Vec<usize> = found.coarse.iter().map(|coarse| coarse.output).collect();
        assert!(
            !coarse.is_empty() && found.memory.is_none_or(|memory| !coarse.contains(&memory.output)),
            "{slow}: {coarse:?} {:?}",
            found.memory
        );
    }
}
