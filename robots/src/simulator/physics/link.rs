//! The way of commands into the robot: they take their time, come in steps, and the smallest are ignored.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::{Flaw, NOT_NEGATIVE, first_flaw};

/// A link.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Link {
    /// Time until a command arrives \[s\].
    pub delay: f64,
    /// Steps in which v_ref is sent \[m/s\]; 0 for none.
    pub v_step: f64,
    /// Steps in which omega_ref is sent \[rad/s\]; 0 for none.
    pub omega_step: f64,
    /// v_ref up to this is taken for zero \[m/s\].
    pub v_dead_zone: f64,
    /// omega_ref up to this is taken for zero \[rad/s\].
    pub omega_dead_zone: f64,
}

impl Link {
    pub(super) fn flaw(&self) -> Option<Flaw> {
        first_flaw(&[
            ("delay", self.delay, (0.0..=10.0).contains(&self.delay), "between 0 and 10 (it is in seconds)"),
            ("v_step", self.v_step, self.v_step >= 0.0, NOT_NEGATIVE),
            ("omega_step", self.omega_step, self.omega_step >= 0.0, NOT_NEGATIVE),
            ("v_dead_zone", self.v_dead_zone, self.v_dead_zone >= 0.0, NOT_NEGATIVE),
            ("omega_dead_zone", self.omega_dead_zone, self.omega_dead_zone >= 0.0, NOT_NEGATIVE),
        ])
    }

    /// What arrives of a command.
    fn shaped(&self, [v, omega]: [f64; 2]) -> [f64; 2] {
        let shape = |value: f64, step: f64, dead: f64| {
            let value = if value.abs() <= dead { 0.0 } else { value };
            if step > 0.0 { (value / step).round() * step } else { value }
        };
        [shape(v, self.v_step, self.v_dead_zone), shape(omega, self.omega_step, self.omega_dead_zone)]
    }
}

/// Commands on their way, by the time of their arrival \[s\].
#[derive(Debug, Clone, Default)]
pub(in super::super) struct OnTheWay(VecDeque<(f64, [f64; 2])>);

impl OnTheWay {
    /// Sends a command at time `t` \[s\].
    pub(in super::super) fn send(&mut self, link: Option<&Link>, t: f64, command: [f64; 2]) {
        let (delay, shaped) = link.map_or((0.0, command), |link| (link.delay, link.shaped(command)));
        self.0.push_back((t + delay, shaped));
    }

    /// The next command that arrives before `end` \[s\], with its time.
    pub(in super::super) fn next(&mut self, end: f64) -> Option<(f64, [f64; 2])> {
        self.0.front().filter(|(arrival, _)| *arrival < end)?;
        self.0.pop_front()
    }

    pub(in super::super) fn clear(&mut self) {
        self.0.clear();
    }
}
