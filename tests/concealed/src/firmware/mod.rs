//! The robot's low-level computer: receives messages, shapes set-points, closes the loop, asks the motors for voltages.

pub mod control;
pub mod link;
pub mod setpoint;

use crate::plant::motor::Battery;
use crate::plant::{LEFT, RIGHT};
use control::{Control, Loops};
use link::{Inbox, Link};
use setpoint::{Shaper, Shaping};

/// One command as sent: time \[s\], forward speed \[m/s\], turning speed \[rad/s\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// When it is sent \[s\].
    pub t: f64,
    /// Forward speed \[m/s\].
    pub v: f64,
    /// Turning speed \[rad/s\].
    pub omega: f64,
}

/// Everything that is configured in the firmware.
#[derive(Clone, Debug, PartialEq)]
pub struct Firmware {
    /// How messages get there.
    pub link: Link,
    /// What is done to the set-points.
    pub shaping: Shaping,
    /// The control law.
    pub control: Control,
    /// Wheel radius the firmware believes \[m\].
    pub radius: f64,
    /// Half track the firmware believes \[m\].
    pub half_track: f64,
    /// Control period \[s\].
    pub period: f64,
}

/// The firmware at work.
#[derive(Clone, Debug)]
pub struct Running<'a> {
    firmware: &'a Firmware,
    inbox: Inbox,
    shaper: Shaper,
    loops: Loops,
    due: f64,
    volts: [f64; 2],
}

impl<'a> Running<'a> {
    /// Starts at time `start` with the messages of a drive.
    pub fn start(firmware: &'a Firmware, inbox: Inbox, start: f64) -> Running<'a> {
        Running { firmware, inbox, shaper: Shaper::default(), loops: Loops::default(), due: start, volts: [0.0; 2] }
    }

    /// Voltages now, for wheel speeds as its encoders see them; the duty it asks is worth as much as the battery gives.
    pub fn volts(&mut self, t: f64, speed: [f64; 2], battery: &Battery, drawn: f64) -> [f64; 2] {
        if t + 1e-9 >= self.due {
            self.due += self.firmware.period;
            let asked = self.inbox.latest(t);
            let firmware = self.firmware;
            let wanted = self.shaper.shape(&firmware.shaping, asked, firmware.half_track, firmware.period);
            self.volts = self.loops.act(firmware, wanted, speed);
        }
        let worth = battery.factor(t, drawn);
        [self.volts[LEFT] * worth, self.volts[RIGHT] * worth]
    }
}
