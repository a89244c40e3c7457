//! Effects between command and drive against integrations with very small steps, each equation written anew.

use crate::rig;

use crate::common::{HALF_TRACK, THETA, base, data, difference, held, model, scene};
use wheelwright_core::effect::{Effect, Estimate};
use wheelwright_diagnosis::effects::{
    ActuatorLag, Axis, BatterySag, CommandDelay, CommandOffset, DeadZone, GainAsymmetry, IntegralAction, SagLaw, SlewLimit, TorqueLaw,
    TorqueSaturation, VelocitySaturation, Wheel,
};

/// Left and right of forward and turning.
fn wheels([v, w]: [f64; 2]) -> [f64; 2] {
    [v - HALF_TRACK * w, v + HALF_TRACK * w]
}

/// Forward and turning of left and right.
fn body([l, r]: [f64; 2]) -> [f64; 2] {
    [(l + r) / 2.0, (r - l) / (2.0 * HALF_TRACK)]
}

/// Times at which commands arrive that are late by `tau`.
fn late(tau: f64) -> Vec<f64> {
    data(&*model()).stretches[0].time.iter().map(|t| t + tau).collect()
}

#[test]
fn a_delay_of_each_axis_shifts_each_command_by_itself() {
    let [forward, turn] = [0.137, 0.044];
    let switches = [late(forward), late(turn)].concat();
    let error = difference(&[&CommandDelay { each_axis: true }], &[forward, turn], &switches, [0.3, 0.2], |s, t, x| {
        base([held(s, t - forward)[0], held(s, t - turn)[1]], x)
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn a_lag_of_each_axis_filters_each_command_by_itself() {
    let [forward, turn] = [0.03, 0.22];
    let lag = ActuatorLag { each_axis: true, ..ActuatorLag::default() };
    let error = difference(&[&lag], &[forward, turn], &[], [0.3, 0.2, 0.3, 0.2], |s, t, x| {
        let (u, a) = (held(s, t), base([x[2], x[3]], x));
        [a[0], a[1], (u[0] - x[2]) / forward, (u[1] - x[3]) / turn]
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn a_resonance_rings() {
    for (tau, damping) in [(0.02, 0.15), (0.09, 0.5), (0.09, 1.0)] {
        let lag = ActuatorLag { resonant: true, ..ActuatorLag::default() };
        let error = difference(&[&lag], &[tau, damping], &[], [0.3, 0.2, 0.3, 0.2, 0.0, 0.0], |s, t, x| {
            let (u, a) = (held(s, t), base([x[2], x[3]], x));
            let pull = |u: f64, y: f64, slope: f64| (u - y - 2.0 * damping * tau * slope) / (tau * tau);
            [a[0], a[1], x[4], x[5], pull(u[0], x[2], x[4]), pull(u[1], x[3], x[5])]
        });
        assert!(error < 1e-4, "{tau} s, {damping}: {error}");
    }
}

#[test]
fn what_has_passed_a_threshold_passes_down_to_a_share_of_it() {
    let (d, release) = (0.25, 0.4);
    let recording = data(&*model());
    let stretch = &recording.stretches[0];
    // Of each wheel, whether its commands pass, from row to row.
    let mut passing = vec![[false; 2]];
    for k in 0..stretch.len() {
        let (before, commands) = (passing[k], wheels([stretch.inputs[0][k], stretch.inputs[1][k]]));
        passing.push([0, 1].map(|i| commands[i].abs() > if before[i] { release * d } else { d }));
    }
    let width = 0.008 * scene().scales.command;
    let pass = |s: &wheelwright_core::Stretch, t: f64| {
        let passes = passing[s.time.partition_point(|row| *row <= t).max(1)];
        let commands = wheels(held(s, t));
        body([0, 1].map(|i| {
            let threshold = if passes[i] { release * d } else { d };
            0.5 * commands[i] * (1.0 + ((commands[i].abs() - threshold) / width).tanh())
        }))
    };
    let holding = DeadZone { holding: true, ..DeadZone::default() };
    let error = difference(&[&holding], &[d, release], &[], [0.3, 0.2], |s, t, x| base(pass(s, t), x));
    let without = difference(&[&DeadZone::default()], &[d], &[], [0.3, 0.2], |s, t, x| base(pass(s, t), x));
    assert!(error < 5e-5 && without > 100.0 * error, "{error} {without}");
}

#[test]
fn a_dead_zone_lets_no_small_command_pass() {
    let d = 0.11;
    let width = 0.008 * scene().scales.command;
    let jump = |u: f64| 0.5 * u * (1.0 + ((u.abs() - d) / width).tanh());
    let less = |u: f64| {
        if u > d {
            u - d
        } else if u < -d {
            u + d
        } else {
            0.0
        }
    };
    let both = difference(&[&DeadZone::default()], &[d], &[], [0.3, 0.2], |s, t, x| base(body(wheels(held(s, t)).map(jump)), x));
    let subtracting = DeadZone { subtracting: true, ..DeadZone::default() };
    let soft = difference(&[&subtracting], &[d], &[], [0.3, 0.2], |s, t, x| base(body(wheels(held(s, t)).map(less)), x));
    let left = DeadZone { wheel: Some(Wheel::Left), ..DeadZone::default() };
    let left = difference(&[&left], &[d], &[], [0.3, 0.2], |s, t, x| {
        let [l, r] = wheels(held(s, t));
        base(body([jump(l), r]), x)
    });
    let turning = DeadZone { axis: Some(Axis::Omega), ..DeadZone::default() };
    let turning = difference(&[&turning], &[d], &[], [0.3, 0.2], |s, t, x| {
        let [v, w] = held(s, t);
        base([v, jump(w)], x)
    });
    for error in [both, soft, left, turning] {
        assert!(error < 5e-5, "{both} {soft} {left} {turning}");
    }
}

#[test]
fn a_limit_clips_wheels_or_an_axis() {
    let m = 0.33;
    let clip = |u: f64| u.max(-m).min(m);
    let both = difference(&[&VelocitySaturation::default()], &[m], &[], [0.3, 0.2], |s, t, x| base(body(wheels(held(s, t)).map(clip)), x));
    let forward = VelocitySaturation { axis: Some(Axis::V), ..VelocitySaturation::default() };
    let forward = difference(&[&forward], &[m], &[], [0.3, 0.2], |s, t, x| {
        let [v, w] = held(s, t);
        base([clip(v), w], x)
    });
    assert!(both < 5e-5 && forward < 5e-5, "{both} {forward}");
}

#[test]
fn a_wheel_at_its_limit_may_slow_the_other_down() {
    let m = 0.3;
    let together = VelocitySaturation { together: true, ..VelocitySaturation::default() };
    let error = difference(&[&together], &[m], &[], [0.3, 0.2], |s, t, x| {
        let [l, r] = wheels(held(s, t));
        let slower = 1.0_f64.min(m / l.abs().max(r.abs()));
        base(body([l * slower, r * slower]), x)
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn a_soft_limit_bends_more_the_nearer_it_is() {
    for (limit, hardness) in [(0.4, 2.0), (0.3, 6.0)] {
        let soft = VelocitySaturation { soft: true, ..VelocitySaturation::default() };
        let bent = |u: f64| u / (1.0 + (u.abs() / limit).powf(hardness)).powf(1.0 / hardness);
        let error = difference(&[&soft], &[limit, hardness], &[], [0.3, 0.2], |s, t, x| base(body(wheels(held(s, t)).map(bent)), x));
        assert!(error < 5e-5, "{limit} {hardness}: {error}");
        let soft = VelocitySaturation { axis: Some(Axis::V), ..soft };
        let error = difference(&[&soft], &[limit, hardness], &[], [0.3, 0.2], |s, t, x| {
            let [v, w] = held(s, t);
            base([bent(v), w], x)
        });
        assert!(error < 5e-5, "{limit} {hardness} of the forward command: {error}");
    }
}

#[test]
fn before_a_robot_that_stands_still_nothing_was_commanded() {
    let mut rig = rig::body();
    let moving = rig.run(&[&CommandDelay::default()], &[0.2]);
    rig.data.stretches[0].outputs.iter_mut().for_each(|c| c[0] = 0.0);
    rig.start = [0.0, 0.0];
    let still = rig.run(&[&CommandDelay::default()], &[0.2]);
    let ramped = rig.run(&[&SlewLimit::default()], &[0.4, 1.3]);
    let first = rig.stretch().time.iter().position(|t| *t > 0.2).unwrap();
    assert!((1..first).all(|k| still[0][k] == 0.0 && moving[0][k] != 0.0), "{:?}", &still[0][..first]);
    assert!(still[0][first + 2] > 0.0, "the first command takes effect after its delay");
    // A ramp of rate a passes through a lag: y = a (t − T + T e^{−t/T}) / th4 at most.
    let (t, lag) = (rig.stretch().time[2], 0.26 / 1.02);
    let risen = 0.4 / 1.02 * (t - lag + lag * (-t / lag).exp());
    assert!((ramped[0][2] / risen - 1.0).abs() < 1e-3, "{} {risen}", ramped[0][2]);
}

/// A ramp as a very fast pursuit of limited speed.
fn ramp(goal: f64, at: f64, rate: f64) -> f64 {
    ((goal - at) / 1e-4).max(-rate).min(rate)
}

#[test]
fn a_ramp_bounds_the_rate_of_each_axis() {
    for (forward, turn) in [(0.4, 1.3), (3.0, 0.8)] {
        let error = difference(&[&SlewLimit::default()], &[forward, turn], &[], [0.3, 0.2, 0.3, 0.2], |s, t, x| {
            let (u, a) = (held(s, t), base([x[2], x[3]], x));
            [a[0], a[1], ramp(u[0], x[2], forward), ramp(u[1], x[3], turn)]
        });
        assert!(error < 5e-5, "{forward} {turn}: {error}");
    }
}

#[test]
fn a_recording_may_begin_while_a_ramp_is_under_way() {
    let (whole, ramp, rates) = (rig::body(), SlewLimit::default(), [0.2, 0.6]);
    let run = whole.run(&[&ramp], &rates);
    let mut worst: f64 = 0.0;
    for cut in [160, 320, 480, 640] {
        let mut rest = rig::body();
        rest.data.stretches[0] = whole.stretch().slice(cut..whole.stretch().len());
        rest.start = [run[0][cut], run[1][cut]];
        rest.data.stretches[0].outputs = run.iter().map(|y| y[cut..].to_vec()).collect();
        let from_there = rest.run(&[&ramp], &rates);
        for (y, there) in run.iter().zip(&from_there) {
            let (size, off) = (y.iter().fold(0.0, |a: f64, y| a.max(y.abs())), y[cut..].iter().zip(there).map(|(a, b)| (a - b).abs()));
            worst = worst.max(off.fold(0.0, f64::max) / size);
        }
    }
    assert!(worst < 0.2, "{worst}");
}

/// A robot in motion to which the first command has just come: what delays, filters and ramps had before is what holds its speed.
#[test]
fn a_recording_may_begin_in_motion_with_a_new_command() {
    let whole = rig::body();
    let (lag, delay, ramp) = (ActuatorLag::default(), CommandDelay::default(), SlewLimit::default());
    let effects: [(&dyn Effect, &[f64]); 3] = [(&lag, &[0.3]), (&delay, &[0.3]), (&ramp, &[0.5, 1.2])];
    for (effect, values) in effects {
        let run = whole.run(&[effect], values);
        let changes = |k: &usize| (0..2).any(|i| (whole.stretch().inputs[i][*k] - whole.stretch().inputs[i][k - 1]).abs() > 0.1);
        let settled =
            |k: &usize| (0..2).all(|i| whole.stretch().inputs[i][k - 30..*k].iter().all(|u| *u == whole.stretch().inputs[i][*k - 1]));
        let cuts: Vec<usize> = (100..700).filter(|k| changes(k) && settled(k)).collect();
        assert!(!cuts.is_empty());
        for cut in cuts {
            let mut rest = rig::body();
            rest.data.stretches[0] = whole.stretch().slice(cut..whole.stretch().len());
            rest.start = [run[0][cut], run[1][cut]];
            rest.data.stretches[0].outputs = run.iter().map(|y| y[cut..].to_vec()).collect();
            let there = rest.run(&[effect], values);
            for (y, there) in run.iter().zip(&there) {
                let size = y.iter().fold(0.0, |a: f64, y| a.max(y.abs()));
                let off = y[cut..].iter().zip(there).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / size;
                assert!(off < 0.2, "{} at {cut}: {off}", effect.name());
            }
        }
    }
}

#[test]
fn a_ramp_may_settle_on_its_goal() {
    let settling = SlewLimit { settling: true, ..SlewLimit::default() };
    for (forward, turn, time) in [(0.4, 1.3, 0.3), (3.0, 0.8, 0.1), (0.5, 9.0, 0.02)] {
        let follow = |goal: f64, at: f64, rate: f64| ((goal - at) / time).max(-rate).min(rate);
        let error = difference(&[&settling], &[forward, turn, time], &[], [0.3, 0.2, 0.3, 0.2], |s, t, x| {
            let (u, a) = (held(s, t), base([x[2], x[3]], x));
            [a[0], a[1], follow(u[0], x[2], forward), follow(u[1], x[3], turn)]
        });
        assert!(error < 1e-3, "{forward} {turn} {time}: {error}");
    }
}

#[test]
fn a_ramp_may_set_out_and_arrive_gently() {
    let easing = SlewLimit { easing: true, ..SlewLimit::default() };
    for (forward, turn, rising) in [(0.4_f64, 1.3_f64, 0.3), (3.0, 0.8, 0.1), (0.5, 9.0, 0.6)] {
        // Of all rates that which still comes to rest on the goal is wanted, and followed within a millisecond: what comes to rest in a tenth of a second is a hundredth late.
        let jerk = |goal: f64, [at, pace]: [f64; 2], rate: f64| {
            let (far, most) = (goal - at, rate / rising);
            let wanted = rate.min((2.0 * most * far.abs()).sqrt()).copysign(far);
            ((wanted - pace) / 1e-3).clamp(-most, most)
        };
        let error = difference(&[&easing], &[forward, turn, rising], &[], [0.3, 0.2, 0.3, 0.2, 0.0, 0.0], |s, t, x| {
            let (u, a) = (held(s, t), base([x[2], x[3]], x));
            [a[0], a[1], x[4], x[5], jerk(u[0], [x[2], x[4]], forward), jerk(u[1], [x[3], x[5]], turn)]
        });
        assert!(error < 5e-3, "{forward} {turn} {rising}: {error}");
    }
}

#[test]
fn a_ramp_may_act_on_wheels_or_on_one_axis() {
    let wheel = SlewLimit { wheels: true, ..SlewLimit::default() };
    let [l, r] = wheels([0.3, 0.2]);
    let at_wheels = difference(&[&wheel], &[0.7], &[], [0.3, 0.2, l, r], |s, t, x| {
        let ([l, r], a) = (wheels(held(s, t)), base(body([x[2], x[3]]), x));
        [a[0], a[1], ramp(l, x[2], 0.7), ramp(r, x[3], 0.7)]
    });
    let turning = SlewLimit { axis: Some(Axis::Omega), ..SlewLimit::default() };
    let turning = difference(&[&turning], &[1.1], &[], [0.3, 0.2, 0.2], |s, t, x| {
        let (u, a) = (held(s, t), base([held(s, t)[0], x[2]], x));
        [a[0], a[1], ramp(u[1], x[2], 1.1)]
    });
    assert!(at_wheels < 5e-5 && turning < 5e-5, "{at_wheels} {turning}");
}

#[test]
fn a_ramp_may_slow_down_at_another_rate() {
    let pursuit = |goal: f64, at: f64, [up, down, back]: [f64; 3]| {
        let rate = if goal * at < 0.0 {
            back
        } else if goal.abs() < at.abs() {
            down
        } else {
            up
        };
        ramp(goal, at, rate)
    };
    // The way to zero of a command that reverses is slowing down, speeding up, or neither.
    for [forward, turn, braking, unwinding, back, over] in
        [[0.4, 1.3, 1.1, 0.6, 1.1, 0.6], [1.2, 0.8, 0.5, 3.0, 1.2, 0.8], [0.6, 1.0, 1.0, 2.0, 0.8, 3.0]]
    {
        let axes = SlewLimit { slowing: true, ..SlewLimit::default() };
        let error = difference(
            &[&axes],
            &[forward, turn, braking, unwinding, back / braking, over / unwinding],
            &[],
            [0.3, 0.2, 0.3, 0.2],
            |s, t, x| {
                let (u, a) = (held(s, t), base([x[2], x[3]], x));
                [a[0], a[1], pursuit(u[0], x[2], [forward, braking, back]), pursuit(u[1], x[3], [turn, unwinding, over])]
            },
        );
        let [l, r] = wheels([0.3, 0.2]);
        let (at_wheels, rates) = (SlewLimit { wheels: true, slowing: true, ..SlewLimit::default() }, [forward, braking, back]);
        let by_wheel = difference(&[&at_wheels], &[forward, braking, back / braking], &[], [0.3, 0.2, l, r], |s, t, x| {
            let ([l, r], a) = (wheels(held(s, t)), base(body([x[2], x[3]]), x));
            [a[0], a[1], pursuit(l, x[2], rates), pursuit(r, x[3], rates)]
        });
        assert!(error < 1e-4 && by_wheel < 1e-4, "{error} {by_wheel}");
    }
}

/// A step that is not cut where a ramp turns or ends makes the run jump with the rate, and no search finds the way.
#[test]
fn a_run_changes_smoothly_with_the_rates_of_a_ramp() {
    let rig = rig::body();
    let wheels = SlewLimit { wheels: true, slowing: true, ..SlewLimit::default() };
    let run = |rates: [f64; 3]| rig.run(&[&wheels], &rates).concat();
    let rates = [0.6, 1.1, 0.8];
    let at = run(rates);
    for j in 0..3 {
        let slope = |d: f64| {
            let there = run(std::array::from_fn(|k| rates[k] + if j == k { d } else { 0.0 }));
            there.iter().zip(&at).map(|(there, at)| ((there - at) / d).powi(2)).sum::<f64>().sqrt()
        };
        assert!((slope(1e-5) / slope(1e-3) - 1.0).abs() < 2e-3, "{j}: {} {}", slope(1e-5), slope(1e-3));
    }
}

#[test]
fn a_stronger_wheel_makes_the_robot_veer() {
    let g = 0.07;
    let error = difference(&[&GainAsymmetry::default()], &[g], &[], [0.3, 0.2], |s, t, x| {
        let [l, r] = wheels(held(s, t));
        base(body([(1.0 - g) * l, (1.0 + g) * r]), x)
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn a_battery_runs_down() {
    let k = 0.006;
    let error = difference(&[&BatterySag::default()], &[k], &[], [0.3, 0.2], |s, t, x| base(held(s, t).map(|u| u * (1.0 - k * t)), x));
    assert!(error < 5e-5, "{error}");
    for (lost, time) in [(0.12, 2.513), (-0.07, 4.2)] {
        let dropped = BatterySag { law: SagLaw::Dropped, servo: false };
        let error = difference(&[&dropped], &[lost, time], &[time], [0.3, 0.2], |s, t, x| {
            let left = if t < time { 1.0 } else { 1.0 - lost };
            base(held(s, t).map(|u| u * left), x)
        });
        assert!(error < 5e-5, "{error}");
    }
    let (lost, time) = (0.12, 2.5);
    let settling = BatterySag { law: SagLaw::Settling, servo: false };
    let error = difference(&[&settling], &[lost, time], &[], [0.3, 0.2], |s, t, x| {
        let left = 1.0 - lost + lost * (-t / time).exp();
        base(held(s, t).map(|u| u * left), x)
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn an_offset_is_added() {
    let error = difference(&[&CommandOffset {}], &[0.04, -0.09], &[], [0.3, 0.2], |s, t, x| {
        let [v, w] = held(s, t);
        base([v + 0.04, w - 0.09], x)
    });
    assert!(error < 5e-5, "{error}");
}

#[test]
fn loops_integrate_their_error() {
    for (forward, turn, scales) in [(0.4, 0.0, [1.0, 1.0]), (2.5, 6.0, [1.0, 1.0]), (1.5, 0.8, [0.8, 1.1])] {
        for (ends, most) in [([1e3, 1e3], 1e-4), ([0.02, 0.04], 1e-3)] {
            let error = difference(
                &[&IntegralAction::default()],
                &[forward, turn, ends[0], ends[1], scales[0], scales[1]],
                &[],
                [0.3, 0.2, 0.0, 0.0],
                |s, t, x| {
                    let u = held(s, t);
                    let a = base([u[0] + x[2], u[1] + x[3]], x);
                    let error = |i: usize| u[i] - scales[i] * x[i];
                    // Against winding up: an integral at its end goes no further.
                    let grows = |k: f64, i: usize| {
                        if x[2 + i].abs() >= ends[i] && error(i) * x[2 + i] > 0.0 { 0.0 } else { k * error(i) }
                    };
                    [a[0], a[1], grows(forward, 0), grows(turn, 1)]
                },
            );
            assert!(error < most, "{forward} {turn} {ends:?}: {error}");
        }
    }
}

#[test]
fn what_loops_have_gathered_may_leak() {
    let leaky = IntegralAction { leaky: true };
    for (forward, turn, leak) in [(0.4, 0.0, 0.3), (2.5, 6.0, 2.0)] {
        let error = difference(&[&leaky], &[forward, turn, leak, 1.0, 1.0], &[], [0.3, 0.2, 0.0, 0.0], |s, t, x| {
            let u = held(s, t);
            let a = base([u[0] + x[2], u[1] + x[3]], x);
            [a[0], a[1], forward * (u[0] - x[0]) - leak * x[2], turn * (u[1] - x[1]) - leak * x[3]]
        });
        assert!(error < 1e-4, "{forward} {turn} {leak}: {error}");
    }
}

#[test]
fn a_drive_pulls_no_harder_than_its_limit() {
    for (limit, rho, emf) in [(0.1, 1.0, 0.0), (0.16, 1.9, 0.0), (0.12, 1.0, 0.04), (0.12, 1.5, 0.08)] {
        let error = difference(&[&TorqueSaturation::default()], &[limit, rho, emf, 0.0], &[], [0.3, 0.2], |s, t, x| {
            let u = held(s, t);
            // Each wheel pulls by what its share of both loops asks for less what its own speed induces, up to the limit; the base model takes
            // off what it induces without one.
            let (asked, induced) = (wheels([u[0] - x[0], (u[1] - x[1]) / rho]), wheels(*x).map(|speed| emf * speed));
            let [forward, turn] = body([0, 1].map(|i| (asked[i] - induced[i]).max(-limit).min(limit) + induced[i]));
            base([x[0] + forward, x[1] + rho * turn], x)
        });
        assert!(error < 2e-4, "{limit} {rho} {emf}: {error}");
    }
}

/// A loop asks back a share of what drives the wheel; what the limit cuts of that makes the robot lighter.
#[test]
fn a_limit_cuts_what_a_loops_derivative_part_asks_back_as_well() {
    let (limit, rho, emf, share) = (0.12, 1.5, 0.04, 0.2);
    let error = difference(&[&TorqueSaturation::default()], &[limit, rho, emf, share], &[], [0.3, 0.2], |s, t, x| {
        let u = held(s, t);
        let (asked, induced) = (wheels([u[0] - x[0], (u[1] - x[1]) / rho]), wheels(*x).map(|speed| emf * speed));
        let [a, b] = base(u, x);
        let plain = wheels([THETA[0] * a, THETA[1] * b / rho]);
        // What drives each wheel: what passes the limit, less all that the robot without one loses of what is asked.
        let [forward, turn] = body([0, 1].map(|i| {
            (0..60).fold(plain[i], |driven, _| {
                let passes = (asked[i] - induced[i] - share * driven).max(-limit).min(limit) + induced[i];
                (passes - (asked[i] - plain[i])) / (1.0 - share)
            })
        }));
        [forward / THETA[0], rho * turn / THETA[1]]
    });
    assert!(error < 2e-4, "{error}");
}

#[test]
fn a_drive_has_no_more_than_its_power() {
    let (limit, rho, emf, slow) = (0.2, 1.4, 0.03, 0.1);
    let error = difference(&[&TorqueSaturation { law: TorqueLaw::Power }], &[limit, rho, emf, 0.0, slow], &[], [0.3, 0.2], |s, t, x| {
        let u = held(s, t);
        let (asked, speeds) = (wheels([u[0] - x[0], (u[1] - x[1]) / rho]), wheels(*x));
        let [forward, turn] = body([0, 1].map(|i| {
            let most = if speeds[i].abs() > slow { limit * slow / speeds[i].abs() } else { limit };
            let pulls: f64 = asked[i] - emf * speeds[i];
            pulls.max(-most).min(most) + emf * speeds[i]
        }));
        base([x[0] + forward, x[1] + rho * turn], x)
    });
    assert!(error < 2e-4, "{error}");
}

#[test]
fn iron_that_saturates_bends_what_a_drive_pulls() {
    let (limit, rho, emf, hardness) = (0.15, 1.4, 0.03, 2.2);
    let error = difference(&[&TorqueSaturation { law: TorqueLaw::Soft }], &[limit, rho, emf, 0.0, hardness], &[], [0.3, 0.2], |s, t, x| {
        let u = held(s, t);
        let (asked, speeds) = (wheels([u[0] - x[0], (u[1] - x[1]) / rho]), wheels(*x));
        let [forward, turn] = body([0, 1].map(|i| {
            let pulls: f64 = asked[i] - emf * speeds[i];
            pulls / (1.0 + (pulls / limit).abs().powf(hardness)).powf(1.0 / hardness) + emf * speeds[i]
        }));
        base([x[0] + forward, x[1] + rho * turn], x)
    });
    assert!(error < 2e-4, "{error}");
}

#[test]
fn a_supply_gives_both_drives_the_same_share_of_what_they_ask() {
    let (limit, rho, emf) = (0.24, 1.4, 0.03);
    let error = difference(&[&TorqueSaturation { law: TorqueLaw::Shared }], &[limit, rho, emf, 0.0], &[], [0.3, 0.2], |s, t, x| {
        let u = held(s, t);
        let (asked, speeds) = (wheels([u[0] - x[0], (u[1] - x[1]) / rho]), wheels(*x));
        let pulls = [0, 1].map(|i| asked[i] - emf * speeds[i]);
        let share = (limit / (pulls[0].abs() + pulls[1].abs())).min(1.0);
        let [forward, turn] = body([0, 1].map(|i| share * pulls[i] + emf * speeds[i]));
        base([x[0] + forward, x[1] + rho * turn], x)
    });
    assert!(error < 2e-4, "{error}");
}

#[test]
fn a_controller_asks_of_each_axis_no_more_than_its_limit() {
    let limits = [0.1, 0.15];
    let error = difference(&[&TorqueSaturation { law: TorqueLaw::Axes }], &limits, &[], [0.3, 0.2], |s, t, x| {
        let u = held(s, t);
        base([0, 1].map(|i| x[i] + (u[i] - x[i]).max(-limits[i]).min(limits[i])), x)
    });
    assert!(error < 2e-4, "{error}");
}

#[test]
fn effects_of_the_command_side_pass_it_on_in_their_order() {
    let (tau, rate, d, m, g, lag) = (0.06, 1.5, 0.05, 0.4, 0.04, 0.09);
    let soft = DeadZone { subtracting: true, ..DeadZone::default() };
    let effects: [&dyn wheelwright_core::Effect; 6] = [
        &ActuatorLag::default(),
        &GainAsymmetry::default(),
        &VelocitySaturation::default(),
        &soft,
        &SlewLimit { axis: Some(Axis::V), ..SlewLimit::default() },
        &CommandDelay::default(),
    ];
    let pass = |forward: f64, turn: f64| {
        let passed = wheels([forward, turn]).map(|u| u.signum() * (u.abs() - d).max(0.0)).map(|u| u.max(-m).min(m));
        body([(1.0 - g) * passed[0], (1.0 + g) * passed[1]])
    };
    let [forward, turn] = pass(0.3, 0.2);
    let error = difference(&effects, &[lag, g, m, d, rate, tau], &late(tau), [0.3, 0.2, 0.3, forward, turn], |s, t, x| {
        let u = held(s, t - tau);
        let (passed, a) = (pass(x[2], u[1]), base([x[3], x[4]], x));
        [a[0], a[1], ramp(u[0], x[2], rate), (passed[0] - x[3]) / lag, (passed[1] - x[4]) / lag]
    });
    assert!(error < 2e-4, "{error}");
}

/// A filter whose response has a peak is something elastic; one that is merely of second order is a lag.
#[test]
fn a_drive_that_rings_is_more_than_a_lag() {
    let lag = ActuatorLag { resonant: true, ..ActuatorLag::default() };
    let at = |damping: f64, half: f64| {
        let values = [(0.05, 0.001), (damping, half)];
        lag.beyond(&values.map(|(value, half)| Estimate { value, ci95: Some((value - half, value + half)) }))
    };
    assert!(at(0.3, 0.02).is_some_and(|s| s.contains("3.18 Hz")), "{:?}", at(0.3, 0.02));
    assert_eq!(at(0.9, 0.02), None);
    assert_eq!(at(0.6, 0.3), None, "it may as well not ring");
    assert_eq!(ActuatorLag::default().beyond(&[Estimate { value: 0.05, ci95: None }]), None);
}
