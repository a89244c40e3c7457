//! How a model's channels are motion of a body and of two wheels.

use crate::channel::{OMEGA, OMEGA_REF, U_LEFT, U_RIGHT, V, V_REF, VEL_LEFT, VEL_RIGHT};
use crate::model::RegressorModel;

/// The channels of a model seen as a robot with two sides: ground speeds of the wheels s = v ± h ω with h half the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Forward and angular velocity, commanded (`v_ref`, `omega_ref`) and measured (`v`, `omega`).
    Body {
        /// Half the track width \[m\].
        half_track: f64,
    },
    /// Two sides, commanded (`u_left`, `u_right`) and measured (`vel_left`, `vel_right`).
    Sides {
        /// Half the track width \[m\].
        half_track: f64,
    },
    /// Channels of which nothing is known but that each has a command; wheels and axes are not to be had.
    Channels,
}

impl Frame {
    /// The frame of a model's channels.
    pub fn of(model: &dyn RegressorModel, track_width: f64) -> Self {
        let half_track = 0.5 * track_width;
        let named = |inputs: [&str; 2], outputs: [&str; 2]| {
            model.inputs().iter().map(|c| c.name.as_ref()).eq(inputs) && model.outputs().iter().map(|c| c.name.as_ref()).eq(outputs)
        };
        if named([&V_REF.name, &OMEGA_REF.name], [&V.name, &OMEGA.name]) {
            Self::Body { half_track }
        } else if named([&U_LEFT.name, &U_RIGHT.name], [&VEL_LEFT.name, &VEL_RIGHT.name]) {
            Self::Sides { half_track }
        } else {
            Self::Channels
        }
    }

    /// True where wheels and axes are known.
    pub fn has_wheels(&self) -> bool {
        *self != Self::Channels
    }

    /// Half the track width \[m\]; not a number where there are no wheels.
    #[inline]
    pub fn half_track(&self) -> f64 {
        match *self {
            Self::Body { half_track } | Self::Sides { half_track } => half_track,
            Self::Channels => f64::NAN,
        }
    }

    /// Left and right of a pair of inputs or outputs. For the body frame the ground speeds of the wheels.
    #[inline]
    pub fn wheels(&self, pair: &[f64]) -> [f64; 2] {
        match *self {
            Self::Body { half_track: h } => [pair[0] - h * pair[1], pair[0] + h * pair[1]],
            _ => [pair[0], pair[1]],
        }
    }

    /// Forward and angular part of a pair of inputs or outputs.
    #[inline]
    pub fn body(&self, pair: &[f64]) -> [f64; 2] {
        match *self {
            Self::Sides { half_track: h } => [0.5 * (pair[0] + pair[1]), (pair[1] - pair[0]) / (2.0 * h)],
            _ => [pair[0], pair[1]],
        }
    }

    /// The pair of inputs or outputs of a left and a right value; the inverse of [`wheels`](Self::wheels).
    #[inline]
    pub fn from_wheels(&self, [left, right]: [f64; 2]) -> [f64; 2] {
        match *self {
            Self::Body { half_track: h } => [0.5 * (left + right), (right - left) / (2.0 * h)],
            _ => [left, right],
        }
    }

    /// The pair of inputs or outputs of a forward and an angular value; the inverse of [`body`](Self::body).
    #[inline]
    pub fn from_body(&self, [forward, turn]: [f64; 2]) -> [f64; 2] {
        match *self {
            Self::Sides { half_track: h } => [forward - h * turn, forward + h * turn],
            _ => [forward, turn],
        }
    }

    /// Adds loads at the wheels. In the body frame the two axes have control loops of their own, so a force counts
    /// differently on each: `rho` is the ratio of the force-to-command gains of forward and angular motion, 1 where the
    /// loops are closed on the wheels.
    #[inline]
    pub fn add_at_wheels(&self, [left, right]: [f64; 2], rho: f64, load: &mut [f64]) {
        let mut pair = self.from_wheels([left, right]);
        if matches!(self, Self::Body { .. }) {
            pair[1] *= rho;
        }
        load[0] += pair[0];
        load[1] += pair[1];
    }

    /// The loads at the wheels of a pair of loads; the inverse of [`add_at_wheels`](Self::add_at_wheels).
    pub fn at_wheels(&self, pair: &[f64], rho: f64) -> [f64; 2] {
        match *self {
            Self::Body { half_track: h } => {
                let (forward, turn) = (pair[0], h * pair[1] / rho);
                [forward - turn, forward + turn]
            }
            _ => [pair[0], pair[1]],
        }
    }

    /// Adds loads on forward and angular motion.
    #[inline]
    pub fn add_at_body(&self, axes: [f64; 2], load: &mut [f64]) {
        let pair = self.from_body(axes);
        load[0] += pair[0];
        load[1] += pair[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheels_and_body_are_two_views_of_one_motion() {
        for frame in [Frame::Body { half_track: 0.17 }, Frame::Sides { half_track: 0.17 }] {
            let pair = [0.4, -0.9];
            let back = frame.from_wheels(frame.wheels(&pair));
            let again = frame.from_body(frame.body(&pair));
            for (a, b) in pair.iter().zip(back.iter().chain(&again)) {
                assert!((a - b).abs() < 1e-15 || (pair[1] - b).abs() < 1e-15);
            }
            let ([left, right], [v, omega]) = (frame.wheels(&pair), frame.body(&pair));
            assert!((left - (v - 0.17 * omega)).abs() < 1e-15 && (right - (v + 0.17 * omega)).abs() < 1e-15);
            let mut loads = [0.0; 2];
            frame.add_at_wheels(frame.at_wheels(&pair, 1.7), 1.7, &mut loads);
            assert!(loads.iter().zip(pair).all(|(a, b)| (a - b).abs() < 1e-15));
        }
    }
}
