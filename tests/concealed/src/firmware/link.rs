//! The way of a command to the robot: latency, latency that varies, messages that never arrive.

use super::Command;

/// The message queue's behaviour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Link {
    /// Mean time from sending to acting [s].
    pub latency: f64,
    /// Variation of the latency of each message, as a share of the latency (uniform on both sides).
    pub variation: f64,
    /// Times during which nothing gets through: the last command stays in force.
    pub lost: Vec<(f64, f64)>,
}

/// Messages in the order of their arrival.
#[derive(Clone, Debug)]
pub struct Inbox {
    arrivals: Vec<(f64, Command)>,
    next: usize,
    current: Command,
}

impl Inbox {
    /// Sends `commands` over `link`; `luck` gives a number in [0, 1) for each message.
    pub fn new(link: &Link, commands: &[Command], mut luck: impl FnMut() -> f64) -> Inbox {
        let mut arrivals: Vec<(f64, Command)> = Vec::with_capacity(commands.len());
        let mut latest = f64::NEG_INFINITY;
        for c in commands {
            let late = link.latency * (1.0 + link.variation * (2.0 * luck() - 1.0));
            if link.lost.iter().any(|&(from, to)| c.t >= from && c.t < to) {
                continue;
            }
            // One connection keeps the order: a message waits behind a slower one.
            latest = latest.max(c.t + late);
            arrivals.push((latest, *c));
        }
        Inbox { arrivals, next: 0, current: Command { t: 0.0, v: 0.0, omega: 0.0 } }
    }

    /// The command in force at time `t`: standstill before the first.
    pub fn latest(&mut self, t: f64) -> Command {
        while let Some(&(at, command)) = self.arrivals.get(self.next) {
            if at > t + 1e-9 {
                break;
            }
            self.current = command;
            self.next += 1;
        }
        self.current
    }
}
