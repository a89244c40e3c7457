//! A watch over what a robot says: numbers that are none, clocks that stand, jump or go back, and data that do not change
//! although the robot is told to move.

use super::fault::DriveFault;
use crate::channel::Channel;

/// Path commanded while nothing measured changes, from which on the data are frozen: v_ref \[m\] and omega_ref \[rad\].
const FROZEN_PATH: [(&str, f64); 2] = [("v_ref", 0.05), ("omega_ref", 0.1)];
/// Channels that change with every motion.
const POSITIONS: [&str; 5] = ["x", "y", "phi", "pos_left", "pos_right"];
/// A robot without a position, or commanded otherwise, may measure constant values for long: it gets this many times longer.
const UNCERTAIN: f64 = 4.0;
/// A step of the clock above this many periods, and this many seconds, is a jump: rows may be lost, but not that many.
const JUMP: (f64, f64) = (10.0, 1.0);

/// Watches the rows of a drive.
#[derive(Debug, Clone)]
pub struct Guard {
    outputs: Vec<String>,
    period: f64,
    /// Time of frozen data that is let pass \[s\].
    patience: f64,
    /// Path from which on a command has moved the robot, by input; `None` for a command of another kind.
    paths: Vec<Option<f64>>,
    has_position: bool,
    start: f64,
    t: f64,
    /// The last measurement that differed from the one before it, and when it came.
    last: Vec<f64>,
    since: f64,
    /// Commanded since then, by input: ∫|c| dt, and how much the command changed.
    commanded: Vec<(f64, f64)>,
    held: Vec<f64>,
}

impl Guard {
    /// A watch that begins with the first measurement, taken at the robot's time `start` \[s\]. Data that stay the same for
    /// `patience` \[s\] although motion is commanded are frozen.
    ///
    /// # Errors
    /// [`DriveFault`] if the measurement or its time is no number.
    pub fn begin(
        inputs: &[Channel],
        outputs: &[Channel],
        period: f64,
        patience: f64,
        start: f64,
        measured: &[f64],
    ) -> Result<Self, DriveFault> {
        if !start.is_finite() {
            return Err(DriveFault::FrozenClock { before: 0.0, after: start });
        }
        let path = |c: &Channel| FROZEN_PATH.iter().find(|(name, _)| c.name == *name).map(|(_, path)| *path);
        let guard = Self {
            outputs: outputs.iter().map(|c| c.name.to_string()).collect(),
            period,
            patience,
            paths: inputs.iter().map(path).collect(),
            has_position: outputs.iter().any(|c| POSITIONS.contains(&c.name.as_ref())),
            start,
            t: 0.0,
            last: measured.to_vec(),
            since: 0.0,
            commanded: vec![(0.0, 0.0); inputs.len()],
            held: vec![0.0; inputs.len()],
        };
        guard.finite(measured)?;
        Ok(guard)
    }

    /// Takes the measurement after `command` was held, with the robot's time \[s\]; returns the time since the start \[s\].
    ///
    /// # Errors
    /// [`DriveFault`] saying what is wrong with it.
    pub fn check(&mut self, command: &[f64], time: f64, measured: &[f64]) -> Result<f64, DriveFault> {
        let (before, after) = (self.t, time - self.start);
        if !after.is_finite() || after <= before {
            return Err(DriveFault::FrozenClock { before, after });
        }
        if after - before > (JUMP.0 * self.period).max(JUMP.1) {
            return Err(DriveFault::ClockJump { before, after, period: self.period });
        }
        self.t = after;
        self.finite(measured)?;
        self.moved(command, after - before, measured)?;
        Ok(after)
    }

    /// Time since the start of the last measurement \[s\].
    pub fn t(&self) -> f64 {
        self.t
    }

    fn finite(&self, measured: &[f64]) -> Result<(), DriveFault> {
        match measured.iter().position(|m| !m.is_finite()) {
            Some(i) => Err(DriveFault::NotFinite { channel: self.outputs[i].clone(), value: measured[i], t: self.t }),
            None => Ok(()),
        }
    }

    fn moved(&mut self, command: &[f64], dt: f64, measured: &[f64]) -> Result<(), DriveFault> {
        let same = measured.iter().zip(&self.last).all(|(a, b)| a.to_bits() == b.to_bits());
        if !same {
            self.last.copy_from_slice(measured);
            self.since = self.t;
            self.commanded.fill((0.0, 0.0));
            self.held.copy_from_slice(command);
            return Ok(());
        }
        for ((sum, now), before) in self.commanded.iter_mut().zip(command).zip(&mut self.held) {
            *sum = (sum.0 + now.abs() * dt, sum.1 + (now - *before).abs());
            *before = *now;
        }
        let still = self.t - self.since;
        // A position changes with any motion; a speed only when the motion changes, so there the command must have changed.
        let far = |(path, (driven, changed)): (&Option<f64>, &(f64, f64))| match path {
            Some(path) if self.has_position => *driven >= *path && still >= self.patience,
            Some(path) => *changed >= *path && *driven >= *path && still >= UNCERTAIN * self.patience,
            None => *changed > 0.0 && *driven > 0.0 && still >= UNCERTAIN * self.patience,
        };
        match self.paths.iter().zip(&self.commanded).any(far) {
            true => Err(DriveFault::FrozenData { since: self.since, t: self.t }),
            false => Ok(()),
        }
    }
}
