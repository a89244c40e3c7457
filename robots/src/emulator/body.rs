//! The robot behind an emulator: any [`Robot`] that takes v and ω, with its wheels' paths as encoders would count them.

use wheelwright_core::channel;
use wheelwright_core::robot::{Live, RobotError};

use crate::wire::config;

/// A robot that stands at the origin when the emulator starts.
pub(super) struct Body {
    robot: Live,
    inputs: [usize; 2],
    /// Columns of v and ω.
    velocities: [usize; 2],
    /// Columns of x, y and φ, if it measures them.
    pose_columns: Option<[usize; 3]>,
    command: Vec<f64>,
    measured: Vec<f64>,
    /// x, y, φ.
    pose: [f64; 3],
    /// Way driven, backwards negative \[m\].
    path: f64,
    time: f64,
}

impl Body {
    pub(super) fn new(mut robot: Live) -> Result<Self, RobotError> {
        let inputs = [channel::V_REF, channel::OMEGA_REF].map(|c| robot.inputs().iter().position(|i| i.name == c.name));
        let column = |robot: &Live, c: &channel::Channel| robot.outputs().iter().position(|o| o.name == c.name);
        let velocities = [channel::V, channel::OMEGA].map(|c| column(&robot, &c));
        let pose = [channel::X, channel::Y, channel::PHI].map(|c| column(&robot, &c));
        let ([Some(v_ref), Some(omega_ref)], [Some(v), Some(omega)]) = (inputs, velocities) else {
            return Err(config("type", "the robot to emulate must take v_ref and omega_ref and measure v and omega"));
        };
        let pose_columns = if let [Some(x), Some(y), Some(phi)] = pose { Some([x, y, phi]) } else { None };
        let (command, mut measured) = (vec![0.0; robot.inputs().len()], vec![0.0; robot.outputs().len()]);
        robot.measure(&mut measured)?;
        let mut body = Self {
            robot,
            inputs: [v_ref, omega_ref],
            velocities: [v, omega],
            pose_columns,
            command,
            measured,
            pose: [0.0; 3],
            path: 0.0,
            time: 0.0,
        };
        body.pose = body.pose_columns.map_or([0.0; 3], |columns| columns.map(|c| body.measured[c]));
        Ok(body)
    }

    /// Length of one [`advance`](Self::advance) \[s\].
    pub(super) fn period(&self) -> f64 {
        self.robot.period()
    }

    /// Holds (v, ω) for one period.
    pub(super) fn advance(&mut self, command: [f64; 2]) -> Result<(), RobotError> {
        for (index, value) in self.inputs.into_iter().zip(command) {
            self.command[index] = value;
        }
        let before = self.velocity();
        self.robot.step(&self.command, &mut self.measured)?;
        let period = self.robot.period();
        self.time += period;
        let after = self.velocity();
        match self.pose_columns {
            Some(columns) => {
                let pose = columns.map(|c| self.measured[c]);
                let [dx, dy, turn] = [0, 1, 2].map(|i| pose[i] - self.pose[i]);
                let (sin, cos) = (self.pose[2] + 0.5 * turn).sin_cos();
                // The chord, and by how much the arc is longer.
                let half = 0.5 * turn;
                let arc = if half.abs() > 1e-6 { half / half.sin() } else { 1.0 };
                self.path += (dx * cos + dy * sin) * arc;
                self.pose = pose;
            }
            None => {
                let [way, turn] = [0, 1].map(|i| 0.5 * (before[i] + after[i]) * period);
                let (sin, cos) = (self.pose[2] + 0.5 * turn).sin_cos();
                self.pose = [self.pose[0] + way * cos, self.pose[1] + way * sin, self.pose[2] + turn];
                self.path += way;
            }
        }
        Ok(())
    }

    /// v \[m/s\] and ω \[rad/s\] as measured.
    pub(super) fn velocity(&self) -> [f64; 2] {
        self.velocities.map(|column| self.measured[column])
    }

    /// x, y \[m\] and φ \[rad\].
    pub(super) fn pose(&self) -> [f64; 3] {
        self.pose
    }

    /// Way of the left and the right wheel \[m\] for a track \[m\].
    pub(super) fn paths(&self, track: f64) -> [f64; 2] {
        let lead = 0.5 * track * self.pose[2];
        [self.path - lead, self.path + lead]
    }

    /// Time since the start \[s\].
    pub(super) fn time(&self) -> f64 {
        self.time
    }
}
