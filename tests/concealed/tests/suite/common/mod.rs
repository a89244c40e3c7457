//! A bare robot for the physics tests: no firmware, motors that turn one volt into one newton metre.

use wheelwright_concealed::plant::bearing::Bearing;
use wheelwright_concealed::plant::body::Body;
use wheelwright_concealed::plant::contact::Contact;
use wheelwright_concealed::plant::motor::{Battery, Motor};
use wheelwright_concealed::plant::surroundings::Surroundings;
use wheelwright_concealed::plant::{Rig, State, Wheel};

/// Mass \[kg\] of the bare robot.
pub(crate) const MASS: f64 = 9.0;
/// Wheel radius \[m\].
pub(crate) const RADIUS: f64 = 0.1;
/// Inertia of each wheel \[kg m²\].
pub(crate) const WHEEL: f64 = 0.02;
/// Half track \[m\].
pub(crate) const HALF_TRACK: f64 = 0.17;

/// A robot without friction, drag or back-EMF.
pub(crate) fn bare() -> Rig {
    let motor = Motor {
        torque_constant: 1.0,
        back_emf: 0.0,
        resistance: 1.0,
        electric_time: 0.0,
        current_limit: f64::INFINITY,
        voltage_limit: f64::INFINITY,
        voltage_lost: 0.0,
        amplifier: 1.0,
        cogging: (0.0, 1.0),
    };
    let wheel = Wheel {
        radius: RADIUS,
        eccentricity: 0.0,
        lobes: 1.0,
        phase: 0.0,
        inertia: WHEEL,
        bearing: Bearing::FREE,
        contact: Contact::Rolling,
    };
    Rig {
        body: Body { mass: MASS, inertia: 0.3, forward: 0.0, left: 0.0 },
        wheels: [wheel; 2],
        motors: [motor; 2],
        half_track: HALF_TRACK,
        battery: Battery::STIFF,
        rolling_resistance: 0.0,
        third_wheel: -0.2,
        gear: None,
        dragging_ball: None,
        castor: None,
        scrub: None,
        load: None,
        lifted: None,
        surroundings: Surroundings::default(),
        soft_speed: 1e-3,
    }
}

/// Rolling without slipping at `v` and `omega`.
pub(crate) fn rolling(v: f64, omega: f64, heading: f64) -> State {
    let wheel = [(v - HALF_TRACK * omega) / RADIUS, (v + HALF_TRACK * omega) / RADIUS];
    State { pose: (0.0, 0.0, heading), twist: [v, omega], wheel, rotor: wheel, ..State::default() }
}

/// Runs a rig for `length` seconds; `volts` says what both motors get at a time, `watch` sees every state.
pub(crate) fn run(rig: &Rig, mut state: State, length: f64, volts: impl Fn(f64) -> f64, mut watch: impl FnMut(&State)) -> State {
    let step = rig.longest_step();
    let start = state.t;
    for k in 0..(length / step).round() as usize {
        state.t = start + k as f64 * step;
        let u = volts(state.t);
        state = rig.step(&state, [u, u], step);
        watch(&state);
    }
    state
}
