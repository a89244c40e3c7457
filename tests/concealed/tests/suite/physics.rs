//! The physics against closed forms and against scipy's integration of the same bodies written down in another way.

use crate::common::{HALF_TRACK, MASS, RADIUS, WHEEL, bare, rolling, run};
use std::f64::consts::{PI, TAU};
use wheelwright_concealed::plant::bearing::{Bearing, Dry, Law};
use wheelwright_concealed::plant::body::{Body, Load};
use wheelwright_concealed::plant::castor::Castor;
use wheelwright_concealed::plant::contact::{Contact, Tyre};
use wheelwright_concealed::plant::gear::Gear;
use wheelwright_concealed::plant::motor::{Battery, Discharge};
use wheelwright_concealed::plant::surroundings::{Air, Slope};
use wheelwright_concealed::plant::{Rig, State};

fn near(value: f64, wanted: f64, tolerance: f64, what: &str) {
    assert!((value - wanted).abs() <= tolerance, "{what}: {value}, wanted {wanted} within {tolerance}");
}

/// What one wheel carries: half the robot and itself, as inertia at the wheel.
const CARRIED: f64 = 0.5 * MASS * RADIUS * RADIUS + WHEEL;

/// Moved mass with the wheels' inertia \[kg\].
const MOVED: f64 = MASS + 2.0 * WHEEL / (RADIUS * RADIUS);

#[test]
fn coasting_with_the_mass_off_the_axle_is_newtons_and_eulers() {
    // Newton-Euler in the room's frame for centre of mass, yaw and both wheels, with multipliers for "no sideways motion" and "rolls", by
    // scipy solve_ivp(rtol=1e-11): m=9, Iz=0.3, centre of mass at (0.06, 0.03), from v=0.5, omega=2, heading 0.3, after 1.5 s.
    let mut rig = bare();
    rig.body = Body { forward: 0.06, left: 0.03, ..rig.body };
    let energy = |s: &State| rig.body.energy(s.twist[0], s.twist[1]) + 0.5 * WHEEL * (s.wheel[0].powi(2) + s.wheel[1].powi(2));
    let start = rolling(0.5, 2.0, 0.3);
    let end = run(&rig, start, 1.5, |_| 0.0, |_| ());
    near(end.twist[0], 0.589_000_296_3, 1e-6, "v");
    near(end.twist[1], 0.767_146_705_6, 1e-6, "omega");
    near(end.pose.0, 0.070_349_674_8, 1e-6, "x");
    near(end.pose.1, 0.712_655_134_2, 1e-6, "y");
    near(end.pose.2, 2.262_171_766_1, 1e-6, "psi");
    near(energy(&end), energy(&start), 1e-6 * energy(&start), "energy");
}

#[test]
fn rolls_down_a_slope_as_its_mass_and_wheels_let_it() {
    let mut rig = bare();
    rig.surroundings.slope = Some(Slope { pull: 0.6, downhill: 0.0, wave: f64::INFINITY });
    let end = run(&rig, State::default(), 2.0, |_| 0.0, |_| ());
    near(end.twist[0], 0.6 * MASS / MOVED * 2.0, 1e-9, "speed");
    // Pointed across the slope, a centre of mass ahead of the axle turns it downhill.
    rig.body.forward = 0.05;
    let turned = run(&rig, State::at_rest(0.0, PI / 2.0), 0.01, |_| 0.0, |_| ());
    let inertia = rig.body.inertia + MASS * 0.05 * 0.05 + 2.0 * HALF_TRACK.powi(2) * WHEEL / (RADIUS * RADIUS);
    near(turned.twist[1], -0.6 * MASS * 0.05 / inertia * 0.01, 1e-6, "turning");
}

fn dry(torque: f64) -> Dry {
    Dry { forward: torque, backward: torque, breakaway: 1.0, stribeck_speed: 1.0, law: Law::SetValued }
}

fn with_dry(mut rig: Rig, dry: Dry) -> Rig {
    for wheel in &mut rig.wheels {
        wheel.bearing = Bearing { dry: Some(dry), ..Bearing::FREE };
    }
    rig
}

#[test]
fn dry_friction_stops_it_when_it_should_and_then_holds_it() {
    let rig = with_dry(bare(), dry(0.15));
    let stops = 0.5 * MOVED * RADIUS / (2.0 * 0.15);
    let before = run(&rig, rolling(0.5, 0.0, 0.0), 0.9 * stops, |_| 0.0, |_| ());
    near(before.twist[0], 0.05, 1e-3, "speed at nine tenths of the way to rest");
    let after = run(&rig, rolling(0.5, 0.0, 0.0), 1.01 * stops, |_| 0.0, |_| ());
    assert!(after.twist[0].abs() < 1e-12, "at rest: {}", after.twist[0]);
    let held = run(&rig, State::default(), 1.0, |_| 0.149, |_| ());
    assert!(held.twist[0].abs() < 1e-12, "held: {}", held.twist[0]);
    let gone = run(&rig, State::default(), 1.0, |_| 0.2, |_| ());
    near(gone.twist[0], 2.0 * 0.05 / RADIUS / MOVED, 1e-9, "moves with what friction leaves");
}

#[test]
fn friction_on_one_wheel_turns_the_robot() {
    let mut rig = bare();
    rig.wheels[0].bearing.dry = Some(dry(0.1));
    let end = run(&rig, rolling(0.5, 0.0, 0.0), 0.1, |_| 0.0, |_| ());
    assert!(end.twist[1] > 0.0, "turns to the dragging left: {}", end.twist[1]);
    near(end.twist[0], 0.5 - 0.1 / RADIUS / MOVED * 0.1, 1e-6, "slows by one wheel's force");
}

#[test]
fn stick_and_slip_take_the_time_they_take_on_a_belt() {
    // Rotors of endless inertia turn evenly and pull the wheels by soft shafts. With friction Fs at rest and Fk sliding (steep fall), stick
    // lasts 2 (Fs-Fk)/(k V), slip 2 (pi - phi)/w with tan(phi) = (Fs-Fk) w/(k V) and w = sqrt(k/I): the block-on-a-belt textbook result.
    let (stiffness, speed, kinetic, breakaway) = (2.0, 0.8, 0.1, 2.0);
    let friction = Dry { breakaway, stribeck_speed: 1e-6, ..dry(kinetic) };
    let mut rig = with_dry(bare(), friction);
    rig.gear = Some(Gear { gap: 0.0, stiffness, damping: 0.0, rotor: 1e9 });
    let start = State { rotor: [speed; 2], ..State::default() };
    let mut starts: Vec<f64> = Vec::new();
    let mut moving = false;
    run(
        &rig,
        start,
        20.0,
        |_| 0.0,
        |s| {
            let now = s.wheel[0].abs() > 1e-9;
            if now && !moving {
                starts.push(s.t);
            }
            moving = now;
        },
    );
    let pace = (stiffness / CARRIED).sqrt();
    let excess = kinetic * (breakaway - 1.0);
    let stick = 2.0 * excess / (stiffness * speed);
    let slip = 2.0 * (PI - (excess * pace / (stiffness * speed)).atan()) / pace;
    assert!(starts.len() > 5, "{starts:?}");
    for pair in starts.windows(2).skip(1) {
        near(pair[1] - pair[0], stick + slip, 0.01 * (stick + slip), "period");
    }
}

#[test]
fn bristles_are_scipys_bristles() {
    // LuGre with Stribeck curve on J w' = tau - T, tau = 0.45 sin(2 pi 0.4 t), by scipy solve_ivp(LSODA, rtol=1e-10).
    let law = Law::Bristles { deflection: 0.01, damping: 1e-3 };
    let rig = with_dry(bare(), Dry { breakaway: 2.0, stribeck_speed: 0.5, law, ..dry(0.2) });
    let wanted = [(0.4, 0.192_557_29), (0.8, 1.010_947_47), (1.3, 1.028_656_83), (2.0, -1.817_014_58), (3.0, 0.732_887_18)];
    for (t, speed) in wanted {
        let end = run(&rig, State::default(), t, |t| 0.45 * (TAU * 0.4 * t).sin(), |_| ());
        near(end.wheel[0], speed, 0.01, "wheel speed");
    }
}

#[test]
fn two_masses_on_a_shaft_ring_at_their_frequency() {
    let (stiffness, rotor) = (40.0, 0.03);
    let mut rig = bare();
    rig.gear = Some(Gear { gap: 0.0, stiffness, damping: 0.0, rotor });
    let start = State { rotor_angle: [0.05; 2], ..State::default() };
    let mut crossings: Vec<f64> = Vec::new();
    let mut before = 0.05;
    run(
        &rig,
        start,
        3.0,
        |_| 0.0,
        |s| {
            let twist = s.rotor_angle[0] - s.angle[0];
            if twist > 0.0 && before <= 0.0 {
                crossings.push(s.t);
            }
            before = twist;
        },
    );
    let wanted = (stiffness * (1.0 / rotor + 1.0 / CARRIED)).sqrt() / TAU;
    let found = (crossings.len() - 1) as f64 / (crossings.last().unwrap() - crossings[0]);
    near(found, wanted, 1e-3 * wanted, "frequency");
}

#[test]
fn a_gap_in_the_gear_is_scipys_gap() {
    // Two masses, flanks of 800 N m/rad with 1.2 N m s/rad beyond +-0.05 rad, +-0.3 N m every half second, by scipy solve_ivp(max_step=2e-4).
    let mut rig = bare();
    rig.gear = Some(Gear { gap: 0.1, stiffness: 800.0, damping: 1.2, rotor: 0.014 });
    for wheel in &mut rig.wheels {
        wheel.inertia = 0.006;
    }
    let wanted = [(0.5, 0.566_090_47, 2.307_692_31), (1.0, 1.164_678_76, 0.0), (1.5, 1.719_936_63, 2.307_695_79), (3.0, 3.472_371_06, 0.0)];
    for (t, angle, speed) in wanted {
        let end = run(&rig, State::default(), t, |t| if t.rem_euclid(1.0) < 0.5 - 1e-9 { 0.3 } else { -0.3 }, |_| ());
        near(end.angle[0], angle, 2e-3, "wheel angle");
        near(end.wheel[0], speed, 5e-3, "wheel speed");
    }
}

#[test]
fn electric_power_becomes_heat_motion_and_friction() {
    let mut rig = bare();
    for (motor, wheel) in rig.motors.iter_mut().zip(&mut rig.wheels) {
        motor.torque_constant = 0.4;
        motor.back_emf = 0.4;
        motor.resistance = 1.5;
        wheel.bearing = Bearing { viscous: 0.01, ..Bearing::FREE };
    }
    let (mut power_in, mut heat, mut lost) = (0.0, 0.0, 0.0);
    let step = rig.longest_step();
    let end = run(
        &rig,
        State::default(),
        6.0,
        |_| 6.0,
        |s| {
            let current = (6.0 - 0.4 * s.wheel[0]) / 1.5;
            power_in += 2.0 * step * 6.0 * current;
            heat += 2.0 * step * 1.5 * current * current;
            lost += 2.0 * step * 0.01 * s.wheel[0].powi(2);
        },
    );
    let motion = 0.5 * MOVED * end.twist[0].powi(2);
    near(heat + lost + motion, power_in, 2e-3 * power_in, "energy");
    // And it settles where back-EMF and viscous friction leave no torque to spare.
    near(end.wheel[0], 0.4 * 6.0 / 1.5 / (0.4 * 0.4 / 1.5 + 0.01), 0.02, "speed");
}

#[test]
fn the_brush_is_what_its_bristles_add_up_to() {
    // Parabolic pressure, linear bristles from the leading edge, each sticking until its share of friction: added up numerically.
    let tyre = Tyre { stiffness: 300.0, grip: 40.0, floor: 0.01 };
    for slip in [0.01, 0.05, 0.15, 0.3, 0.39, 0.5, -0.2f64] {
        let cells = 20_000;
        let force: f64 = (0..cells)
            .map(|k| {
                let x = (k as f64 + 0.5) / cells as f64;
                let pressure = 6.0 * x * (1.0 - x) * tyre.grip;
                let bristle = 2.0 * tyre.stiffness * slip.abs() * x;
                pressure.min(bristle) / cells as f64
            })
            .sum();
        near(tyre.force(slip), force * slip.signum(), 1e-3 * tyre.grip, "force");
    }
}

#[test]
fn a_tyre_creeps_by_what_its_load_asks() {
    let tyre = Tyre { stiffness: 60.0, grip: 30.0, floor: 0.02 };
    let mut rig = bare();
    rig.surroundings.slope = Some(Slope { pull: -1.0, downhill: 0.0, wave: f64::INFINITY });
    for wheel in &mut rig.wheels {
        wheel.contact = Contact::Tyre(tyre);
    }
    // Held at even speed against the slope by just the torque it takes, 4.5 N a wheel.
    let end = run(&rig, rolling(0.5, 0.0, 0.0), 0.5, |_| 0.45, |_| ());
    let rim = RADIUS * end.wheel[0];
    near(tyre.force((rim - end.twist[0]) / rim), 4.5, 0.05, "force");
    // More than friction allows: the robot gets no more than grip, the wheels spin (this tyre slides from a slip of 0.3).
    for wheel in &mut rig.wheels {
        wheel.contact = Contact::Tyre(Tyre { stiffness: 300.0, ..tyre });
    }
    let spun = run(&rig, State::default(), 0.5, |_| 10.0, |_| ());
    near(spun.twist[0], (2.0 * 30.0 / MASS - 1.0) * 0.5, 0.05, "speed with spinning wheels");
    assert!(RADIUS * spun.wheel[0] > 3.0 * spun.twist[0]);
}

#[test]
fn a_castor_comes_round_over_its_trail_and_costs_its_rolling_force() {
    let trail = 0.05;
    let castor = Castor { pivot: -0.2, trail, inertia: 1e-6, rolling: 2.0, swivel: 0.0, lateral: 400.0, floor: 0.01 };
    let mut rig = bare();
    rig.body.mass = 1e6;
    rig.body.inertia = 1e6;
    rig.castor = Some(castor);
    // Without side slip, tan(delta/2) decays with exp(-distance/trail).
    let start = State { swivel: (1.0, 0.0), ..rolling(0.3, 0.0, 0.0) };
    let end = run(&rig, start, 0.25, |_| 0.0, |_| ());
    near((0.5 * end.swivel.0).tan(), 0.5f64.tan() * (-0.075f64 / trail).exp(), 4e-3, "swivel");
    rig.body = Body { mass: MASS, ..bare().body };
    let slowed = run(&rig, rolling(0.5, 0.0, 0.0), 0.5, |_| 0.0, |_| ());
    near(slowed.twist[0], 0.5 - 2.0 / MOVED * 0.5, 1e-3, "speed");
}

#[test]
fn air_slows_with_the_square_of_speed() {
    let mut rig = bare();
    rig.surroundings.air = Some(Air { drag: 5.0, yaw: 0.0, power: 2.0 });
    let end = run(&rig, rolling(1.0, 0.0, 0.0), 2.0, |_| 0.0, |_| ());
    near(end.twist[0], 1.0 / (1.0 + 5.0 * 2.0 / MOVED), 1e-6, "speed");
}

#[test]
fn a_load_comes_on_at_the_robots_speed_and_moves_the_middle_of_mass() {
    let mut rig = bare();
    let body = Body { mass: 3.0, inertia: 0.02, forward: 0.2, left: 0.0 };
    rig.load = Some(Load { body, on: (1.0, 1.0), off: (3.0, 3.0) });
    let carried = rig.body_at(2.0);
    near(carried.mass, 12.0, 1e-12, "mass");
    near(carried.forward, 0.05, 1e-12, "middle of mass");
    near(carried.inertia, 0.3 + 0.02 + 9.0 * 0.05f64.powi(2) + 3.0 * 0.15f64.powi(2), 1e-12, "inertia");
    assert_eq!(rig.body_at(3.5), rig.body);
    let end = run(&rig, rolling(0.5, 0.0, 0.0), 2.0, |_| 0.0, |_| ());
    near(end.twist[0], 0.5, 1e-9, "speed");
    let pushed = run(&rig, State { t: 1.0, ..State::default() }, 1.0, |_| 0.3, |_| ());
    near(pushed.twist[0], 2.0 * 0.3 / RADIUS / (MOVED + 3.0), 1e-6, "speed with load");
}

#[test]
fn an_off_centre_wheel_covers_what_its_radius_says() {
    let mut rig = bare();
    for wheel in &mut rig.wheels {
        wheel.eccentricity = 0.05;
    }
    let mut worst = 0.0f64;
    run(
        &rig,
        rolling(0.5, 0.0, 0.0),
        3.0,
        |_| 0.02,
        |s| {
            worst = worst.max((s.twist[0] / s.wheel[0] - RADIUS * (1.0 + 0.05 * s.angle[0].cos())).abs());
        },
    );
    assert!(worst < 1e-4 * RADIUS, "radius off by {worst}");
}

#[test]
fn batteries_fall_as_their_shape_says() {
    let even = Battery { loss: 0.2, span: 100.0, shape: Discharge::Even, per_ampere: 0.01 };
    near(even.factor(50.0, 3.0), 1.0 - 0.1 - 0.03, 1e-12, "even");
    let settling = Battery { shape: Discharge::Settling(0.3), per_ampere: 0.0, ..even };
    near(settling.factor(100.0, 0.0), 0.8, 1e-12, "settling, at its span");
    assert!(settling.factor(30.0, 0.0) < even.factor(30.0, 0.0));
    let cell = Battery { shape: Discharge::Step(0.4), per_ampere: 0.0, ..even };
    assert_eq!((cell.factor(39.9, 0.0), cell.factor(40.1, 0.0)), (1.0, 0.8));
}
