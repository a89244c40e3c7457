//! What a robot really did: a fine record of its motion, read between its points by straight lines.

use crate::firmware::link::Inbox;
use crate::firmware::{Command, Firmware, Running};
use crate::plant::{LEFT, RIGHT, Rig, State};

/// One moment of a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Forward and turning speed of the body \[m/s\], \[rad/s\].
    pub twist: [f64; 2],
    /// Place and heading.
    pub pose: (f64, f64, f64),
    /// Wheel speeds \[rad/s\].
    pub wheel: [f64; 2],
    /// Wheel angles \[rad\].
    pub angle: [f64; 2],
}

/// A fine record of a drive.
#[derive(Clone, Debug)]
pub struct Trace {
    start: f64,
    every: f64,
    moments: Vec<Moment>,
}

/// Spacing of a trace's moments \[s\].
const SPACING: f64 = 2e-3;

impl Trace {
    /// Drives a rig from rest at `heading` through `commands`, until `end`.
    pub fn drive(rig: &Rig, firmware: &Firmware, commands: &[Command], end: f64, heading: f64, luck: impl FnMut() -> f64) -> Trace {
        let start = commands.first().map_or(0.0, |c| c.t);
        let substeps = (SPACING / rig.longest_step()).round().max(1.0) as usize;
        let step = SPACING / substeps as f64;
        let mut firmware_at_work = Running::start(firmware, Inbox::new(&firmware.link, commands, luck), start);
        let mut state = State::at_rest(start, heading);
        let count = ((end - start) / SPACING).ceil().max(0.0) as usize + 1;
        let mut moments = Vec::with_capacity(count + 1);
        moments.push(moment(&state));
        for k in 0..count {
            for n in 0..substeps {
                state.t = start + (k * substeps + n) as f64 * step;
                let drawn = state.current[LEFT].abs() + state.current[RIGHT].abs();
                let seen = if rig.gear.is_some() { state.rotor } else { state.wheel };
                let volts = firmware_at_work.volts(state.t, seen, &rig.battery, drawn);
                state = rig.step(&state, volts, step);
            }
            moments.push(moment(&state));
        }
        Trace { start, every: SPACING, moments }
    }

    /// The moment at time `t`; before the start and after the end, the first and the last.
    pub fn at(&self, t: f64) -> Moment {
        let place = ((t - self.start) / self.every).max(0.0);
        let k = (place as usize).min(self.moments.len().saturating_sub(2));
        let part = (place - k as f64).min(1.0);
        let (a, b) = (&self.moments[k], &self.moments[(k + 1).min(self.moments.len() - 1)]);
        let mix = |a: f64, b: f64| a + part * (b - a);
        let pair = |a: [f64; 2], b: [f64; 2]| [mix(a[0], b[0]), mix(a[1], b[1])];
        Moment {
            twist: pair(a.twist, b.twist),
            pose: (mix(a.pose.0, b.pose.0), mix(a.pose.1, b.pose.1), mix(a.pose.2, b.pose.2)),
            wheel: pair(a.wheel, b.wheel),
            angle: pair(a.angle, b.angle),
        }
    }
}

fn moment(s: &State) -> Moment {
    Moment { twist: s.twist, pose: s.pose, wheel: s.wheel, angle: s.angle }
}
