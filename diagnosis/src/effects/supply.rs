//! A supply with a resistance of its own, which gives way to the currents that it drives.

use wheelwright_core::effect::{EffectParameter, Frame, Motion, Scene};

use super::force;

/// The least that is left of a supply under any load.
const LEAST_LEFT: f64 = 0.1;
/// Steps to the voltage that is left: each of two currents turns round once.
const STEPS: usize = 3;

/// What is to be known of the drive: of its loops where they are what weakens, else the share of a speed's command that back-EMF takes, where commands
/// are speeds: most of it, and friction the rest.
pub(super) fn known(servo: bool, scene: &Scene) -> Vec<EffectParameter> {
    match (servo, scene.frame) {
        (true, _) => force::loops(scene).collect(),
        (false, Frame::Body { .. }) => vec![EffectParameter::new("back_emf", "1", (0.0, 1.5), 0.05).usually(1.0, 0.2)],
        (false, _) => Vec::new(),
    }
}

/// The motors' currents at any voltage, in terms of the command: what they are asked for, and what would drive them at full voltage.
#[derive(Debug, Clone, Copy)]
pub(super) struct Currents {
    asked: [f64; 2],
    full: [f64; 2],
}

impl Currents {
    /// Under a drive; `known` are the values of [`known`].
    pub(super) fn of(servo: bool, known: &[f64], frame: &Frame, motion: &Motion<'_>, drive: &[f64]) -> Self {
        match (servo, known) {
            (true, &[feedback, ratio]) => Self { asked: force::asked(frame, motion, feedback, ratio), full: frame.at_wheels(drive, ratio) },
            (false, &[back_emf]) => Self { asked: frame.wheels(motion.u), full: force::asked(frame, motion, back_emf, 1.0) },
            _ => Self { asked: frame.wheels(motion.u), full: frame.wheels(drive) },
        }
    }

    /// The current of each wheel's motor where a share of the voltage is left.
    fn at(&self, left: f64) -> [f64; 2] {
        [0, 1].map(|wheel| self.full[wheel] - (1.0 - left) * self.asked[wheel])
    }

    /// What both draw where a share of the voltage is left.
    pub(super) fn drawn(&self, left: f64) -> f64 {
        self.at(left).iter().map(|current| current.abs()).sum()
    }

    /// The share of a voltage that is left of `open`, that of the open circuit, where they flow over a resistance.
    pub(super) fn leave(&self, open: f64, resistance: f64) -> f64 {
        // Newton's steps: between the two voltages at which a current turns round all is linear.
        let left = (0..STEPS).fold(open, |left, _| {
            let currents = self.at(left);
            let eased: f64 = self.asked.iter().zip(currents).map(|(asked, current)| asked * current.signum()).sum();
            let slope = (1.0 + resistance * eased).max(LEAST_LEFT);
            left + (open - left - resistance * self.drawn(left)) / slope
        });
        left.max(LEAST_LEFT)
    }
}
