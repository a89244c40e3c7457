//! Each part against a calculation by hand, on a robot whose motors hang in the air (a circuit of a gigaohm) unless they are needed.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use super::machine::*;
use super::*;
use crate::simulator::control::{ControlLaw, WheelGains};
use crate::simulator::plant::{Plant, PlantConstants, Sides};

const OPEN: PlantConstants = PlantConstants {
    mass: 9.0,
    yaw_inertia: 0.21,
    com_offset: 0.0,
    track_width: 0.34,
    wheel_radius: 0.1,
    tyre_radius: None,
    resistance: 1e9,
    torque_constant: 0.8,
    emf_constant: 0.8,
    wheel_inertia: 0.012,
    wheel_friction: 0.0,
    supply_voltage: None,
};
const DRIVEN: PlantConstants = PlantConstants { resistance: 1.2, ..OPEN };
const LAW: ControlLaw = ControlLaw::WheelPd(WheelGains { kp: 6.0, kd: 0.9 });

fn physics(text: &str) -> Physics {
    let physics: Physics = wheelwright_core::config::plain(text.parse().unwrap()).unwrap();
    physics.check().unwrap();
    physics
}

fn machine(c: PlantConstants, text: &str) -> Machine {
    Machine::new(c, LAW, physics(text), Plant::new(c, LAW).step())
}

fn run(machine: &mut Machine, seconds: f64, set_point: [f64; 2]) {
    machine.advance(seconds, |_| set_point, |_, _| {});
}

/// Mass that straight motion has to move: the body's, and the wheels' at the rim.
fn moved(c: &PlantConstants) -> f64 {
    c.mass + 2.0 * c.wheel_inertia / c.wheel_radius.powi(2)
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} within {tolerance}");
}

#[test]
fn parts_that_do_nothing_leave_the_rigid_plant() {
    let c = PlantConstants { com_offset: -0.035, ..DRIVEN };
    let plant = Plant::new(c, LAW);
    let mut state = crate::simulator::State::default();
    let mut idle = machine(c, "body = {}\ncontact = {}\nmotors = {}\nwheels = {}");
    for k in 0..50 {
        let set_point = [0.4 + 0.3 * (0.3 * f64::from(k)).sin(), 0.8 * (0.2 * f64::from(k)).cos()];
        plant.advance(&mut state, 0.1, |_| set_point);
        run(&mut idle, 0.1, set_point);
        let found = idle.state();
        for (a, b) in [
            (found.v, state.v),
            (found.omega, state.omega),
            (found.x, state.x),
            (found.phi, state.phi),
            (found.wheels.left, state.wheels.left),
        ] {
            near(a, b, 1e-7);
        }
    }
}

#[test]
fn air_slows_as_the_inverse_of_time() {
    let mut m = machine(OPEN, "body.air_drag = 2.0");
    m.place(V, 1.5);
    run(&mut m, 4.0, [0.0; 2]);
    near(m.at(V), 1.5 / (1.0 + 2.0 * 1.5 * 4.0 / moved(&OPEN)), 1e-6);
}

#[test]
fn a_slope_pulls_downhill_only() {
    let mut m = machine(OPEN, "terrain = { slope = 0.1, uphill = 0.0 }");
    run(&mut m, 1.0, [0.0; 2]);
    near(m.at(V), -GRAVITY * 9.0 * 0.1_f64.sin() / moved(&OPEN), 1e-6);
    let mut level = machine(OPEN, "terrain = { slope = 0.1, strip = [1.0, 2.0] }");
    run(&mut level, 1.0, [0.0; 2]);
    assert_eq!(level.at(V), 0.0);
    let mut along = machine(OPEN, "terrain = { slope = 0.1, uphill = 1.5707963267948966 }");
    run(&mut along, 1.0, [0.0; 2]);
    near(along.at(V), 0.0, 1e-9);
}

#[test]
fn coulomb_friction_slows_evenly_and_then_holds() {
    let mut m = machine(OPEN, "friction.coulomb = 0.1");
    let v = 0.5;
    m.place(V, v);
    let brake = 2.0 * 0.1 / 0.1 / moved(&OPEN);
    run(&mut m, 1.0, [0.0; 2]);
    // The bristles take a moment to bend: 2 mrad of the wheel, 0.2 mm of path.
    near(m.at(V), v - brake, 2e-3);
    run(&mut m, 5.0, [0.0; 2]);
    near(m.at(V), 0.0, 1e-3);
    // A slope that pulls with less than breakaway is held: 2 Ts / r = 2.0 N against 9 g sin.
    let mut held = machine(OPEN, "friction.coulomb = 0.1\nterrain.slope = 0.015");
    run(&mut held, 3.0, [0.0; 2]);
    assert!(held.at(V).abs() < 1e-3 && held.at(X).abs() < 1e-3, "{} {}", held.at(V), held.at(X));
    let mut slides = machine(OPEN, "friction.coulomb = 0.1\nterrain.slope = 0.03");
    run(&mut slides, 3.0, [0.0; 2]);
    near(slides.at(V), -(9.0 * GRAVITY * 0.03_f64.sin() - 2.0) / moved(&OPEN) * 3.0, 0.03);
}

#[test]
fn friction_breaks_away_above_what_it_slides_with() {
    // 2.6 N of slope: below breakaway (2 × 0.15 / 0.1 = 3 N), above sliding (2 N).
    let slope = "terrain.slope = 0.0295\nfriction = { coulomb = 0.1, breakaway = 0.15, stribeck_speed = 0.3 }";
    let mut held = machine(OPEN, slope);
    run(&mut held, 2.0, [0.0; 2]);
    assert!(held.at(V).abs() < 1e-3, "{}", held.at(V));
    let mut pushed = machine(OPEN, slope);
    pushed.place(V, -0.3);
    run(&mut pushed, 2.0, [0.0; 2]);
    assert!(pushed.at(V) < -0.31, "{}", pushed.at(V));
}

#[test]
fn friction_of_one_side_or_direction_is_that_alone() {
    let speed_after = |text: &str, v: f64| {
        let mut m = machine(OPEN, text);
        m.place(V, v);
        run(&mut m, 0.5, [0.0; 2]);
        (m.at(V), m.at(OMEGA))
    };
    let (_, turning) = speed_after("friction = { coulomb = 0.05, right = 0.0 }", 0.5);
    // The left wheel is held back, so the robot turns left: omega' = (T/r)(d/2)/(Iz + 2 Ie (d/2)²/r²).
    let inertia = 0.21 + 2.0 * 0.012 * (0.17_f64 / 0.1).powi(2);
    near(turning, 0.5 * 0.5 * 0.17 / inertia, 0.02);
    let forward = speed_after("friction = { coulomb = 0.05, backward = 2.0 }", 0.5).0;
    let backward = speed_after("friction = { coulomb = 0.05, backward = 2.0 }", -0.5).0;
    near((0.5 + backward) / (0.5 - forward), 2.0, 0.05);
}

#[test]
fn rolling_resistance_and_scrub_brake_what_they_are_about() {
    let mut m = machine(OPEN, "contact.rolling_resistance = 0.02");
    m.place(V, 1.0);
    run(&mut m, 2.0, [0.0; 2]);
    near(m.at(V), 1.0 - 2.0 * 0.02 * 9.0 * GRAVITY / moved(&OPEN), 1e-6);
    let mut turning = machine(OPEN, "contact.scrub = 0.2");
    turning.place(OMEGA, 2.0);
    run(&mut turning, 1.0, [0.0; 2]);
    let inertia = 0.21 + 2.0 * 0.012 * (0.17_f64 / 0.1).powi(2);
    near(turning.at(OMEGA), 2.0 - 0.2 / inertia, 1e-6);
}

#[test]
fn tyres_push_no_more_than_their_friction() {
    // Full voltage breaks the tyres loose: the body gets μ g, whatever the wheels do.
    let mut m = machine(DRIVEN, "contact.slip = { friction = 0.1, stiffness = 500.0 }");
    run(&mut m, 1.0, [3.0, 0.0]);
    near(m.at(V), 0.1 * GRAVITY, 0.02);
    assert!(0.1 * m.at(SPIN) > m.at(V) + 0.3, "the wheels spin: {}", m.at(SPIN));
    // A tyre that just creeps passes its force on: steady, C s = F.
    let mut hill = machine(OPEN, "contact.slip = { friction = 0.8, stiffness = 400.0 }\nterrain.slope = 0.05");
    run(&mut hill, 1.0, [0.0; 2]);
    let spun = 2.0 * 0.012 / 0.1_f64.powi(2) * GRAVITY * 9.0 * 0.05_f64.sin() / moved(&OPEN);
    near(hill.at(V) - 0.1 * hill.at(SPIN), -0.5 * spun / 400.0, 2e-5);
}

#[test]
fn a_curve_too_fast_slides_outwards() {
    let across = |friction: f64| {
        let mut m = machine(OPEN, &format!("contact.slip = {{ friction = {friction}, stiffness = 2000.0 }}"));
        for (place, value) in [(V, 1.0), (OMEGA, 2.0), (SPIN, 6.6), (SPIN + 1, 13.4)] {
            m.place(place, value);
        }
        run(&mut m, 0.3, [0.0; 2]);
        m.at(ACROSS)
    };
    // v ω = 2 m/s² is 0.2 g: held with 0.8, not with 0.1. On a left turn outwards is to the right.
    assert!(across(0.8).abs() < 0.01, "{}", across(0.8));
    assert!(across(0.1) < -0.1, "{}", across(0.1));
}

#[test]
fn a_castor_turns_into_the_motion() {
    let mut m = machine(PlantConstants { mass: 1e6, ..OPEN }, "castor = { x = -0.2, trail = 0.03, angle = 3.0 }");
    m.place(V, 0.1);
    run(&mut m, 1.0, [0.0; 2]);
    // Pulled straight on: tan(δ/2) falls with the path over the trail.
    let expected = 2.0 * ((1.5_f64).tan() * (-0.1_f64 / 0.03).exp()).atan();
    near(m.at(CASTOR), expected, 1e-6);
}

#[test]
fn a_castor_drags_straight_on_and_pushes_when_it_swivels() {
    let mut m = machine(OPEN, "castor = { x = -0.2, trail = 0.03, drag = 1.5 }");
    m.place(V, 1.0);
    run(&mut m, 2.0, [0.0; 2]);
    near(m.at(V), 1.0 - 2.0 * 1.5 / moved(&OPEN), 1e-6);
    // Steadily swivelling against its bearing: the torque goes into the body, with the side force at the lever.
    let castor = physics("castor = { x = -0.2, trail = 0.03, swivel = 0.06 }").castor.unwrap();
    let (force, moment, rate) = castor.act(0.0, 1.0, 0.0, 0.5);
    near(rate, -0.2 * 0.5 / 0.03 - 0.5, 1e-12);
    near(force[1], 0.06 / 0.03, 1e-9);
    near(moment, -0.2 * 2.0 - 0.06, 1e-9);
}

#[test]
fn a_battery_sags_under_load_and_empties() {
    // Blocked wheels: an endless mass. Each motor takes U/Ra; the bus falls by R times the sum over the driver's efficiency of one.
    let c = PlantConstants { mass: 1e9, yaw_inertia: 1e9, ..DRIVEN };
    let mut m = machine(c, "battery = { open_circuit = 12.0, resistance = 0.2 }");
    run(&mut m, 1.0, [100.0, 0.0]);
    // 2 U/1.2 flows: U = 12 - 0.2 × 2 U/1.2.
    near(m.at(BUS), 12.0 / (1.0 + 0.4 / 1.2), 1e-6);
    let battery = physics("battery = { open_circuit = 12.0, resistance = 0.2, capacity = 1.0, empty = 10.0 }").battery.unwrap();
    near(battery.open_voltage(1800.0), 11.0, 1e-12);
    let mut idle = machine(DRIVEN, "battery = { open_circuit = 12.0, resistance = 0.1, capacity = 1.0, idle = 2.0 }");
    run(&mut idle, 10.0, [0.0; 2]);
    near(idle.at(CHARGE), 20.0, 0.05);
}

#[test]
fn an_empty_battery_turns_the_motors_slower() {
    let speed = |drawn: f64| {
        let text = format!("battery = {{ open_circuit = 12.0, resistance = 0.01, capacity = 1.0, empty = 9.0, drawn = {drawn} }}");
        let mut m = machine(PlantConstants { wheel_friction: 0.01, ..DRIVEN }, &text);
        run(&mut m, 8.0, [20.0, 0.0]);
        m.at(V)
    };
    near(speed(1.0) / speed(0.0), 0.75, 2e-3);
}

#[test]
fn a_limited_current_limits_the_torque() {
    let mut m = machine(DRIVEN, "motors.current_limit = 0.5");
    run(&mut m, 0.5, [2.0, 0.0]);
    near(m.at(V), 0.5 * 2.0 * 0.8 * 0.5 / 0.1 / moved(&DRIVEN), 1e-6);
}

#[test]
fn an_inductance_delays_the_current() {
    // Blocked: i = U/R (1 - exp(-t R/L)), and the wheels' torque shows in the speed of a heavy robot.
    let c = PlantConstants { mass: 1e6, ..DRIVEN };
    let text = "motors.inductance = 0.24\nfirmware = { period = 1.0, kp = 0.0, feed_forward = 0.1 }";
    let mut m = machine(c, text);
    run(&mut m, 0.4, [1.0, 0.0]);
    let (u, tau, t) = (0.1 * 10.0, 0.2, 0.4_f64);
    let impulse = 0.8 * u / 1.2 * (t - tau * (1.0 - (-t / tau).exp()));
    near(m.at(V) * moved(&c), 2.0 * impulse / 0.1, 1e-4);
}

#[test]
fn motors_that_differ_turn_the_robot() {
    let text = "motors = { left = 1.0, right = 1.2 }\nfirmware = { period = 0.01, kp = 0.0, feed_forward = 0.8 }";
    let mut m = machine(PlantConstants { wheel_friction: 1e-6, ..DRIVEN }, text);
    run(&mut m, 10.0, [0.5, 0.0]);
    // Without a load the wheels turn at U/kb: the stronger motor slower, by its own back-EMF.
    let (left, right) = (5.0, 5.0 / 1.2);
    near(m.at(OMEGA), 0.1 * (right - left) / 0.34, 2e-3);
}

#[test]
fn wheels_that_differ_drive_a_circle() {
    let mut m = machine(DRIVEN, "wheels = { left = 1.02, right = 0.98, track = 1.1 }");
    run(&mut m, 5.0, [0.5, 0.0]);
    let speeds = m.observed().speeds;
    let believed = speeds.to_body(0.34, 0.1);
    near(m.at(V), 0.5 * 0.1 * (1.02 * speeds.left + 0.98 * speeds.right), 1e-9);
    near(m.at(OMEGA), 0.1 * (0.98 * speeds.right - 1.02 * speeds.left) / (1.1 * 0.34), 1e-9);
    assert!((m.at(OMEGA) - believed[1]).abs() > 0.02, "the encoders do not see it");
}

#[test]
fn an_eccentric_wheel_rolls_its_mean_in_a_turn_and_more_or_less_within() {
    let mut m = machine(
        PlantConstants { mass: 1e-3, yaw_inertia: 1e3, ..DRIVEN },
        "wheels = { left_eccentricity = 0.05, right_eccentricity = 0.05 }",
    );
    let mut fastest = (f64::INFINITY, 0.0_f64);
    for _ in 0..400 {
        run(&mut m, 0.01, [0.5, 0.0]);
        let ratio = m.at(V) / (0.1 * m.observed().speeds.left);
        fastest = (fastest.0.min(ratio), fastest.1.max(ratio));
    }
    near(fastest.0, 0.95, 1e-3);
    near(fastest.1, 1.05, 1e-3);
    // The path of an angle a is r (a + e sin a).
    let angle = m.at(ANGLE);
    near(m.at(X), 0.1 * (angle + 0.05 * angle.sin()), 1e-6);
}

#[test]
fn play_is_crossed_before_the_wheel_follows() {
    let mut m = machine(DRIVEN, "gear = { play = 0.1, stiffness = 100.0 }\ncontact.rolling_resistance = 0.05");
    let ahead = |m: &Machine| m.at(SHAFT) - m.at(ANGLE);
    // Steady, each gear passes on half of the rolling resistance: half the play and the bend of the teeth under it.
    let steady = 0.05 + 0.5 * 0.05 * 9.0 * GRAVITY * 0.1 / 100.0;
    run(&mut m, 4.0, [0.3, 0.0]);
    near(ahead(&m), steady, 1e-4);
    run(&mut m, 4.0, [-0.3, 0.0]);
    near(ahead(&m), -steady, 1e-4);
}

#[test]
fn a_load_put_on_is_one_more_mass_from_then_on() {
    // Under an even pull of a slope the speed gained is the same mass-for-mass, but for the wheels.
    let mut m = machine(OPEN, "payload = { mass = 9.0, time = 1.0, until = 2.0 }\nterrain.slope = 0.1");
    let pull = GRAVITY * 0.1_f64.sin();
    let wheels = moved(&OPEN) - 9.0;
    run(&mut m, 1.0, [0.0; 2]);
    let first = -pull * 9.0 / (9.0 + wheels);
    near(m.at(V), first, 1e-6);
    run(&mut m, 1.0, [0.0; 2]);
    let second = first - pull * 18.0 / (18.0 + wheels);
    near(m.at(V), second, 1e-4);
    run(&mut m, 1.0, [0.0; 2]);
    near(m.at(V), second + first, 2e-4);
}

#[test]
fn a_load_beside_the_middle_moves_centre_and_inertia_by_the_parallel_axes() {
    let load = physics("payload = { mass = 3.0, time = 0.0, x = 0.2, y = -0.1, inertia = 0.01 }").payload;
    let whole = body::Mass::of(&OPEN, None, load.as_ref(), 1.0);
    near(whole.mass, 12.0, 1e-12);
    near(whole.ahead, 0.05, 1e-12);
    near(whole.left, -0.025, 1e-12);
    // Steiner, both about the common centre: 9 (0.05² + 0.025²) + 3 (0.15² + 0.075²).
    near(whole.inertia, 0.21 + 0.01 + 9.0 * (0.0025 + 0.000625) + 3.0 * (0.0225 + 0.005625), 1e-12);
}

#[test]
fn a_centre_of_mass_beside_the_middle_turns_a_robot_that_is_pushed() {
    let mut m = machine(OPEN, "body.com_left = 0.05\nterrain.slope = 0.1");
    run(&mut m, 1e-3, [0.0; 2]);
    // At rest, rolling: (m + 2Ie/r²) v' - m c ω' = -m g s; (Iz + m c² + 2 Ie h²/r²) ω' - m c v' = m g s c.
    let (wheels, h, c) = (1.2, 0.17, 0.05);
    let pull = 9.0 * GRAVITY * 0.1_f64.sin();
    let (a, b, d) = (9.0 + 2.0 * wheels, -9.0 * c, 0.21 + 9.0 * c * c + 2.0 * wheels * h * h);
    let (right1, right2) = (-pull, pull * c);
    let det = a * d - b * b;
    near(m.at(V) / 1e-3, (right1 * d - b * right2) / det, 1e-3);
    near(m.at(OMEGA) / 1e-3, (a * right2 - b * right1) / det, 1e-3);
}

#[test]
fn firmware_samples_and_its_sum_leaves_no_error() {
    let gains = "period = 0.01, kp = 1.5, ki = 6.0";
    let mut m = machine(PlantConstants { wheel_friction: 0.05, ..DRIVEN }, &format!("firmware = {{ {gains} }}\nfriction.coulomb = 0.2"));
    run(&mut m, 6.0, [0.4, 0.5]);
    near(m.at(V), 0.4, 1e-3);
    near(m.at(OMEGA), 0.5, 5e-3);
    // Between ticks nothing new is asked for: a set point that changes after a tick is met at the next.
    let mut late = machine(DRIVEN, "firmware = { period = 0.2, kp = 1.5 }");
    late.advance(0.19, |t| if t > 0.01 { [1.0, 0.0] } else { [0.0; 2] }, |_, _| {});
    assert_eq!(late.at(V), 0.0);
    run(&mut late, 0.05, [1.0, 0.0]);
    assert!(late.at(V) > 0.001);
}

#[test]
fn firmware_sees_whole_ticks_only() {
    let c = PlantConstants { mass: 1e9, ..DRIVEN };
    let firmware = physics("firmware = { period = 0.01, kp = 1.0, ticks_per_revolution = 100.0 }").firmware.unwrap();
    let mut running = firmware::Loop::default();
    let tick = std::f64::consts::TAU / 100.0;
    let mut volts = Vec::new();
    for k in 0..4 {
        let angle = 0.4 * tick * f64::from(k);
        running.tick(&firmware, &c, Sides { left: angle, right: angle }, [0.0; 2]);
        volts.push(running.volts.left);
    }
    // 0, 0.4, 0.8 and 1.2 ticks: the fourth look sees one tick in 10 ms.
    assert_eq!(volts[..3], [0.0, 0.0, 0.0]);
    near(volts[3], -tick / 0.01, 1e-9);
}

#[test]
fn impossible_values_name_their_key() {
    let refused = |text: &str| {
        let physics: Physics = wheelwright_core::config::plain(text.parse().unwrap()).unwrap();
        physics.check().unwrap_err().to_string()
    };
    for (text, key) in [
        ("battery = { open_circuit = -1.0 }", "`physics.battery.open_circuit`"),
        ("friction = { coulomb = 0.2, breakaway = 0.1 }", "`physics.friction.breakaway`"),
        ("gear = { play = 0.0 }", "`physics.gear.play`"),
        ("contact.slip = { friction = 0.0, stiffness = 1.0 }", "`physics.contact.slip.friction`"),
        ("link.delay = -0.1", "`physics.link.delay`"),
        ("payload = { mass = 1.0, time = 2.0, until = 1.0 }", "`physics.payload.until`"),
        ("wheels.left_eccentricity = 0.9", "`physics.wheels.left_eccentricity`"),
        ("firmware = { period = 0.0, kp = 1.0 }", "`physics.firmware.period`"),
        ("terrain.slope = 2.0", "`physics.terrain.slope`"),
        ("castor = { x = 0.1, trail = 0.0 }", "`physics.castor.trail`"),
        ("sensing.stamp_jitter = -1.0", "`physics.sensing.stamp_jitter`"),
        ("motors.left = 0.0", "`physics.motors.left`"),
        ("body.air_drag = -1.0", "`physics.body.air_drag`"),
    ] {
        let message = refused(text);
        assert!(message.contains(key), "{text}: {message}");
    }
}
