//! What the robot does with a command: limits, rounding to the wire's units, the firmware's ramp. Keeps count, so that a
//! drive can be told what it asked for in vain.

use super::command::{self, number};
use super::config::{CommandKind, FASTEST, PioneerConfig};
use super::conversion::Conversion;
use super::firmware::Firmware;
use crate::wire::{Tally, clamp};

/// The way of commands to the robot.
#[derive(Debug)]
pub(super) struct Execution {
    kind: CommandKind,
    conversion: Conversion,
    /// Highest magnitudes of v and omega.
    limits: [f64; 2],
    /// Ramps that the configuration asks for \[m/s², rad/s²\].
    wanted_ramps: [Option<f64>; 2],
    /// Ramps of the firmware, as far as known.
    ramps: [Option<f64>; 2],
    last: [f64; 2],
    ramped: [u64; 2],
    tally: Tally,
}

impl Execution {
    pub(super) fn new(config: &PioneerConfig, conversion: Conversion, firmware: &Firmware) -> Self {
        let stated = [1e-3 * f64::from(firmware.translation_limit), f64::from(firmware.rotation_limit).to_radians()];
        let asked = [config.limits.v, config.limits.omega];
        let mut limits = FASTEST;
        for ((limit, stated), asked) in limits.iter_mut().zip(stated).zip(asked) {
            *limit = limit.min(asked.unwrap_or(f64::INFINITY)).min(if stated > 0.0 { stated } else { f64::INFINITY });
        }
        let slowest = |[up, down]: [u16; 2]| Some(f64::from(up.min(down))).filter(|ramp| *ramp > 0.0);
        let firmware_ramps = [slowest(firmware.translation_ramp).map(|a| 1e-3 * a), slowest(firmware.rotation_ramp).map(f64::to_radians)];
        let wanted_ramps = [config.limits.v_dot, config.limits.omega_dot];
        Self {
            kind: config.command,
            conversion,
            limits,
            wanted_ramps,
            ramps: [wanted_ramps[0].or(firmware_ramps[0]), wanted_ramps[1].or(firmware_ramps[1])],
            last: [0.0; 2],
            ramped: [0; 2],
            tally: Tally::default(),
        }
    }

    /// Packets that set the firmware's limits, and its ramps if the configuration sets them.
    pub(super) fn settings(&self) -> Vec<u8> {
        let [v, omega] = self.limits;
        let mut packets = vec![command::integer(number::SETV, millimetres(v)), command::integer(number::SETRV, degrees(omega))];
        let both = |kind, value: i32| [command::integer(kind, value), command::integer(kind, -value)];
        packets.extend(self.wanted_ramps[0].into_iter().flat_map(|ramp| both(number::SETA, millimetres(ramp).max(1))));
        packets.extend(self.wanted_ramps[1].into_iter().flat_map(|ramp| both(number::SETRA, degrees(ramp).max(1))));
        packets.concat()
    }

    /// Packets that make the robot stand, whatever it did.
    pub(super) fn standing(&self) -> Vec<u8> {
        let mut packets = vec![command::integer(number::VEL, 0), command::integer(number::RVEL, 0)];
        if self.kind == CommandKind::Vel2 {
            packets.push(command::vel2(0, 0));
        }
        packets.concat()
    }

    /// What the robot will hold when asked for this.
    pub(super) fn executed(&self, wanted: [f64; 2]) -> [f64; 2] {
        let limited = self.limited(wanted);
        match self.kind {
            CommandKind::Vel => [1e-3 * f64::from(millimetres(limited[0])), f64::from(degrees(limited[1])).to_radians()],
            CommandKind::Vel2 => {
                let [left, right] = self.steps(limited).map(|steps| f64::from(steps) * self.conversion.vel2);
                self.conversion.to_body(left, right)
            }
        }
    }

    /// The packets of a command that is to be held for `period`, for one write: half a command would be another.
    pub(super) fn command(&mut self, wanted: [f64; 2], period: f64) -> Vec<u8> {
        self.count(wanted, period);
        let limited = self.limited(wanted);
        match self.kind {
            CommandKind::Vel => {
                [command::integer(number::VEL, millimetres(limited[0])), command::integer(number::RVEL, degrees(limited[1]))].concat()
            }
            CommandKind::Vel2 => {
                let [left, right] = self.steps(limited);
                command::vel2(left, right)
            }
        }
    }

    /// A cycle passed before its command was sent.
    pub(super) fn late(&mut self) {
        self.tally.late();
    }

    fn limited(&self, [v, omega]: [f64; 2]) -> [f64; 2] {
        [clamp(v, Some(self.limits[0])), clamp(omega, Some(self.limits[1]))]
    }

    fn steps(&self, limited: [f64; 2]) -> [i8; 2] {
        self.conversion.to_wheels(limited).map(|speed| (speed / self.conversion.vel2).round().clamp(-127.0, 127.0) as i8)
    }

    fn count(&mut self, wanted: [f64; 2], period: f64) {
        let executed = self.executed(wanted);
        self.tally.count(wanted, self.limited(wanted), executed);
        for (i, ramped) in self.ramped.iter_mut().enumerate() {
            let change = (executed[i] - self.last[i]).abs();
            *ramped += u64::from(self.ramps[i].is_some_and(|ramp| change > ramp * period));
        }
        self.last = executed;
    }

    /// What the drive asked for in vain.
    pub(super) fn warnings(&self) -> Vec<String> {
        let count = self.tally.commands();
        let mut warnings = self.tally.warnings();
        let names = [("v_ref", "m/s²", "v_dot"), ("omega_ref", "rad/s²", "omega_dot")];
        for ((ramped, ramp), (name, unit, key)) in self.ramped.iter().zip(self.ramps).zip(names) {
            if let (1.., Some(ramp)) = (ramped, ramp) {
                warnings.push(format!(
                    "{ramped} of {count} steps of {name} took longer than a control period on the firmware's ramp of {ramp:.2} {unit}: \
                     while it acts the robot is not the model; raise limits.{key} or drive more gently"
                ));
            }
        }
        warnings
    }
}

/// Whole mm/s.
fn millimetres(speed: f64) -> i32 {
    (1e3 * speed).round() as i32
}

/// Whole °/s.
fn degrees(speed: f64) -> i32 {
    speed.to_degrees().round() as i32
}
