//! How a model's outputs and the motion of the body depend on each other.

use wheelwright_core::channel::{OMEGA, V, VEL_LEFT, VEL_RIGHT};
use wheelwright_core::controller::ControlError;
use wheelwright_core::trajectory::Envelope;
use wheelwright_core::{Channel, RegressorModel};

/// A two-by-two matrix, row by row.
type Matrix = [[f64; 2]; 2];

/// Outputs = C (v, ω), for models that measure the body's velocities or those of its two sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    outputs: Matrix,
    body: Matrix,
}

impl Body {
    /// The body of a model's outputs.
    ///
    /// # Errors
    /// [`ControlError::Model`] for outputs that do not tell how the body moves, without an equation each, or without the track width
    /// they need.
    pub fn of(model: &dyn RegressorModel, envelope: &Envelope) -> Result<Self, ControlError> {
        let wrong = |reason: String| ControlError::Model { model: model.name().to_owned(), reason };
        let names: Vec<&str> = model.outputs().iter().map(|c| c.name.as_ref()).collect();
        let half_track = || envelope.track_width.map(|d| 0.5 * d).ok_or_else(|| wrong("the robot's track_width is not known".to_owned()));
        let row = |channel: &Channel| -> Result<[f64; 2], ControlError> {
            match channel.name.as_ref() {
                name if name == V.name => Ok([1.0, 0.0]),
                name if name == OMEGA.name => Ok([0.0, 1.0]),
                name if name == VEL_LEFT.name => Ok([1.0, -half_track()?]),
                name if name == VEL_RIGHT.name => Ok([1.0, half_track()?]),
                _ => Err(wrong(format!("its output `{}` is no velocity of the body or of a side", channel.name))),
            }
        };
        let [first, second] = model.outputs() else {
            return Err(wrong(format!("it has the outputs {}; two velocities are needed", names.join(", "))));
        };
        if model.equations() != 2 {
            return Err(wrong(format!("its number of equations is {}; each of the two velocities needs one", model.equations())));
        }
        let outputs = [row(first)?, row(second)?];
        let body = inverse(&outputs).ok_or_else(|| wrong(format!("its outputs {} are one and the same", names.join(", "))))?;
        Ok(Self { outputs, body })
    }

    /// Outputs of a body's velocities, or of its accelerations.
    pub fn to_outputs(&self, body: [f64; 2]) -> [f64; 2] {
        times(&self.outputs, body)
    }

    /// Body velocities of outputs.
    pub fn to_body(&self, outputs: &[f64]) -> [f64; 2] {
        times(&self.body, [outputs[0], outputs[1]])
    }
}

fn times(m: &Matrix, x: [f64; 2]) -> [f64; 2] {
    [m[0][0] * x[0] + m[0][1] * x[1], m[1][0] * x[0] + m[1][1] * x[1]]
}

fn inverse(m: &Matrix) -> Option<Matrix> {
    let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    (determinant != 0.0 && determinant.is_finite())
        .then(|| [[m[1][1] / determinant, -m[0][1] / determinant], [-m[1][0] / determinant, m[0][0] / determinant]])
}
