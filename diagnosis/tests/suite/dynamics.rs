//! Effects on the dynamics, each against an integration with very small steps of equations written anew.

use crate::rig::{HALF_TRACK, body, integrate, sides};
use wheelwright_core::effect::{Effect, EffectSimulator, Instant, Track};
use wheelwright_core::simulation::Readout;
use wheelwright_diagnosis::effects::{
    ActuatorLag, Backlash, BatterySag, Between, CastorDrag, CastorKind, CoulombFriction, CoulombFrictionOneWheel, DeadZone,
    DirectionAsymmetry, FrictionLaw, GainAsymmetry, IntegralAction, LateralComOffset, LoadLaw, PayloadChange, QuadraticDrag,
    RollingResistance, SagLaw, ScrubLaw, SlipLaw, Slope, Speeds, StribeckFriction, TurningScrub, ViscousAsymmetry, Wheel,
    WheelRadiusMismatch, WheelSlip,
};

/// Ground speeds of left and right wheel in the body frame.
fn wheels([v, w]: [f64; 2]) -> [f64; 2] {
    [v - HALF_TRACK * w, v + HALF_TRACK * w]
}

/// What forces at the left and right wheel take off the commands of a robot with velocity loops, ρ the turning ratio.
fn off([left, right]: [f64; 2], ratio: f64) -> [f64; 2] {
    [0.5 * (left + right), ratio * (right - left) / (2.0 * HALF_TRACK)]
}

#[test]
fn coulomb_friction_brakes_each_wheel() {
    let rig = body();
    for (c, ratio) in [(0.02, 1.0), (0.06, 1.8)] {
        let error = rig.load_error(&CoulombFriction::default(), &[c, ratio], |x| off(wheels(x).map(|s| c * rig.sign(s)), ratio));
        assert!(error < 3e-4, "{error}");
    }
    let each: [&dyn Effect; 2] = [&CoulombFrictionOneWheel { wheel: None }, &CoulombFriction { law: FrictionLaw::Sided }];
    for each in each {
        let error = rig.load_error(each, &[0.02, 0.05, 1.4], |x| {
            let [left, right] = wheels(x).map(|s| rig.sign(s));
            off([0.02 * left, 0.05 * right], 1.4)
        });
        assert!(error < 3e-4, "{error}");
    }
    let rig = sides();
    let error = rig.load_error(&CoulombFriction::default(), &[0.2], |x| x.map(|s| 0.2 * rig.sign(s)));
    assert!(error < 3e-4, "{error}");
    for each in each {
        let error = rig.load_error(each, &[0.2, 0.3], |[l, r]| [0.2 * rig.sign(l), 0.3 * rig.sign(r)]);
        assert!(error < 3e-4, "{error}");
    }
}

#[test]
fn friction_of_one_wheel_leaves_the_other_alone() {
    let (c, ratio) = (0.07, 1.4);
    for (wheel, share) in [(Wheel::Left, [1.0, 0.0]), (Wheel::Right, [0.0, 1.0])] {
        let effect = CoulombFrictionOneWheel { wheel: Some(wheel) };
        let rig = body();
        let force = |s: [f64; 2], c: f64| [share[0] * c * rig.sign(s[0]), share[1] * c * rig.sign(s[1])];
        let error = rig.load_error(&effect, &[c, ratio], |x| off(force(wheels(x), c), ratio));
        assert!(error < 3e-4, "{wheel}: {error}");
        let rig = sides();
        let force = |s: [f64; 2], c: f64| [share[0] * c * rig.sign(s[0]), share[1] * c * rig.sign(s[1])];
        let error = rig.load_error(&effect, &[0.3], |x| force(x, 0.3));
        assert!(error < 3e-4, "{wheel}: {error}");
    }
}

#[test]
fn stribeck_friction_falls_with_speed() {
    let (c, b, vs, ratio) = (0.02, 0.05, 0.08, 1.3);
    let rig = body();
    let law = |s: f64| rig.sign(s) * (c + b * (-(s * s) / (vs * vs)).exp());
    let error = rig.load_error(&StribeckFriction::default(), &[c, b, vs, ratio], |x| off(wheels(x).map(law), ratio));
    assert!(error < 1e-3, "{error}");
}

#[test]
fn rolling_resistance_brakes_driven_wheels_and_what_they_carry_along() {
    let (resistance, share, distance, ratio) = (0.07, 0.4, 0.2, 1.3);
    let (rest, driven) = (share * resistance, (1.0 - share) * resistance);
    let rig = body();
    // What rolls along at the axle has no lever.
    let error = rig.load_error(&RollingResistance::default(), &[resistance, share, 0.0, ratio], |[v, w]| {
        let [forward, turn] = off(wheels([v, w]).map(|s| driven * rig.sign(s)), ratio);
        [forward + rest * v / v.hypot(rig.kink), turn]
    });
    assert!(error < 1e-3, "at the axle it leaves turning to the driven wheels: {error}");
    let error = rig.load_error(&RollingResistance::default(), &[resistance, share, distance, ratio], |x| {
        let [forward, turn] = off(wheels(x).map(|s| driven * rig.sign(s)), ratio);
        let along = [x[0], distance * x[1]].map(|s| s / x[0].hypot(distance * x[1]).hypot(rig.kink));
        [forward + rest * along[0], turn + ratio * rest * distance / (HALF_TRACK * HALF_TRACK) * along[1]]
    });
    assert!(error < 1e-3, "{error}");
    let rig = sides();
    let error = rig.load_error(&RollingResistance::default(), &[0.3, 0.4, 0.0], |x| {
        let v = 0.5 * (x[0] + x[1]);
        x.map(|s| 0.18 * rig.sign(s) + 0.12 * v / v.hypot(rig.kink))
    });
    assert!(error < 1e-3, "{error}");
}

/// A ball goes the way of its place, and carries while the robot speeds up what the driven wheels carry less.
#[test]
fn rolling_resistance_moves_to_a_ball_while_the_robot_speeds_up() {
    let (resistance, share, d, ratio) = (0.07, 0.3, 0.2, 1.2);
    let rig = body();
    let effect = RollingResistance { castor: Some(CastorKind::Ball) };
    for transfer in [0.0, 0.3, -0.2] {
        let error = rig.error(&effect, &[resistance, share, d, transfer, ratio], rig.start, &[], |_, u, [v, w]| {
            let slide = v.hypot(d * w).hypot(rig.kink);
            let ball = [v / slide, ratio * d * d / (HALF_TRACK * HALF_TRACK) * w / slide];
            let driven = off(wheels([v, w]).map(|s| rig.sign(s)), ratio);
            let of = |share: f64| {
                let against = [0, 1].map(|i| resistance * (share * ball[i] + (1.0 - share) * driven[i]));
                (rig.base)([u[0] - against[0], u[1] - against[1]], [v, w])
            };
            of((0..50).fold(share, |now, _| share * (1.0 + transfer * of(now)[0])))
        });
        assert!(error < 1e-3, "{transfer}: {error}");
    }
}

/// A castor in a fork rolls where it has swung round to.
#[test]
fn rolling_resistance_acts_along_a_castor() {
    let (resistance, share, d, l, ratio) = (0.08, 0.3, 0.2, 0.05, 1.3);
    let rig = body();
    let effect = RollingResistance { castor: Some(CastorKind::Swivel) };
    let begun = {
        let scene = rig.scene();
        let at = Instant::of_sample(rig.stretch(), 0, &scene.tracks[0], &scene, Readout::Instantaneous);
        let mut state = [0.0; 4];
        effect.begin(&[resistance, share, d, l, 0.0, ratio], &at, &[0.0, 0.0], &rig.start, &mut state);
        2.0 * state[1].atan2(state[0])
    };
    let start = [rig.start[0], rig.start[1], begun];
    let error = rig.error(&effect, &[resistance, share, d, l, 0.0, ratio], start, &[], |_, u, [v, w, delta]| {
        let roll = v * delta.cos() - d * w * delta.sin();
        let along = -share * resistance * rig.sign(roll);
        let force = [along * delta.cos(), along * delta.sin()];
        let place = [-d - l * delta.cos(), -l * delta.sin()];
        let turn = place[0] * force[1] - place[1] * force[0];
        let driven = off(wheels([v, w]).map(|s| (1.0 - share) * resistance * rig.sign(s)), ratio);
        let a = (rig.base)([u[0] - driven[0] + force[0], u[1] - driven[1] + ratio / (HALF_TRACK * HALF_TRACK) * turn], [v, w]);
        [a[0], a[1], (-v * delta.sin() - d * w * delta.cos()) / l - w]
    });
    assert!(error < 1e-3, "{error}");
}

#[test]
fn friction_by_direction() {
    let (forward, backward, ratio) = (0.02, 0.06, 1.2);
    let rig = body();
    let law = |s: f64| {
        let (c, a) = (0.5 * (forward + backward), (forward - backward) / (forward + backward));
        c * (1.0 + a * s.signum()) * rig.sign(s)
    };
    let error = rig.load_error(&DirectionAsymmetry::default(), &[forward, backward, ratio], |x| off(wheels(x).map(law), ratio));
    assert!(error < 3e-4, "{error}");
}

/// f = c sin(atan(s/s0)): half of it at s0/√3.
#[test]
fn soft_friction_comes_up_with_speed() {
    let (forward, backward, slow, ratio) = (0.03, 0.06, 0.12, 1.3);
    let rig = body();
    let law = |s: f64, c: f64| c * (s / slow).atan().sin();
    let values = [forward, slow, ratio];
    let error = rig.load_error(&CoulombFriction { law: FrictionLaw::Soft }, &values, |x| off(wheels(x).map(|s| law(s, forward)), ratio));
    assert!(error < 3e-4, "{error}");
    let values = [forward, backward, slow, ratio];
    let by_direction = |s: f64| law(s, if s > 0.0 { forward } else { backward });
    let error = rig.load_error(&DirectionAsymmetry { soft: true }, &values, |x| off(wheels(x).map(by_direction), ratio));
    assert!(error < 3e-4, "{error}");
}

#[test]
fn friction_of_what_warms_up_changes_with_time() {
    let (friction, cold, time, ratio) = (0.04, 0.9, 13.0, 1.3);
    let rig = body();
    let start = rig.stretch().time[0];
    let warming = CoulombFriction { law: FrictionLaw::Warming };
    let error = rig.error(&warming, &[friction, cold, time, ratio], rig.start, &[], |t, u, x| {
        let size = friction * (1.0 + cold * (-(t - start) / time).exp());
        let taken = off(wheels(x).map(|s| size * rig.sign(s)), ratio);
        (rig.base)([u[0] - taken[0], u[1] - taken[1]], x)
    });
    assert!(error < 3e-4, "{error}");
}

/// Teeth that rub in proportion to what they pass on: what a motor gives is what its wheel gets and what the teeth lose.
#[test]
fn friction_of_gears_grows_with_what_they_pass_on() {
    let (friction, share, behind, ratio) = (0.02, 0.2, 0.1, 1.3);
    let rig = body();
    let geared = CoulombFriction { law: FrictionLaw::Geared };
    let slope = |_, u: [f64; 2], x: [f64; 2]| {
        let motors = drives_of([u[0] - (1.0 - behind) * 1.02 * x[0], u[1] - (1.0 - behind) * 1.05 * x[1]], ratio);
        let speeds = wheels(x);
        let taken = off([0, 1].map(|i| (friction + share * motors[i].abs()) * rig.sign(speeds[i])), ratio);
        (rig.base)([u[0] - taken[0], u[1] - taken[1]], x)
    };
    let of = |values: &[f64]| rig.error(&geared, values, rig.start, &[], slope);
    let error = of(&[friction, share, behind, ratio]);
    let wrong = [[friction, 0.0, behind, ratio], [friction, share, 0.0, ratio], [friction, share, behind, 1.0]];
    let least = wrong.iter().map(|values| of(values)).fold(f64::INFINITY, f64::min);
    assert!(error < 3e-4 && error < 0.2 * least, "{error}, {least} with one value wrong");
}

/// LuGre without damping, as its authors write it: a bend b of stiffness σ, f = σ b, b' = s − σ |s| b/g(s).
#[test]
fn bristles_bend_before_they_slide() {
    let (c, rise, slow, length, ratio) = (0.05, 0.03, 0.08, 0.006, 1.3);
    let rig = body();
    let bends = |stiffness: f64, holds: &dyn Fn(f64) -> f64, effect: &dyn Effect, values: &[f64]| {
        let [left, right] = wheels(rig.start).map(|s| holds(s) / stiffness);
        rig.error(effect, values, [rig.start[0], rig.start[1], left, right], &[], |_, u, [v, w, left, right]| {
            let (speeds, bends) = (wheels([v, w]), [left, right]);
            let [forward, turn] = off(bends.map(|b| stiffness * b), ratio);
            let [l, r] = [0, 1].map(|i| speeds[i] - stiffness * speeds[i].abs() * bends[i] / holds(speeds[i]));
            let a = (rig.base)([u[0] - forward, u[1] - turn], [v, w]);
            [a[0], a[1], l, r]
        })
    };
    let coulomb = CoulombFriction { law: FrictionLaw::Presliding };
    let error = bends(c / length, &|_| c, &coulomb, &[c, length, ratio]);
    assert!(error < 3e-4, "{error}");
    let holds = |s: f64| c + rise * (-(s / slow).powi(2)).exp();
    let error = bends((c + rise) / length, &holds, &StribeckFriction { presliding: true }, &[c, rise, slow, length, ratio]);
    assert!(error < 3e-4, "{error}");
}

#[test]
fn viscous_friction_by_wheel_and_by_direction() {
    let (a, ratio) = (0.12, 1.5);
    let rig = body();
    let by_wheel = ViscousAsymmetry::default();
    let error = rig.load_error(&by_wheel, &[a, ratio], |[v, w]| [a * HALF_TRACK * w, ratio * a * v / HALF_TRACK]);
    assert!(error < 1e-4, "{error}");
    let by_direction = ViscousAsymmetry { between: Between::Directions, ..ViscousAsymmetry::default() };
    let error = rig.load_error(&by_direction, &[a, ratio], |x| off(wheels(x).map(|s| a * s.abs()), ratio));
    assert!(error < 1e-4, "{error}");
    let rig = sides();
    let error = rig.load_error(&by_wheel, &[0.3], |[left, right]| [-0.3 * left, 0.3 * right]);
    assert!(error < 1e-4, "{error}");
}

#[test]
fn quadratic_drag_brakes_both_motions() {
    let rig = body();
    let typical = rig.scene().scales.outputs;
    for power in [2.0, 1.6, 2.7] {
        let error = rig.load_error(&QuadraticDrag::default(), &[0.3, 0.2, power], |x| {
            let drag = |q: f64, i: usize| q * typical[i].powi(2) * x[i].signum() * (x[i].abs() / typical[i]).powf(power);
            [drag(0.3, 0), drag(0.2, 1)]
        });
        assert!(error < 1e-4, "{power}: {error}");
    }
    let rig = sides();
    let error = rig.load_error(&QuadraticDrag::default(), &[0.4, 0.05, 2.0], |[left, right]| {
        let (v, w) = (0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK));
        let (forward, turn) = (0.4 * v * v.abs(), 0.05 * w * w.abs() * HALF_TRACK);
        [forward - turn, forward + turn]
    });
    assert!(error < 1e-4, "{error}");
}

#[test]
fn grease_thins_as_it_is_sheared() {
    let thinning = ViscousAsymmetry { thinning: true, ..ViscousAsymmetry::default() };
    let (thins, ratio) = (0.15, 1.4);
    let grease = |size: f64, s: f64| size * s / (1.0 + s.abs() / thins);
    let each = |difference: f64| move |[l, r]: [f64; 2]| [grease((-difference).max(0.0), l), grease(difference.max(0.0), r)];
    for difference in [0.4, -0.3] {
        let error = body().load_error(&thinning, &[difference, thins, ratio], |x| off(each(difference)(wheels(x)), ratio));
        assert!(error < 1e-4, "{difference}: {error}");
        let volts = 5.0 * difference;
        let error = sides().load_error(&thinning, &[volts, thins], each(volts));
        assert!(error < 1e-4, "{volts}: {error}");
    }
}

#[test]
fn quadratic_drag_brakes_each_wheel_by_its_own_speed() {
    let at_wheels = QuadraticDrag { wheels: true };
    let (rig, ratio) = (body(), 1.4);
    let typical = rig.scene().scales.speed;
    for power in [2.0, 1.6] {
        let drag = |s: f64| 0.3 * typical.powi(2) * s.signum() * (s.abs() / typical).powf(power);
        let error = rig.load_error(&at_wheels, &[0.3, power, ratio], |x| off(wheels(x).map(drag), ratio));
        assert!(error < 1e-4, "{power}: {error}");
    }
    let error = sides().load_error(&at_wheels, &[0.4, 2.0], |each| each.map(|s| 0.4 * s * s.abs()));
    assert!(error < 1e-4, "{error}");
}

#[test]
fn scrub_resists_turning() {
    let rig = body();
    let (m, l) = (0.3, 0.2);
    let patch = TurningScrub { law: ScrubLaw::Patch };
    // Each side has the half of a moment that is all there in place and falls with its slip angle; smooth at standstill within the kink.
    let moment = |sides: [f64; 2], w: f64| {
        let spent = |side: f64| (l * w.abs() / side.abs().max(3.0 * l * rig.kink / HALF_TRACK)).min(1.0);
        0.5 * m * w.signum() * sides.map(|side| 1.0 - (1.0 - spent(side)).powi(3)).iter().sum::<f64>()
    };
    let error = rig.load_error(&patch, &[m, l], |[v, w]| [0.0, moment(wheels([v, w]), w)]);
    assert!(error < 3e-4, "{error}");
    // Across what rolls on the centre line.
    let across = |[v, w]: [f64; 2]| m * l * w / (v * v + (l * w).powi(2) + rig.kink.powi(2)).sqrt();
    let error = rig.load_error(&TurningScrub { law: ScrubLaw::Angle }, &[m, l], |x| [0.0, across(x)]);
    assert!(error < 3e-4, "{error}");
    let understeer = TurningScrub { law: ScrubLaw::Understeer };
    let error = rig.load_error(&understeer, &[0.8], |[v, w]| [0.0, 0.8 * v * v * w]);
    assert!(error < 1e-4, "{error}");
    let sided = sides();
    let moment = |sides: [f64; 2]| {
        let w = (sides[1] - sides[0]) / (2.0 * HALF_TRACK);
        let spent = |side: f64| (l * w.abs() / side.abs().max(3.0 * l * sided.kink / HALF_TRACK)).min(1.0);
        0.5 * m * w.signum() * sides.map(|side| 1.0 - (1.0 - spent(side)).powi(3)).iter().sum::<f64>()
    };
    let error = sided.load_error(&patch, &[m / HALF_TRACK, l], |x| [-moment(x), moment(x)]);
    assert!(error < 3e-4, "{error}");
}

/// The lighter axle of a robot on four wheels slides: its share of the weight, what holding the curve and speeding up take of it, and what drives.
#[test]
fn the_axle_that_carries_less_scrubs() {
    let rig = body();
    let (m, uneven, transfer, grip) = (0.3, -0.2, 0.1, 3.0);
    let th2 = 0.19;
    for (m, most) in [(m, 2e-3), (0.1 * m, 5e-4)] {
        let error = rig.error(&TurningScrub { law: ScrubLaw::Skid }, &[m, uneven, transfer, grip], rig.start, &[], |_, u, [v, w]| {
            let [forward, turn] = (rig.base)(u, [v, w]);
            let lighter: f64 = 1.0 - (uneven + v * w.abs() / grip - transfer * forward).hypot(0.05);
            let across = m * (lighter * lighter - (forward / grip).powi(2)).max(1e-4).sqrt() / th2;
            // A robot that is held stands within two milliseconds.
            [forward, turn - (turn + w / 2e-3).max(-across).min(across)]
        });
        assert!(error < most, "{m}: {error}");
    }
}

/// However coarsely it is stepped, a robot that friction holds stands where friction is as large as what pulls.
#[test]
fn friction_holds_a_robot_at_any_step() {
    let rig = body();
    let (friction, pull) = (0.2, 0.02);
    let mut stretch = rig.stretch().clone();
    stretch.inputs = vec![vec![pull; stretch.len()], vec![0.0; stretch.len()]];
    let scene = rig.scene();
    let effect = CoulombFriction::default();
    let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&effect], &scene).unwrap();
    simulator.set(&rig.theta, &[friction, 1.0]).unwrap();
    simulator.set_substeps(1);
    let mut run = vec![Vec::new(); 2];
    simulator.run(0, &stretch, &[0.0, 0.0], &mut run).unwrap();
    let stands = rig.kink * (pull / friction).atanh();
    let worst = run[0][100..].iter().map(|v| (v - stands).abs()).fold(0.0, f64::max);
    assert!(worst < 0.01 * rig.kink, "{worst} of {}", rig.kink);
}

#[test]
fn a_castor_swings_round_and_drags() {
    let rig = body();
    let (d, l, ratio) = (0.2, 0.05, 1.3);
    for (f, dry, grease, comes_up_by) in [(0.06, 0.0, 0.0, None), (0.02, 0.0008, 0.0004, None), (0.06, 0.0, 0.0, Some(0.3))] {
        // The direction in which the pivot and the castor's trailing wheel move together at the start.
        let steady = |v: f64, w: f64| {
            let rate = |delta: f64| (-v * delta.sin() - d * w * delta.cos()) / l - w;
            let (mut low, mut high) = (-1.2, 1.2);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if rate(middle) > 0.0 { low = middle } else { high = middle }
            }
            low
        };
        let start = [rig.start[0], rig.start[1], steady(rig.start[0], rig.start[1])];
        let castor = CastorDrag { soft: comes_up_by.is_some(), ..CastorDrag::default() };
        let values: Vec<f64> = [f, d, l, dry, grease, 0.4].into_iter().chain(comes_up_by).chain([ratio]).collect();
        let resists = |roll: f64| comes_up_by.map_or_else(|| rig.sign(roll), |by: f64| roll / (roll * roll + by * by).sqrt());
        let error = rig.error(&castor, &values, start, &[], |_, u, [v, w, delta]| {
            let roll = v * delta.cos() - d * w * delta.sin();
            let swing = (-v * delta.sin() - d * w * delta.cos()) / l - w;
            // Forces of the ground on the castor's wheel, along it and across it, where it stands.
            let moment = dry * rig.sign(swing * l) + grease * swing;
            let (along, across) = (-f * resists(roll), -moment / l);
            let force = [along * delta.cos() - across * delta.sin(), along * delta.sin() + across * delta.cos()];
            let place = [-d - l * delta.cos(), -l * delta.sin()];
            let turn = place[0] * force[1] - place[1] * force[0];
            let a = (rig.base)([u[0] + force[0], u[1] + ratio / (HALF_TRACK * HALF_TRACK) * turn], [v, w]);
            [a[0], a[1], swing]
        });
        assert!(error < 1e-3, "{error}");
    }
}

/// Where nothing moves nothing tells how a castor stands: it stands as it was left.
#[test]
fn a_castor_starts_from_rest_as_it_was_left() {
    let rig = body();
    let (scene, castor) = (rig.scene(), CastorDrag::default());
    let begun = |from_rest: bool, outputs: &[f64]| {
        let track = Track { from_rest, ..scene.tracks[0].clone() };
        let at = Instant::of_sample(rig.stretch(), 0, &track, &scene, Readout::Instantaneous);
        let mut state = [0.0; 4];
        castor.begin(&[0.05, 0.2, 0.05, 0.0, 0.0, 2.0, 1.0], &at, &[0.0, 0.0], outputs, &mut state);
        2.0 * state[1].atan2(state[0])
    };
    assert!((begun(true, &[1e-4, -2e-4]) - 2.0).abs() < 1e-12, "{}", begun(true, &[1e-4, -2e-4]));
    assert!(begun(false, &[0.3, 0.0]).abs() < 1e-12, "{}", begun(false, &[0.3, 0.0]));
}

#[test]
fn a_ball_slides_against_its_motion() {
    let rig = body();
    let (f, d, ratio) = (0.05, 0.2, 1.2);
    for transfer in [0.0, 0.2, -0.1] {
        let ball = CastorDrag { kind: CastorKind::Ball, ..CastorDrag::default() };
        let error = rig.error(&ball, &[f, d, transfer, ratio], rig.start, &[], |_, u, [v, w]| {
            let slide = v.hypot(d * w).hypot(rig.kink);
            let [forward, turn] = [f * v / slide, ratio * f * d * d / (HALF_TRACK * HALF_TRACK) * w / slide];
            // The load on the ball and the acceleration that it leaves: by turns, each from the other.
            let of = |load: f64| (rig.base)([u[0] - load * forward, u[1] - load * turn], [v, w]);
            let load = (0..50).fold(1.0, |load, _| 1.0 + transfer * of(load)[0]);
            of(load)
        });
        assert!(error < 1e-3, "{transfer}: {error}");
    }
}

/// Wheels of unequal radii by virtual power: rates that the loops take for x̂ = x − E x push with P (u − x̂), and the push at each wheel
/// counts at the ground by the same (I − E). The effect's equation is exact to first order in E.
#[test]
fn unequal_wheels_couple_what_the_loops_keep() {
    let rig = body();
    let (e, h) = (0.08, HALF_TRACK);
    // What the loops withdraw for a unit of each speed.
    let kept = [1.02, 1.05];
    for ratio in [1.0, 1.4] {
        let ground = WheelRadiusMismatch { speeds: Speeds::Ground, ..WheelRadiusMismatch::default() };
        let error = rig.error(&ground, &[e, ratio], rig.start, &[], |_, u, [v, w]| {
            let [a, b] = (rig.base)([0.0, 0.0], [v, w]);
            // Coefficients of the base: acceleration by one unit of input.
            let by = (rig.base)([1.0, 1.0], [v, w]);
            let (th1, th2) = (1.0 / (by[0] - a), 1.0 / (by[1] - b));
            // What turning does to the centre of mass acts on the body: no wheel's radius counts for it.
            let still = held([v, w]);
            let used = [-th1 * a - still[0], -th2 * b - still[1]];
            let drive = [u[0] - used[0] + kept[0] * 0.5 * e * h * w, u[1] - used[1] + kept[1] * 0.5 * e / h * v];
            let push = [u[0] - used[0], u[1] - used[1]];
            [(drive[0] - 0.5 * e * h / ratio * push[1] - still[0]) / th1, (drive[1] - 0.5 * e * ratio / h * push[0] - still[1]) / th2]
        });
        assert!(error < 1e-3, "{error}");
        // The robot in what its encoders say, by Lagrange: it moves at g = x̂ − E x̂, masses th1 and th2 h²/ρ beside each other, and what turning
        // does to its centre of mass acts at g; the loops push at x̂.
        // Lagrange's is exact in E too, and so is held against small radii's difference.
        let (e, encoders) = (0.25 * e, WheelRadiusMismatch { speeds: Speeds::Encoders, ..WheelRadiusMismatch::default() });
        let [v, w] = rig.start;
        let seen = [v + 0.5 * e * h * w, w + 0.5 * e / h * v];
        let error = rig.error(&encoders, &[e, ratio], seen, &[], |_, u, x| {
            let [a, b] = (rig.base)([0.0, 0.0], x);
            let by = (rig.base)([1.0, 1.0], x);
            let (th1, th2) = (1.0 / (by[0] - a), 1.0 / (by[1] - b));
            let (half, turning) = (0.5 * e, h * h / ratio);
            let (at_encoders, at_ground) = (held(x), held([x[0] - half * h * x[1], x[1] - half / h * x[0]]));
            let pushed = [u[0] + th1 * a + at_encoders[0], (u[1] + th2 * b + at_encoders[1]) * turning];
            let (c, d) = (at_ground[0], at_ground[1] * turning);
            let force = [pushed[0] - c + half / h * d, pushed[1] - d + half * h * c];
            let (m, i) = (th1, th2 * turning);
            let (mass, inertia, off) = (m + (half / h).powi(2) * i, i + (half * h).powi(2) * m, -half * (m * h + i / h));
            let determinant = mass * inertia - off * off;
            [(inertia * force[0] - off * force[1]) / determinant, (mass * force[1] - off * force[0]) / determinant]
        });
        assert!(error < 1e-3, "{error}");
    }
}

/// Loops that are stronger at one wheel, or weaker by the minute, drive by what they see between command and motion.
#[test]
fn a_loop_with_another_gain_pushes_by_its_own_error() {
    let rig = body();
    // What is fed back of a speed to a loop that feeds forward.
    let (g, fed) = (0.2, 0.9);
    // Loops on forward and angular velocity of unequal strength: by voltages. Forward each volt per m/s, turning 1/ρ of that at a wheel, and what
    // the motors' back-EMF takes is 1 − β of the forward loop's.
    for ratio in [1.0, 1.6] {
        let error = rig.error(&GainAsymmetry { servo: true }, &[g, fed, ratio], rig.start, &[], |_, u, x| {
            let back = 1.0 - fed;
            let forward = u[0] - (1.0 - back) * x[0];
            let turning = (u[1] - (1.0 - ratio * back) * x[1]) / ratio;
            let volts = [forward - HALF_TRACK * turning, forward + HALF_TRACK * turning];
            let [left, right] = [-g * volts[0], g * volts[1]];
            let added = [0.5 * (left + right), ratio * (right - left) / (2.0 * HALF_TRACK)];
            (rig.base)([u[0] + added[0], u[1] + added[1]], x)
        });
        assert!(error < 1e-3, "{ratio}: {error}");
    }
    let k = 0.01;
    let error = rig.error(&BatterySag { servo: true, ..BatterySag::default() }, &[k, fed], rig.start, &[], |t, u, x| {
        let lost = k * (t - rig.stretch().time[0]);
        (rig.base)([0, 1].map(|i| u[i] - lost * (u[i] - fed * x[i])), x)
    });
    assert!(error < 1e-3, "{error}");
    let (k, time) = (0.15, 2.0);
    let error = rig.error(&BatterySag { servo: true, law: SagLaw::Settling }, &[k, time, fed], rig.start, &[], |t, u, x| {
        let lost = k * (1.0 - (-(t - rig.stretch().time[0]) / time).exp());
        (rig.base)([0, 1].map(|i| u[i] - lost * (u[i] - fed * x[i])), x)
    });
    assert!(error < 1e-3, "{error}");
}

/// A current that builds up slowly: the push is a state of its own.
#[test]
fn a_push_that_lags_makes_the_loop_of_second_order() {
    let rig = body();
    for (lag, fed) in [(0.08, 1.0), (0.25, 0.8)] {
        let effect = ActuatorLag { servo: true, ..ActuatorLag::default() };
        let asked = |u: [f64; 2], x: [f64; 2]| [0, 1].map(|i| u[i] - fed * x[i]);
        let [v, w] = rig.start;
        let [forward, turning] = asked([rig.stretch().inputs[0][0], rig.stretch().inputs[1][0]], rig.start);
        let error = rig.error(&effect, &[lag, fed], [v, w, forward, turning], &[], |_, u, [v, w, forward, turning]| {
            let (push, e) = ([forward, turning], asked(u, [v, w]));
            let [a, b] = (rig.base)([0, 1].map(|i| u[i] + push[i] - e[i]), [v, w]);
            [a, b, (e[0] - push[0]) / lag, (e[1] - push[1]) / lag]
        });
        assert!(error < 1e-3, "{lag}: {error}");
    }
}

/// Currents are what drives the motors over their resistance, and the same voltage that is lost to them no longer drives them: V = V0 − R Σ|i| − w, and
/// w follows what is not lost at once.
#[test]
fn a_supply_with_a_resistance_gives_way_to_what_the_motors_draw() {
    let rig = body();
    let (r, k, fed, ratio, back_emf) = (0.1, 0.008, 0.9, 1.4, 0.8);
    let typical = rig.scene().scales.command;
    // A typical command at wheels that stand: both motors draw all that is left, and lose r.
    let resistance = r / (1.0 - r) / (2.0 * typical);
    let recovering = (SagLaw::Recovering, 0.3, 0.7);
    for (servo, (law, at_once, time)) in [false, true].into_iter().flat_map(|s| [(s, (SagLaw::Loaded, 1.0, 1.0)), (s, recovering)]) {
        let slow: &[f64] = if law == SagLaw::Recovering { &[at_once, time] } else { &[] };
        let known: &[f64] = if servo { &[fed, ratio] } else { &[back_emf] };
        let values = [&[r, k], slow, known].concat();
        let [v, w] = rig.start;
        let error = rig.error(&BatterySag { servo, law }, &values, [v, w, 0.0], &[], |t, u, [v, w, lost]| {
            let x = [v, w];
            // What each wheel's motor is asked for, and what would drive it at full voltage; the turning loop is of another strength than the forward one.
            let volts = |forward: f64, turning: f64| wheels([forward, turning / if servo { ratio } else { 1.0 }]);
            let [a, b] = (rig.base)(u, x);
            let (asked, full) = if servo {
                (volts(u[0] - fed * v, u[1] - (1.0 - ratio * (1.0 - fed)) * w), volts(0.26 * a, 0.19 * b))
            } else {
                (volts(u[0], u[1]), volts(u[0] - back_emf * v, u[1] - back_emf * w))
            };
            // What flows at a voltage, and so which voltage it leaves, until they agree.
            let drawn = |left: f64| -> f64 { [0, 1].map(|i| (full[i] - (1.0 - left) * asked[i]).abs()).iter().sum() };
            let open = 1.0 - k * (t - rig.stretch().time[0]) - lost;
            let left = (0..80).fold(open, |left, _| open - at_once * resistance * drawn(left));
            let pulls = |i: usize| if servo { fed * x[i] + left * (u[i] - fed * x[i]) } else { left * u[i] };
            let [a, b] = (rig.base)([pulls(0), pulls(1)], x);
            [a, b, ((1.0 - at_once) * resistance * drawn(left) - lost) / time]
        });
        assert!(error < 1e-3, "{servo} {law:?}: {error}");
    }
}

/// A motor that does nothing for less than a threshold takes as much off every push.
#[test]
fn a_motor_with_a_dead_zone_does_not_push_at_small_errors() {
    let rig = body();
    let (d, fed) = (0.03, 0.9);
    let dead = DeadZone { servo: true, ..DeadZone::default() };
    let error = rig.error(&dead, &[d, fed, 1.0], rig.start, &[], |_, u, x| {
        let [left, right] = [0, 1].map(|i| {
            let lag = wheels(u)[i] - fed * wheels(x)[i];
            if lag.abs() < d { lag } else { d.copysign(lag) }
        });
        let lost = [0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK)];
        (rig.base)([u[0] - lost[0], u[1] - lost[1]], x)
    });
    assert!(error < 1e-3, "{error}");
}

#[test]
fn a_slope_pulls_by_the_measured_heading() {
    let rig = body();
    let (c, s, share, aside) = (0.05, -0.08, 0.9, 0.4);
    let stretch = rig.stretch();
    // Heading by trapezoids over the record, straight between samples.
    let mut heading = vec![0.0];
    for k in 1..stretch.len() {
        let mean = 0.5 * (stretch.outputs[1][k - 1] + stretch.outputs[1][k]);
        heading.push(heading[k - 1] + mean * (stretch.time[k] - stretch.time[k - 1]));
    }
    let at = |t: f64| {
        let k = (stretch.time.partition_point(|x| *x <= t).max(1) - 1).min(stretch.len() - 2);
        heading[k] + (heading[k + 1] - heading[k]) * (t - stretch.time[k]) / (stretch.time[k + 1] - stretch.time[k])
    };
    let error = rig.error(&Slope::default(), &[c, s, share, aside], rig.start, &[], |t, u, x| {
        let psi = at(t);
        // Gravity in the world, −(c, s), seen from the body.
        let (along, across) = (-c * psi.cos() - s * psi.sin(), c * psi.sin() - s * psi.cos());
        (rig.base)([u[0] + along, u[1] + share * across + aside * along], x)
    });
    assert!(error < 1e-4, "{error}");
}

#[test]
fn ground_in_waves_pulls_by_the_place() {
    let rig = body();
    let (pull, wave, phase, share, aside) = (0.09, [2.0, -1.1], 0.7, 0.9, 0.4);
    let stretch = rig.stretch();
    // Heading and place by trapezoids over the record, straight between samples.
    let mut rows = vec![[0.0; 3]];
    for k in 1..stretch.len() {
        let [psi, x, y] = rows[k - 1];
        let step = stretch.time[k] - stretch.time[k - 1];
        let [before, now] = [k - 1, k].map(|k| [stretch.outputs[0][k], stretch.outputs[1][k]]);
        let turned = psi + 0.5 * step * (before[1] + now[1]);
        let along = |part: fn(f64) -> f64| 0.5 * step * (before[0] * part(psi) + now[0] * part(turned));
        rows.push([turned, x + along(f64::cos), y + along(f64::sin)]);
    }
    let at = |t: f64| {
        let k = (stretch.time.partition_point(|x| *x <= t).max(1) - 1).min(stretch.len() - 2);
        let share = (t - stretch.time[k]) / (stretch.time[k + 1] - stretch.time[k]);
        [0, 1, 2].map(|i| rows[k][i] + (rows[k + 1][i] - rows[k][i]) * share)
    };
    let values = [pull, wave[0], wave[1], phase, share, aside];
    let error = rig.error(&Slope { waves: true }, &values, rig.start, &[], |t, u, x| {
        let [psi, east, north] = at(t);
        let steep = pull * (wave[0] * east + wave[1] * north + phase).sin();
        let uphill = wave[1].atan2(wave[0]) - psi;
        let (along, across) = (-steep * uphill.cos(), -steep * uphill.sin());
        (rig.base)([u[0] + along, u[1] + share * across + aside * along], x)
    });
    assert!(error < 1e-4, "{error}");
}

#[test]
fn a_payload_changes_inertia_from_its_time_on() {
    let rig = body();
    for time in [17.3456, rig.stretch().time[200]] {
        let (d1, d2, d5) = (0.8, 0.5, 0.06);
        let error = rig.error(&PayloadChange::default(), &[time, d1, d2, d5], rig.start, &[time], |t, u, [v, w]| {
            let on = if t >= time { 1.0 } else { 0.0 };
            let (th1, th2) = (0.26 * (1.0 + on * d1), 0.19 * (1.0 + on * d2));
            let (th3, th5) = (-0.01 + on * HALF_TRACK * HALF_TRACK * d5, 0.05 + on * d5);
            [(u[0] + th3 * w * w - 1.02 * v) / th1, (u[1] - th5 * v * w - 1.05 * w) / th2]
        });
        assert!(error < 1e-4, "{error}");
    }
    let (from, until, d1, d2) = (17.3456, 21.2345, 0.8, 0.5);
    let load = PayloadChange { law: LoadLaw::Undone };
    let error = rig.error(&load, &[from, until - from, d1, d2, 0.0], rig.start, &[from, until], |t, u, [v, w]| {
        let on = if (from..until).contains(&t) { 1.0 } else { 0.0 };
        [(u[0] - 0.01 * w * w - 1.02 * v) / (0.26 * (1.0 + on * d1)), (u[1] - 0.05 * v * w - 1.05 * w) / (0.19 * (1.0 + on * d2))]
    });
    assert!(error < 1e-4, "{error}");
    let (load, takes) = (PayloadChange { law: LoadLaw::Gradual }, 7.3);
    let error = rig.error(&load, &[from, takes, d1, d2, 0.0], rig.start, &[from, from + takes], |t, u, [v, w]| {
        let on = ((t - from) / takes).clamp(0.0, 1.0);
        [(u[0] - 0.01 * w * w - 1.02 * v) / (0.26 * (1.0 + on * d1)), (u[1] - 0.05 * v * w - 1.05 * w) / (0.19 * (1.0 + on * d2))]
    });
    assert!(error < 1e-4, "{error}");
    let rig = sides();
    let (time, d1, d2) = (20.01, 0.6, 1.2);
    let error = rig.error(&PayloadChange::default(), &[time, d1, d2, 0.0], rig.start, &[time], |t, u, x| {
        let left = (u[0] - 2.5 * x[0], u[1] - 2.4 * x[1]);
        let (sum, difference) = (0.5 * (left.0 + left.1), 0.5 * (left.1 - left.0));
        let (sum, difference) = if t >= time { (sum / (1.0 + d1), difference / (1.0 + d2)) } else { (sum, difference) };
        [(sum - difference) / 0.4, (sum + difference) / 0.45]
    });
    assert!(error < 1e-4, "{error}");
}

#[test]
fn a_lateral_centre_of_mass_couples_the_axes_as_a_rigid_body_does() {
    let rig = body();
    let (y, ratio) = (0.05, 1.4);
    let (th7, th8) = (0.26 * y, ratio * 0.26 * y / (HALF_TRACK * HALF_TRACK));
    let error = rig.error(&LateralComOffset {}, &[y, ratio], rig.start, &[], |_, u, [v, w]| {
        let (p, q) = (u[0] - 0.01 * w * w - 1.02 * v, u[1] - 0.05 * v * w - 1.05 * w);
        // th1 a − th7 b = p, th2 b − th8 a = q.
        let b = (q + th8 / 0.26 * p) / (0.19 - th8 * th7 / 0.26);
        [(p + th7 * b) / 0.26, b]
    });
    assert!(error < 1e-4, "{error}");
}

/// A rigid body with its centre at (b, y), pushed at the rims by two motors: Newton and Euler about the centre of mass with the
/// constraint that the axle does not slip sideways. Nothing of the effect's algebra.
#[test]
fn a_lateral_centre_of_mass_is_what_a_rigid_body_does() {
    let (m, inertia, b, y, push) = (9.0, 0.25, 0.02, 0.04, 40.0);
    let h = HALF_TRACK;
    // In the model's terms a rim force f = push (command − speed) is 1 of command for `push` newtons, of two wheels.
    let about_axle = inertia + m * (b * b + y * y);
    let theta = [m / (2.0 * push), about_axle / (2.0 * push * h * h), m * b / (2.0 * push), 1.0, m * b / (2.0 * push * h * h), 1.0];
    let mut rig = body();
    rig.theta = theta.to_vec();
    let slope = |_: f64, u: [f64; 2], [v, w]: [f64; 2]| {
        let force = [push * (u[0] - h * u[1] - (v - h * w)), push * (u[0] + h * u[1] - (v + h * w))];
        // Unknown: v', w', the sideways force N at the axle. Acceleration of the centre: (v' − y w' − b w², v w + b w' − y w²).
        // m ax = Fl + Fr; m ay = N; I w' = moment of Fl, Fr, N about the centre.
        let total = force[0] + force[1];
        // Moment about the centre of a force (fx, fy) at (px, py): (px − b) fy − (py − y) fx.
        let moment = |n: f64| (0.0 - b) * n - (h - y) * force[0] - (-h - y) * force[1];
        // I w' = moment(0) − b N with N = m (v w + b w' − y w²), and v' = total/m + y w' + b w².
        let turn = (moment(0.0) - b * m * (v * w - y * w * w)) / (inertia + m * b * b);
        [total / m + y * turn + b * w * w, turn]
    };
    // The forces' moment about the centre has y in it: y (Fl + Fr) is the coupling.
    let truth = integrate(rig.stretch(), rig.start, &[], slope);
    let run = rig.run(&[&LateralComOffset {}], &[y, 1.0]);
    let worst = (0..2).flat_map(|i| truth.iter().zip(&run[i]).map(move |(t, r)| (t[i] - r).abs())).fold(0.0, f64::max);
    assert!(worst < 2e-4, "{worst}");
    let without = rig.run(&[], &[]);
    let did = (0..2).flat_map(|i| truth.iter().zip(&without[i]).map(move |(t, r)| (t[i] - r).abs())).fold(0.0, f64::max);
    assert!(did > 0.02, "{did}");
}

/// What drives the body's wheels where nothing slips.
fn drives(u: [f64; 2], [v, w]: [f64; 2]) -> [f64; 2] {
    wheels([u[0] - 1.02 * v, u[1] - 1.05 * w])
}

/// What the ground has to give at the body, in terms of the commands, where its centre of mass is off the axle.
fn held([v, w]: [f64; 2]) -> [f64; 2] {
    [0.01 * w * w, 0.05 * v * w]
}

/// What arrives of a push at a wheel whose hub has a speed: the push less what the rim runs ahead, by bisection. `needed` is the slip at
/// which the ground carries a force.
fn carried(push: f64, speed: f64, needed: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, push.abs());
    for _ in 0..32 {
        let carried = 0.5 * (low + high);
        let ahead = push.signum() * (push.abs() - carried);
        let slip = ahead.abs() / speed.abs().max((speed + ahead).abs());
        if needed(carried) > slip { high = carried } else { low = carried }
    }
    low * push.signum()
}

/// Slip at which a brush carries a force.
fn brush(force: f64, most: f64, creep: f64) -> f64 {
    if force < most { 3.0 * creep * most * (1.0 - (1.0 - force / most).cbrt()) } else { f64::INFINITY }
}

/// What arrives at both wheels where each loop withdraws its own part of what either rim runs ahead: over and over until nothing moves.
fn carried_beside(pushes: [f64; 2], own: f64, cross: f64, carried: impl Fn(usize, f64) -> f64) -> [f64; 2] {
    let (mut ahead, mut arrives) = ([0.0; 2], pushes);
    for _ in 0..6 {
        let given = [0, 1].map(|i| pushes[i] - cross * ahead[1 - i]);
        arrives = [0, 1].map(|i| carried(i, given[i]));
        ahead = [0, 1].map(|i| (given[i] - arrives[i]) / own);
    }
    arrives
}

#[test]
fn wheels_creep_and_spin() {
    let rig = body();
    let to_body = |[left, right]: [f64; 2], x: [f64; 2]| {
        let [forward, turn] = held(x);
        [(0.5 * (left + right) - forward) / 0.26, ((right - left) / (2.0 * HALF_TRACK) - turn) / 0.19]
    };
    // What the loops of forward and of turning speed withdraw of the wheel's own speed and of the other's.
    let (own, cross) = (0.5 * (1.02 + 1.05), 0.5 * (1.02 - 1.05));
    let creep = 0.9;
    let error = rig.error(&WheelSlip { law: SlipLaw::Creep }, &[creep, 0.0, 1.0], rig.start, &[], |_, u, x| {
        let (a, s) = (drives(u, x), wheels(x));
        to_body(carried_beside(a, own, cross, |i, push| carried(push, own * s[i], |force| creep / own * force)), x)
    });
    assert!(error < 2e-4, "{error}");
    let tyre = WheelSlip { law: SlipLaw::Grip };
    for (grip, creep) in [(0.9, 0.7), (0.9, 0.0)] {
        let error = rig.error(&tyre, &[grip, creep, 0.0, 1.0], rig.start, &[], |_, u, x| {
            let (a, s) = (drives(u, x), wheels(x));
            let ground = |i: usize, push: f64| carried(push, own * s[i], |force| brush(force, 0.26 * grip, creep / own));
            to_body(carried_beside(a, own, cross, ground), x)
        });
        assert!(error < 2e-4, "grip {grip}, creep {creep}: {error}");
    }
    let (rig, grip, creep) = (sides(), 0.9, 0.7);
    let error = rig.error(&tyre, &[grip, creep, 0.0], rig.start, &[], |_, u, x| {
        let of = |(a, needs, s, own): (f64, f64, f64, f64)| carried(a, own * s, |force| brush(force, needs * grip, creep / own)) / needs;
        [(u[0] - 2.5 * x[0], 0.4, x[0], 2.5), (u[1] - 2.4 * x[1], 0.45, x[1], 2.4)].map(of)
    });
    assert!(error < 2e-4, "{error}");
}

/// Friction of a bearing never reaches the ground; a drag does, and so does a mass off the middle, whatever order they are told in.
#[test]
fn the_ground_carries_what_bearings_leave_against_what_pulls_at_the_robot() {
    let rig = body();
    let (own, cross) = (0.5 * (1.02 + 1.05), 0.5 * (1.02 - 1.05));
    let (creep, dry, drag, offset) = (0.9, 0.03, [0.2, 0.05], 0.04);
    let (th7, th8) = (0.26 * offset, 0.26 * offset / (HALF_TRACK * HALF_TRACK));
    let slope = |_: f64, u: [f64; 2], x: [f64; 2]| {
        let s = wheels(x);
        let pushes = [0, 1].map(|i| drives(u, x)[i] - dry * rig.sign(s[i]));
        let [left, right] = carried_beside(pushes, own, cross, |i, push| carried(push, own * s[i], |force| creep / own * force));
        let forward = 0.5 * (left + right) - held(x)[0] - drag[0] * x[0] * x[0].abs();
        let turn = (right - left) / (2.0 * HALF_TRACK) - held(x)[1] - drag[1] * x[1] * x[1].abs();
        let determinant = 0.26 * 0.19 - th7 * th8;
        [(0.19 * forward + th7 * turn) / determinant, (0.26 * turn + th8 * forward) / determinant]
    };
    let slip = WheelSlip { law: SlipLaw::Creep };
    let (friction, air, mass) = (CoulombFriction::default(), QuadraticDrag::default(), LateralComOffset::default());
    let [v, w] = rig.start;
    let one = rig.joint_error(
        &[&friction, &air, &slip, &mass],
        &[dry, 1.0, drag[0], drag[1], 2.0, creep, 0.0, 1.0, offset, 1.0],
        [v, w],
        &[],
        slope,
    );
    let other = rig.joint_error(
        &[&mass, &slip, &air, &friction],
        &[offset, 1.0, creep, 0.0, 1.0, drag[0], drag[1], 2.0, dry, 1.0],
        [v, w],
        &[],
        slope,
    );
    assert!(one < 5e-4 && (one - other).abs() < 1e-12, "{one} and {other}");
}

/// Drives of the body's wheels, in terms of the forward command; a force counts `ratio` times as much in turning.
fn drives_of([v, w]: [f64; 2], ratio: f64) -> [f64; 2] {
    wheels([v, w / ratio])
}

#[test]
fn a_wheel_comes_up_to_its_slip_in_a_time_of_its_own() {
    // Robot and wheels as masses of their own, a tyre between them.
    let rig = body();
    let (most, creep, spin_up, ratio) = (0.26 * 1.4, 0.9, 0.06, 1.3);
    let own = 0.5 * (1.02 + 1.05 / ratio);
    let tyre = |ahead: f64, hub: f64| {
        let faster = hub.abs().max((hub + ahead).abs()).max(0.01);
        let sliding = (ahead.abs() / faster / (3.0 * creep / own * most)).min(1.0);
        ahead.signum() * most * (1.0 - (1.0 - sliding).powi(3))
    };
    let slope = |_: f64, u: [f64; 2], [v, w, left, right]: [f64; 4]| {
        let ahead = [0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK)];
        let net = [u[0] - 1.02 * (v + ahead[0]), u[1] - 1.05 * (w + ahead[1])];
        let (pushes, hubs) = (drives_of(net, ratio), wheels([v, w]));
        let ground = [tyre(left, hubs[0]), tyre(right, hubs[1])];
        [
            (0.5 * (ground[0] + ground[1]) - held([v, w])[0]) / 0.26,
            (ratio * (ground[1] - ground[0]) / (2.0 * HALF_TRACK) - held([v, w])[1]) / 0.19,
            (pushes[0] - ground[0]) / (own * spin_up),
            (pushes[1] - ground[1]) / (own * spin_up),
        ]
    };
    let [v, w] = rig.start;
    let of = |values: &[f64]| rig.error(&WheelSlip { law: SlipLaw::Grip }, values, [v, w, 0.0, 0.0], &[], slope);
    let (with, without) = (of(&[most / 0.26, creep, spin_up, ratio]), of(&[most / 0.26, creep, 0.0, ratio]));
    assert!(with < 0.06 * without, "{with} with spinning up, {without} without");
    assert!(of(&[most / 0.26, creep, spin_up, 1.0]) > 10.0 * with);
}

#[test]
fn play_interrupts_the_drive() {
    // Motors as masses of their own that drive the wheels through stiff flanks with play between.
    let rig = body();
    let (spin_up, behind, turning, ratio) = (0.008, 0.15, 0.35, 1.2);
    let kept = [1.0 - behind, 1.0 - turning];
    let own = 0.5 * (kept[0] * 1.02 + kept[1] * 1.05 / ratio);
    let motor = own * spin_up;
    let (stiffness, damping) = (motor * 1500.0 * 1500.0, 2.0 * motor * 1500.0);
    let flank = |gap: f64, place: f64, ahead: f64| match place {
        place if place > 0.5 * gap => (stiffness * (place - 0.5 * gap) + damping * ahead).max(0.0),
        place if place < -0.5 * gap => (stiffness * (place + 0.5 * gap) + damping * ahead).min(0.0),
        _ => 0.0,
    };
    // What motors add to the body's own inertia where they are pressed against the wheels.
    let inertia = [0.26 - motor, 0.19 - ratio * motor];
    for gap in [0.004, 0.015] {
        let slope = |_, u: [f64; 2], [v, w, p0, p1, a0, a1]: [f64; 6]| {
            let ahead = [0.5 * (a0 + a1), (a1 - a0) / (2.0 * HALF_TRACK)];
            let drives = drives_of([u[0] - kept[0] * 1.02 * (v + ahead[0]), u[1] - kept[1] * 1.05 * (w + ahead[1])], ratio);
            let passed = [flank(gap, p0, a0), flank(gap, p1, a1)];
            let accelerations = [
                (0.5 * (passed[0] + passed[1]) - 0.01 * w * w - behind * 1.02 * v) / inertia[0],
                (ratio * (passed[1] - passed[0]) / (2.0 * HALF_TRACK) - 0.05 * v * w - turning * 1.05 * w) / inertia[1],
            ];
            let hubs = wheels(accelerations);
            [
                accelerations[0],
                accelerations[1],
                a0,
                a1,
                (drives[0] - passed[0]) / motor - hubs[0],
                (drives[1] - passed[1]) / motor - hubs[1],
            ]
        };
        let first = wheels([rig.stretch().inputs[0][0], rig.stretch().inputs[1][0]]).map(|u| 0.5 * gap * u.signum());
        let start = [rig.start[0], rig.start[1], first[0], first[1], 0.0, 0.0];
        let values = [gap, spin_up, behind, turning, ratio];
        let error = rig.error(&Backlash::default(), &values, start, &[], slope);
        let wrong = [
            [gap, 0.0, behind, turning, ratio],
            [gap, spin_up, 0.0, turning, ratio],
            [gap, spin_up, behind, behind, ratio],
            [gap, spin_up, behind, turning, 1.0],
            [1.1 * gap, spin_up, behind, turning, ratio],
        ];
        let least =
            wrong.map(|values| rig.error(&Backlash::default(), &values, start, &[], slope)).into_iter().fold(f64::INFINITY, f64::min);
        assert!(error < 0.5 * least, "gap {gap}: {error}, {least} with one value wrong");
        // An encoder at the motor counts what the motor does in the gap as well: over all, what it ran ahead of the wheel.
        let [at_wheel, at_motor] = [false, true].map(|at_motor| rig.mean_run(&Backlash { at_motor, ..Backlash::default() }, &values));
        let truth = integrate(rig.stretch(), start, &[], slope);
        let time = &rig.stretch().time;
        let mut ahead = [0.0; 2];
        let mut off = 0.0;
        for k in 1..truth.len() {
            let recorded = wheels([0, 1].map(|i| at_motor[i][k] - at_wheel[i][k]));
            for side in 0..2 {
                ahead[side] += recorded[side] * (time[k] - time[k - 1]);
                off += (ahead[side] - (truth[k][2 + side] - first[side])).powi(2);
            }
        }
        let off = (off / (2 * truth.len()) as f64).sqrt();
        assert!(off < 0.02 * gap, "gap {gap}: {off}");
    }
}

/// Motors as masses of their own against flanks that give way and damp, and do not pull.
#[test]
fn motors_rebound_where_their_teeth_meet() {
    let rig = body();
    let (gap, spin_up, behind, ratio, meeting, restitution) = (0.01, 0.03, 0.1, 1.2, 0.008, 0.5);
    let own = 0.5 * (1.0 - behind) * (1.02 + 1.05 / ratio);
    let motor = own * spin_up;
    let inertia = [0.26 - motor, 0.19 - ratio * motor];
    // What is pushed back is the motor against a wheel that gives way with the robot.
    let both = 1.0 / (1.0 / motor + 0.5 / inertia[0] + 0.5 * ratio / inertia[1]);
    let (rate, decay) = (std::f64::consts::PI / meeting, -f64::ln(restitution));
    let damping = decay / decay.hypot(std::f64::consts::PI);
    let flank = |place: f64, ahead: f64| {
        let side = place.signum();
        let into = side * place - 0.5 * gap;
        if into > 0.0 { side * (both * rate * (rate * into + 2.0 * damping * side * ahead)).max(0.0) } else { 0.0 }
    };
    let wheels_to_body = |[left, right]: [f64; 2]| [0.5 * (left + right), (right - left) / (2.0 * HALF_TRACK)];
    let slope = |_: f64, u: [f64; 2], [v, w, p0, p1, a0, a1]: [f64; 6]| {
        let ahead = wheels_to_body([a0, a1]);
        let [v, w] = [v - ahead[0], w - ahead[1]];
        let kept = 1.0 - behind;
        let drives = drives_of([u[0] - kept * 1.02 * (v + ahead[0]), u[1] - kept * 1.05 * (w + ahead[1])], ratio);
        let passed = [flank(p0, a0), flank(p1, a1)];
        let accelerations = [
            (0.5 * (passed[0] + passed[1]) - 0.01 * w * w - behind * 1.02 * v) / inertia[0],
            (ratio * (passed[1] - passed[0]) / (2.0 * HALF_TRACK) - 0.05 * v * w - behind * 1.05 * w) / inertia[1],
        ];
        let hubs = wheels(accelerations);
        let faster = [(drives[0] - passed[0]) / motor - hubs[0], (drives[1] - passed[1]) / motor - hubs[1]];
        // As encoders at the motors have it.
        let told = wheels_to_body(faster);
        [accelerations[0] + told[0], accelerations[1] + told[1], a0, a1, faster[0], faster[1]]
    };
    let first = wheels([rig.stretch().inputs[0][0], rig.stretch().inputs[1][0]]).map(|u| 0.5 * gap * u.signum());
    let start = [rig.start[0], rig.start[1], first[0], first[1], 0.0, 0.0];
    let error = |effect: &Backlash, values: &[f64]| rig.error(effect, values, start, &[], slope);
    let bouncing = Backlash { at_motor: true, bouncing: true };
    let right = error(&bouncing, &[gap, spin_up, behind, behind, meeting, restitution, ratio]);
    let plain = error(&Backlash { at_motor: true, ..Backlash::default() }, &[gap, spin_up, behind, behind, ratio]);
    let wrong = [
        [gap, spin_up, behind, behind, meeting, 0.1, ratio],
        [gap, spin_up, behind, behind, 3.0 * meeting, restitution, ratio],
        [1.2 * gap, spin_up, behind, behind, meeting, restitution, ratio],
    ];
    let least = wrong.map(|values| error(&bouncing, &values)).into_iter().fold(plain, f64::min);
    assert!(right < 0.5 * least, "{right}, {plain} without rebounds, {least} with one value wrong");
}

/// Wheels' loops that integrate sum up the error that their encoders tell, by virtual power as above: unequal radii couple it.
#[test]
fn loops_integrate_what_unequal_wheels_tell_them() {
    let rig = body();
    let (e, h, gains, kept) = (0.08, HALF_TRACK, [0.8, 1.5], [1.02, 1.05]);
    let ground = WheelRadiusMismatch { speeds: Speeds::Ground, ..WheelRadiusMismatch::default() };
    let effects: [&dyn Effect; 2] = [&ground, &IntegralAction::default()];
    let scales = [0.97, 1.04];
    let values = [e, 1.0, gains[0], gains[1], 1e3, 1e3, scales[0], scales[1]];
    let error = rig.joint_error(&effects, &values, [0.3, 0.2, 0.0, 0.0], &[], |_, u, [v, w, i, j]| {
        let told = [v - 0.5 * e * h * w, w - 0.5 * e / h * v];
        let asked = [u[0] + i, u[1] + j];
        let still = held([v, w]);
        let push = [asked[0] - kept[0] * v, asked[1] - kept[1] * w];
        let forward = push[0] + kept[0] * (v - told[0]) - 0.5 * e * h * push[1] - still[0];
        let turn = push[1] + kept[1] * (w - told[1]) - 0.5 * e / h * push[0] - still[1];
        [forward / 0.26, turn / 0.19, gains[0] * (u[0] - scales[0] * told[0]), gains[1] * (u[1] - scales[1] * told[1])]
    });
    assert!(error < 1e-3, "{error}");
}

/// A wheel comes to rest anywhere within a step: only there it has to be a short one.
#[test]
fn steps_are_short_where_a_wheel_comes_to_rest() {
    let (rig, friction) = (body(), 0.06);
    let (scene, effect, mut run) = (rig.scene(), CoulombFriction::default(), vec![Vec::new(); 2]);
    let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&effect], &scene).unwrap();
    simulator.set(&rig.theta, &[friction, 1.0]).unwrap();
    simulator.set_accuracy(1e-4, 16);
    simulator.set_substeps(1);
    simulator.run(0, rig.stretch(), &rig.start, &mut run).unwrap();
    let truth = integrate(rig.stretch(), rig.start, &[], |_, u, x| {
        let load = off(wheels(x).map(|s| friction * rig.sign(s)), 1.0);
        (rig.base)([u[0] - load[0], u[1] - load[1]], x)
    });
    let square = |i: usize| truth.iter().zip(&run[i]).map(move |(x, y)| (x[i] - y).powi(2)).sum::<f64>() / truth.len() as f64;
    let error = [0, 1].map(|i| square(i).sqrt() / scene.scales.outputs[i]).into_iter().fold(0.0, f64::max);
    assert!(error < 3e-4, "{error}");
    assert!(simulator.steps() < 2 * truth.len() as u64, "{} steps for {} rows", simulator.steps(), truth.len());
}

/// Runs near by differ by the motion, and not by where one of them halves a step.
#[test]
fn runs_that_follow_another_differ_evenly_from_it() {
    let rig = body();
    let (scene, effect) = (rig.scene(), CoulombFriction::default());
    let mut simulator = EffectSimulator::new(&*rig.model, &rig.theta, &[&effect], &scene).unwrap();
    simulator.set_accuracy(1e-3, 16);
    simulator.set_substeps(1);
    let mut run = |friction: f64, follows: bool| {
        simulator.set(&rig.theta, &[friction, 1.0]).unwrap();
        simulator.set_following(follows);
        let mut run = vec![Vec::new(); 2];
        simulator.run(0, rig.stretch(), &rig.start, &mut run).unwrap();
        run.concat()
    };
    let mut uneven = |follows: bool| {
        let base = run(0.06, false);
        let [near, far] = [0.06003, 0.06006].map(|friction| run(friction, follows));
        let size = |of: &dyn Fn(usize) -> f64| (0..base.len()).map(|k| of(k).powi(2)).sum::<f64>().sqrt();
        size(&|k| far[k] - 2.0 * near[k] + base[k]) / size(&|k| far[k] - base[k])
    };
    let [follows, own] = [true, false].map(&mut uneven);
    assert!(follows < 0.02 && own > 5.0 * follows, "{follows} {own}");
}
