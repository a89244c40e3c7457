//! From a point's derivatives to the motion of a robot that follows it.

use std::f64::consts::{PI, TAU};

use wheelwright_core::Reference;

/// A coordinate with its first derivatives: value, ', '', ''', ''''.
pub(super) type Jet = [f64; 5];

/// An angle in [−π, π).
pub(crate) fn wrap(angle: f64) -> f64 {
    angle - TAU * ((angle + PI) / TAU).floor()
}

/// The motion along a point's path. The heading is that of the path, chosen within π of `near`, which makes it continuous
/// wherever `near` is.
///
/// v = |p'|, ω = N/v² with N = y''x' − x''y', α = (N' − ω Q')/Q with Q = v²                         (A.9)–(A.12)
pub(super) fn motion(x: &Jet, y: &Jet, near: f64) -> Reference {
    let speed2 = x[1] * x[1] + y[1] * y[1];
    let v = speed2.sqrt();
    let along = x[1] * x[2] + y[1] * y[2];
    let omega = (y[2] * x[1] - x[2] * y[1]) / speed2;
    let turning_dot = y[3] * x[1] - x[3] * y[1];
    Reference {
        x: x[0],
        y: y[0],
        phi: near + wrap(y[1].atan2(x[1]) - near),
        v,
        omega,
        v_dot: along / v,
        omega_dot: (turning_dot - 2.0 * omega * along) / speed2,
    }
}

/// β = α', the second derivative of ω, which a dither across the path needs.
pub(super) fn omega_ddot(x: &Jet, y: &Jet, motion: &Reference) -> f64 {
    let speed2 = motion.v * motion.v;
    let along = x[1] * x[2] + y[1] * y[2];
    let turning_ddot = y[4] * x[1] + y[3] * x[2] - x[4] * y[1] - x[3] * y[2];
    let speed2_ddot = 2.0 * (x[2] * x[2] + x[1] * x[3] + y[2] * y[2] + y[1] * y[3]);
    (turning_ddot - 4.0 * motion.omega_dot * along - motion.omega * speed2_ddot) / speed2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_wrapped_to_half_open_turns() {
        assert_eq!(wrap(PI), -PI);
        assert_eq!(wrap(-PI), -PI);
        assert!((wrap(7.0 * PI + 0.1) - (0.1 - PI)).abs() < 1e-14);
        assert_eq!(wrap(0.3), 0.3);
    }
}
