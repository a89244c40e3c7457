//! Forces from air, ground and third wheel.

use super::{Parameters, Subject, parameters};
use crate::plant::castor::Castor;
use crate::plant::contact::{Scrub, Tyre};
use crate::plant::surroundings::{Air, GRAVITY, Slope};
use rand::Rng;
use rand::rngs::StdRng;
use std::f64::consts::TAU;

/// Resistance with the square of speed, forward and turning.
pub fn quadratic(s: &mut Subject, _: &mut StdRng) -> Parameters {
    let (v, w) = (s.speed(), s.machine.typical[1].abs());
    let (drag, yaw) = (s.force(0.15 * s.strength) / (v * v), s.torque(0.15 * s.strength) / (w * w));
    s.machine.rig.surroundings.air = Some(Air { drag, yaw, power: 2.0 });
    parameters([("drag_n_s2_m2", drag.into()), ("yaw_drag_n_m_s2", yaw.into())])
}

/// Tyres dragged sideways by turning.
pub fn scrub(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let most = s.torque(0.25 * s.strength);
    let arm = rng.random_range(0.6..1.0) * s.machine.rig.half_track;
    let grip = most / (4.0 * arm);
    let patch = Tyre { stiffness: 3.0 * grip / 0.25, grip, floor: 0.08 * s.speed() };
    s.machine.rig.scrub = Some(Scrub { arm, patch });
    parameters([("largest_torque_n_m", most.into()), ("arm_m", arm.into())])
}

/// A swivelling castor whose rolling costs force.
pub fn castor(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let rolling = s.force(0.12 * s.strength);
    let h = s.machine.rig.half_track;
    let (pivot, trail) = (-rng.random_range(0.9..1.5) * h, rng.random_range(0.18..0.45) * h);
    let mass = s.machine.rig.body.mass;
    s.machine.rig.castor = Some(Castor {
        pivot,
        trail,
        inertia: 0.01 * mass * trail * trail,
        rolling,
        swivel: 0.1 * rolling * trail,
        lateral: 1.5 * mass * GRAVITY * 0.25,
        floor: 0.05 * s.speed(),
    });
    parameters([("rolling_force_n", rolling.into()), ("pivot_m", pivot.into()), ("trail_m", trail.into())])
}

/// Inclined ground.
pub fn slope(s: &mut Subject, rng: &mut StdRng) -> Parameters {
    let pull = s.force(0.2 * s.strength) / s.machine.rig.body.mass;
    let downhill = rng.random_range(-0.5..0.5) * TAU;
    s.machine.rig.surroundings.slope = Some(Slope { pull, downhill, wave: f64::INFINITY });
    parameters([("pull_m_s2", pull.into()), ("downhill_rad", downhill.into())])
}
