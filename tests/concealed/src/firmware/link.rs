//! The way of a command to the robot: latency, latency that varies, messages that never arrive.

use super::Command;

/// The message queue's behaviour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Link {
    /// Mean time from sending to acting \[s\].
    pub latency: f64,
    /// Variation of the latency of each message, as a share of the latency (uniform on both sides).
    pub variation: f64,
    /// Times during which nothing gets through: the last command stays in force.
    pub lost: Vec<(f64, f64)>,
    /// Time without a message after which the robot stops by itself \[s\].
    pub dead_man: Option<f64>,
}

const STANDSTILL: Command = Command { t: 0.0, v: 0.0, omega: 0.0 };

/// Messages in the order of their arrival.
#[derive(Clone, Debug)]
pub struct Inbox {
    arrivals: Vec<(f64, Command)>,
    next: usize,
    current: Command,
    heard: f64,
    dead_man: Option<f64>,
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
        Inbox { arrivals, next: 0, current: STANDSTILL, heard: f64::INFINITY, dead_man: link.dead_man }
    }

    /// The command in force at time `t`: standstill before the first, and when the dead-man has fired.
    pub fn latest(&mut self, t: f64) -> Command {
        while let Some(&(at, command)) = self.arrivals.get(self.next) {
            if at > t + 1e-9 {
                break;
            }
            self.current = command;
            self.heard = at;
            self.next += 1;
        }
        if self.dead_man.is_some_and(|longest| t - self.heard > longest) { STANDSTILL } else { self.current }
    }
}
