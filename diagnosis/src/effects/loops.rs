//! The loops that hold the wheels' speeds, as the wheels and their motors feel them.

use wheelwright_core::effect::{Frame, Motion};

use super::force::LEAST;

/// What the loops withdraw from the wheels' drives for each unit of speed, by the model's linear part; drives in terms of the forward command.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loops {
    frame: Frame,
    /// How many times as much the same force counts in turning, as [`force::turning_ratio`](super::force::turning_ratio) says.
    ratio: f64,
    /// For the speed of the wheel itself.
    pub(super) own: [f64; 2],
    /// For that of the other wheel.
    pub(super) cross: [f64; 2],
}

impl Loops {
    /// Shares of what holds the robot back, driving straight on and turning.
    pub(super) fn of(frame: &Frame, motion: &Motion<'_>, ratio: Option<&f64>, [straight, turning]: [f64; 2]) -> Self {
        let (ratio, d) = (ratio.copied().unwrap_or(1.0), motion.drag);
        // What holds a wheel back where both go alike, and where they go against each other.
        let (alike, against) = match frame {
            Frame::Body { .. } => ([d[0]; 2], [d[3] / ratio; 2]),
            _ => ([d[0] + d[1], d[3] + d[2]], [d[0] - d[1], d[3] - d[2]]),
        };
        let (alike, against) = (alike.map(|d| 0.5 * straight * d), against.map(|d| 0.5 * turning * d));
        let (own, cross) = ([0, 1].map(|i| alike[i] + against[i]), [0, 1].map(|i| alike[i] - against[i]));
        Self { frame: *frame, ratio, own, cross }
    }

    /// Whether they hold the wheels back at all.
    pub(super) fn hold(&self) -> bool {
        self.own.iter().all(|own| *own > 0.0)
    }

    /// What a pair of inputs drives at each wheel.
    pub(super) fn at_wheels(&self, pair: &[f64]) -> [f64; 2] {
        self.frame.at_wheels(pair, self.ratio)
    }

    /// The pair of inputs of what drives at each wheel.
    pub(super) fn of_wheels(&self, drives: [f64; 2]) -> [f64; 2] {
        let mut pair = [0.0; 2];
        self.frame.add_at_wheels(drives, self.ratio, &mut pair);
        pair
    }

    /// The wheels' accelerations under these drives.
    pub(super) fn accelerations(&self, motion: &Motion<'_>, drives: [f64; 2]) -> [f64; 2] {
        let (i, [first, second]) = (motion.inertia, self.of_wheels(drives));
        let determinant = i[0] * i[3] - i[1] * i[2];
        self.frame.wheels(&[(i[3] * first - i[1] * second) / determinant, (i[0] * second - i[2] * first) / determinant])
    }

    /// A wheel's own acceleration under the drive of its loop for a unit of speed.
    pub(super) fn yields(&self, motion: &Motion<'_>, side: usize) -> f64 {
        let alone = [0, 1].map(|i| if i == side { self.own[side] } else { 0.0 });
        self.accelerations(motion, alone)[side]
    }

    /// What the model has to be given at each wheel, so that it moves as one does that gets these drives but is lighter at the wheels, by the
    /// drive that a unit of their acceleration would take.
    pub(super) fn lighter(&self, motion: &Motion<'_>, by: [f64; 2], drives: [f64; 2]) -> [f64; 2] {
        if by == [0.0; 2] {
            return drives;
        }
        // drives' = drives + by · accelerations of drives'.
        let (left, right) = (self.accelerations(motion, [1.0, 0.0]), self.accelerations(motion, [0.0, 1.0]));
        let (a, b, c, d) = (1.0 - by[0] * left[0], -by[0] * right[0], -by[1] * left[1], 1.0 - by[1] * right[1]);
        let determinant = (a * d - b * c).max(LEAST);
        [(d * drives[0] - b * drives[1]) / determinant, (a * drives[1] - c * drives[0]) / determinant]
    }

    /// What is withdrawn at each wheel.
    pub(super) fn withdrawn(&self, outputs: &[f64]) -> [f64; 2] {
        let speeds = self.frame.wheels(outputs);
        [0, 1].map(|i| self.own[i] * speeds[i] + self.cross[i] * speeds[1 - i])
    }
}
