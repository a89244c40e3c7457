//! Counts what a robot could not do as it was told, so that a drive can say so at its end.

/// A command is rounded noticeably if it is changed by more than this share of its motion.
const NOTICEABLE: f64 = 0.02;

/// A command is cut if it is changed by more than this \[m/s, rad/s\]; less is arithmetic.
const CUT: f64 = 1e-9;

/// Commands of v and ω, and what became of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally {
    commands: u64,
    clamped: u64,
    late: u64,
    rounding: [Rounding; 2],
}

/// Sums over the commands of one channel.
#[derive(Debug, Clone, Copy, Default)]
struct Rounding {
    error: f64,
    sum: f64,
    square: f64,
}

impl Tally {
    /// A command as wished, after the limits, and as the wire carries it.
    pub(crate) fn count(&mut self, wanted: [f64; 2], limited: [f64; 2], executed: [f64; 2]) {
        self.commands += 1;
        self.clamped += u64::from((0..2).any(|i| (limited[i] - wanted[i]).abs() > CUT));
        for (rounding, (limited, executed)) in self.rounding.iter_mut().zip(limited.into_iter().zip(executed)) {
            rounding.error += (executed - limited).powi(2);
            rounding.sum += limited;
            rounding.square += limited.powi(2);
        }
    }

    /// A period passed before its command was sent.
    pub(crate) fn late(&mut self) {
        self.late += 1;
    }

    /// Commands so far.
    pub(crate) fn commands(&self) -> u64 {
        self.commands
    }

    pub(crate) fn warnings(&self) -> Vec<String> {
        let count = self.commands;
        let mut warnings = Vec::new();
        if self.clamped > 0 {
            warnings
                .push(format!("{} of {count} commands were cut to the robot's limits; the recording holds what was sent", self.clamped));
        }
        for (rounding, name) in self.rounding.iter().zip(["v_ref", "omega_ref"]) {
            let share = rounding.share(count as f64);
            if share > NOTICEABLE {
                let percent = 100.0 * share;
                warnings.push(format!(
                    "rounding to the wire's units changed {name} by {percent:.1} % of its motion; the recording holds what was sent"
                ));
            }
        }
        if self.late > 0 {
            let late = self.late;
            warnings.push(format!("{late} of {count} commands were late by a period or more: this program or the machine was too slow"));
        }
        warnings
    }
}

impl Rounding {
    /// Standard deviation of the rounding over that of the command.
    fn share(&self, count: f64) -> f64 {
        let motion = (self.square / count - (self.sum / count).powi(2)).max(0.0);
        if motion > 0.0 { (self.error / count / motion).sqrt() } else { 0.0 }
    }
}
