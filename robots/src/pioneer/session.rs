//! The connection to the robot: handshake, recovery of a session that was left open, packets in and out.

use std::time::{Duration, Instant};

use wheelwright_core::robot::RobotError;

use super::command::{self, number};
use super::firmware::Firmware;
use super::packet::{Decoder, Packet};
use super::sip::Sip;
use crate::wire::{Clock, Link};

/// How long an answer to SYNC and CONFIG is waited for. A simulator answers in its own cycle of 100 ms.
const ANSWER: Duration = Duration::from_millis(600);
/// Tries of the whole handshake.
const TRIES: u32 = 6;

/// Who answers, as it says after SYNC2.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Identity {
    pub(super) name: String,
    pub(super) class: String,
    pub(super) subclass: String,
}

/// An open line to the robot.
#[derive(Debug)]
pub(super) struct Session {
    link: Link,
    decoder: Decoder,
    clock: Clock,
    /// Damage of the stream that has been accounted for.
    damage: u64,
    started: Instant,
}

/// What came from the robot.
#[derive(Debug)]
pub(super) struct Received {
    pub(super) packet: Packet,
    /// Time since the session began \[s\].
    pub(super) arrival: f64,
    /// Bytes were lost since the packet before.
    pub(super) damaged: bool,
}

impl Session {
    /// A line that nobody has spoken on yet.
    pub(super) fn new(link: Link, clock: Clock) -> Self {
        Self { link, decoder: Decoder::default(), clock, damage: 0, started: Instant::now() }
    }

    /// SYNC0, SYNC1, SYNC2. A session that was left open is closed first.
    pub(super) fn synchronise(&mut self) -> Result<Identity, RobotError> {
        let mut stage = number::SYNC0;
        let mut misses = 0;
        while misses < TRIES {
            self.send(&command::plain(stage))?;
            match self.answer_to_sync(stage)? {
                Answer::Echo if stage < number::SYNC2 => stage += 1,
                Answer::Echo | Answer::Silence => (stage, misses) = (number::SYNC0, misses + 1),
                Answer::Identity(identity) => return Ok(identity),
                Answer::StillOpen => {
                    misses += 1;
                    stage = number::SYNC0;
                    self.close_old_session()?;
                }
            }
        }
        let what = "the answer to SYNC0, SYNC1, SYNC2; is it a Pioneer, and is the speed of the line right?".to_owned();
        Err(RobotError::Timeout { limit_s: (TRIES * ANSWER).as_secs_f64(), what })
    }

    fn answer_to_sync(&mut self, stage: u8) -> Result<Answer, RobotError> {
        let end = Instant::now() + ANSWER;
        while let Some(received) = self.receive(end)? {
            let packet = received.packet;
            if Sip::decode(&packet).is_some() {
                return Ok(Answer::StillOpen);
            }
            match (stage, packet.kind) {
                (number::SYNC2, number::SYNC2) if !packet.data.is_empty() => return Ok(Answer::Identity(identity(&packet))),
                // A late echo of an earlier stage is no answer to this one.
                (stage, kind) if stage == kind => return Ok(Answer::Echo),
                _ => {}
            }
        }
        Ok(Answer::Silence)
    }

    /// Ends a session that another program left open; the robot is told to stand first.
    fn close_old_session(&mut self) -> Result<(), RobotError> {
        for packet in [command::integer(number::VEL, 0), command::integer(number::RVEL, 0), command::plain(number::CLOSE)] {
            self.send(&packet)?;
        }
        let end = Instant::now() + ANSWER / 2;
        while self.receive(end)?.is_some() {}
        self.decoder.clear();
        Ok(())
    }

    /// Asks for the firmware's settings; `None` if it has none to give.
    pub(super) fn firmware(&mut self) -> Result<Option<Firmware>, RobotError> {
        self.send(&command::integer(number::CONFIG, 1))?;
        let end = Instant::now() + 2 * ANSWER;
        while let Some(received) = self.receive(end)? {
            if let Some(firmware) = Firmware::decode(&received.packet) {
                return Ok(Some(firmware));
            }
        }
        Ok(None)
    }

    pub(super) fn send(&mut self, packet: &[u8]) -> Result<(), RobotError> {
        self.link.send(packet)
    }

    /// Sees to it that the last packets leave.
    pub(super) fn finish(&mut self) {
        self.link.finish();
    }

    /// Lets a cycle pass where time only passes when asked to.
    pub(super) fn let_pass(&mut self) -> Result<(), RobotError> {
        match self.clock {
            Clock::Real => Ok(()),
            Clock::Stepped => self.send(&command::plain(number::STEP)),
        }
    }

    /// The next packet that arrives before `end`.
    pub(super) fn receive(&mut self, end: Instant) -> Result<Option<Received>, RobotError> {
        let mut bytes = Vec::new();
        loop {
            if let Some(packet) = self.decoder.next_packet() {
                let damage = self.decoder.damage();
                let damaged = damage != std::mem::replace(&mut self.damage, damage);
                return Ok(Some(Received { packet, arrival: self.started.elapsed().as_secs_f64(), damaged }));
            }
            let wait = end.saturating_duration_since(Instant::now());
            bytes.clear();
            if self.link.receive(&mut bytes, wait)? == 0 && Instant::now() >= end {
                return Ok(None);
            }
            self.decoder.push(&bytes);
        }
    }
}

enum Answer {
    Echo,
    Identity(Identity),
    StillOpen,
    Silence,
}

fn identity(packet: &Packet) -> Identity {
    let mut texts = packet.data.split(|b| *b == 0).map(|t| String::from_utf8_lossy(t).into_owned());
    let mut next = || texts.next().unwrap_or_default();
    Identity { name: next(), class: next(), subclass: next() }
}
