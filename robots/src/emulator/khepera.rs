//! A Khepera's serial server, with the traps of K-Team's own: it blanks the first character of an argument, loses
//! commands that are sent before the answer to the last, and is silent about arguments that are too long.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::{Live, RobotError};

use super::body::Body;
use super::server::{Place, State};
use super::{Clock, Protocol};
use crate::khepera::STEP;
use crate::khepera::dialect::{Dialect, Generation};
use crate::wire::{config, seconds_of_step};

/// A Khepera to emulate: `[emulator] type = "khepera"`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KheperaServer {
    /// Address to serve; port 0 takes a free one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub listen: Option<String>,
    /// Path of a link to a pseudo terminal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pty: Option<PathBuf>,
    /// Which robot.
    pub generation: Generation,
    /// Battery \[V\].
    pub battery: f64,
    /// Commands after which one stays without an answer, once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub silent_after: Option<u64>,
    /// How time passes.
    pub clock: Clock,
}

impl Default for KheperaServer {
    fn default() -> Self {
        Self { listen: None, pty: None, generation: Generation::Three, battery: 7.4, silent_after: None, clock: Clock::Real }
    }
}

impl KheperaServer {
    pub(super) fn place(&self) -> Result<Place, RobotError> {
        match (&self.listen, &self.pty) {
            (Some(address), None) => Ok(Place::Tcp(address.clone())),
            (None, Some(path)) => Ok(Place::Pty(path.clone())),
            _ => Err(config("listen", "give one of listen = \"host:port\" and pty = \"path of a link\"")),
        }
    }

    fn check(&self) -> Result<(), RobotError> {
        if (0.0..=100.0).contains(&self.battery) {
            return Ok(());
        }
        Err(config("battery", format!("must be between 0 and 100 (it is in volts), not {}", self.battery)))
    }
}

/// Longest argument that fits into the server's buffer.
const LONGEST_ARGUMENT: usize = 9;
/// Most arguments that the server looks at.
const MOST_ARGUMENTS: usize = 4;
/// A line longer than this is no command.
const LONGEST_LINE: usize = 256;

/// The robot's side of the protocol.
pub struct KheperaEmulator {
    server: KheperaServer,
    dialect: Dialect,
    body: Body,
    line: Vec<u8>,
    /// Set points of the wheels \[units\].
    speeds: [i32; 2],
    /// Pulses at which the counters stand for 0.
    origin: [i64; 2],
    commands: u64,
}

impl KheperaEmulator {
    /// A robot that stands.
    ///
    /// # Errors
    /// [`RobotError::Config`].
    pub fn new(server: &KheperaServer, robot: Live) -> Result<Self, RobotError> {
        server.check()?;
        let (dialect, body) = (server.generation.dialect(), Body::new(robot)?);
        Ok(Self { server: server.clone(), dialect, body, line: Vec::new(), speeds: [0; 2], origin: [0; 2], commands: 0 })
    }

    /// The answer to a line, without its ending; `None` for silence.
    fn answer(&mut self, line: &str) -> Result<Option<String>, RobotError> {
        if line.is_empty() {
            return Ok(None);
        }
        self.commands += 1;
        if self.server.silent_after.is_some_and(|after| self.commands == after + 1) {
            return Ok(None);
        }
        let mut words = line.split(',');
        let command = words.next().and_then(|w| w.chars().next());
        let arguments: Vec<&str> = words.take(MOST_ARGUMENTS).collect();
        if arguments.iter().any(|a| a.len() > LONGEST_ARGUMENT) {
            return Ok(None);
        }
        Ok(Some(match command {
            Some('B') => format!("b,{}", self.server.generation.version()),
            Some('D') => self.drive(&arguments),
            // The motors cannot be driven by voltage here, but they can be let go.
            Some('L') if self.pair(&arguments) == [0; 2] => {
                self.speeds = [0; 2];
                "l".to_owned()
            }
            Some('E') => pair("e", self.measured_speeds().map(i64::from)),
            Some('R') => pair("r", self.positions()),
            Some('I') => self.set_counters(&arguments),
            Some(letter @ ('H' | 'J' | 'M' | 'Z' | 'A')) => letter.to_ascii_lowercase().to_string(),
            // The Khepera IV has no configuration array, and its lights take nine values.
            Some(letter @ ('C' | 'K')) if self.dialect.prefixes => letter.to_ascii_lowercase().to_string(),
            Some('N') => format!("n{},0", ",0".repeat(11)),
            Some('O') => format!("o{},0", ",0".repeat(11)),
            Some('V') => {
                let centivolts = (100.0 * self.server.battery).round() as i64;
                format!("v,{},{:02}", centivolts / 100, centivolts % 100)
            }
            Some(STEP) if self.server.clock == Clock::Stepped => return self.step(&arguments),
            _ => "$".to_owned(),
        }))
    }

    fn drive(&mut self, arguments: &[&str]) -> String {
        self.speeds = self.pair(arguments).map(|s| s.clamp(-self.dialect.fastest, self.dialect.fastest));
        "d".to_owned()
    }

    /// `I` sets the counters; on the Khepera IV it has no arguments and sets them to zero.
    fn set_counters(&mut self, arguments: &[&str]) -> String {
        let now = self.counts();
        let wanted = self.pair(arguments);
        self.origin = [0, 1].map(|i| now[i] - i64::from(wanted[i]));
        "i".to_owned()
    }

    fn step(&mut self, arguments: &[&str]) -> Result<Option<String>, RobotError> {
        let Some(seconds) = arguments.first().and_then(|a| seconds_of_step(a)) else { return Ok(Some("$".to_owned())) };
        let periods = (seconds / self.body.period()).round();
        for _ in 0..periods as u64 {
            self.pass(&mut Vec::new())?;
        }
        Ok(Some(STEP.to_ascii_lowercase().to_string()))
    }

    /// The first two arguments. Where there are prefixes, the first character is blanked whatever it is.
    fn pair(&self, arguments: &[&str]) -> [i32; 2] {
        [0, 1].map(|i| {
            let argument = arguments.get(i).copied().unwrap_or_default();
            let digits = if self.dialect.prefixes { argument.get(1..).unwrap_or_default() } else { argument };
            leading_integer(digits)
        })
    }

    fn measured_speeds(&self) -> [i32; 2] {
        let [v, omega] = self.body.velocity();
        let lead = 0.5 * self.dialect.track * omega;
        [v - lead, v + lead].map(|speed| (speed * self.dialect.speed).round() as i32)
    }

    fn counts(&self) -> [i64; 2] {
        self.body.paths(self.dialect.track).map(|way| (way / self.dialect.pulse).floor() as i64)
    }

    fn positions(&self) -> [i64; 2] {
        let counts = self.counts();
        // Counters of 32 bits go round.
        [0, 1].map(|i| i64::from((counts[i] - self.origin[i]) as i32))
    }

    /// v and ω of the set points.
    fn command(&self) -> [f64; 2] {
        let [left, right] = self.speeds.map(|s| f64::from(s) / self.dialect.speed);
        [0.5 * (left + right), (right - left) / self.dialect.track]
    }
}

impl Protocol for KheperaEmulator {
    fn receive(&mut self, bytes: &[u8], answers: &mut Vec<u8>) -> Result<(), RobotError> {
        self.line.extend_from_slice(bytes);
        let Some(end) = self.line.iter().position(|b| *b == b'\n') else {
            if self.line.len() > LONGEST_LINE {
                self.line.clear();
            }
            return Ok(());
        };
        let line = String::from_utf8_lossy(&self.line[..end]).into_owned();
        // Before every answer the server throws away what else has come.
        self.line.clear();
        if let Some(answer) = self.answer(line.trim_end_matches('\r'))? {
            answers.extend_from_slice(answer.as_bytes());
            answers.extend_from_slice(b"\r\n");
        }
        Ok(())
    }

    fn pass(&mut self, _answers: &mut Vec<u8>) -> Result<(), RobotError> {
        self.body.advance(self.command())
    }

    fn period(&self) -> f64 {
        self.body.period()
    }

    fn state(&self) -> State {
        let ([v, omega], [v_ref, omega_ref]) = (self.body.velocity(), self.command());
        State { time: self.body.time(), open: true, enabled: true, v_ref, omega_ref, v, omega }
    }
}

/// `x,left,right`
fn pair(letter: &str, values: [i64; 2]) -> String {
    format!("{letter},{},{}", values[0], values[1])
}

/// The integer that a text begins with, as C's `atoi` reads it.
fn leading_integer(text: &str) -> i32 {
    let text = text.trim_start();
    let sign = usize::from(text.starts_with(['-', '+']));
    let end = text[sign..].find(|c: char| !c.is_ascii_digit()).map_or(text.len(), |end| sign + end);
    text[..end].parse().unwrap_or(0)
}
