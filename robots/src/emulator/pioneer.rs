//! A Pioneer's microcontroller: synchronisation, commands, the ramp of the set point, the watchdog, information packets.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::{Live, RobotError};

use super::body::Body;
use super::server::{Place, State};
use super::{Clock, Protocol};
use crate::pioneer::command::{Argument, number};
use crate::pioneer::conversion::Conversion;
use crate::pioneer::firmware::Firmware;
use crate::pioneer::packet::{Decoder, Packet, encode};
use crate::pioneer::sip::{ENCODER, Sip, Tail};
use crate::wire::{check_time, config};

/// A Pioneer to emulate: `[emulator] type = "pioneer"`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PioneerServer {
    /// Address to serve; port 0 takes a free one.
    pub listen: String,
    /// Name, class and subclass in the answer to SYNC2. The subclass picks the units.
    pub name: String,
    /// See `name`.
    pub class: String,
    /// See `name`.
    pub subclass: String,
    /// Time between two information packets \[s\].
    pub cycle: f64,
    /// Silence of the client after which the robot stands \[s\]; 0 for none.
    pub watchdog: f64,
    /// Sonar readings in a packet, until the client switches them off.
    pub sonars: u8,
    /// Acceleration of the set point's ramp at the start \[mm/s²\].
    pub acceleration: u16,
    /// The same for turning \[°/s²\].
    pub turn_acceleration: u16,
    /// Highest speeds that the configuration packet states \[mm/s, °/s\].
    pub limits: [u16; 2],
    /// Encoder ticks a millimetre; 0 if there are no encoder packets.
    pub ticks_per_mm: u16,
    /// Battery \[V\].
    pub battery: f64,
    /// Things that go wrong.
    pub fault: Vec<Fault>,
    /// How time passes.
    pub clock: Clock,
}

impl Default for PioneerServer {
    fn default() -> Self {
        Self {
            listen: "127.0.0.1:8101".to_owned(),
            name: "Wheelwright".to_owned(),
            class: "Pioneer".to_owned(),
            subclass: "p3dx-sh".to_owned(),
            cycle: 0.1,
            watchdog: 2.0,
            sonars: 16,
            acceleration: 300,
            turn_acceleration: 100,
            limits: [1400, 300],
            ticks_per_mm: 128,
            battery: 13.0,
            fault: Vec::new(),
            clock: Clock::Real,
        }
    }
}

/// Something that goes wrong on the line, once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Information packets of the session before it happens.
    pub after: u64,
    /// What happens.
    pub kind: FaultKind,
    /// For how many packets, where that makes sense; 0 for all that follow.
    #[serde(default)]
    pub packets: u64,
}

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// The line is cut.
    Cut,
    /// Half a packet, and the line is cut.
    HalfPacket,
    /// Packets with a wrong checksum.
    BadChecksum,
    /// The same packet again and again.
    Frozen,
    /// No packets; commands still arrive.
    Silent,
    /// The motors go off, as by their button.
    MotorsOff,
}

impl PioneerServer {
    pub(super) fn place(&self) -> Result<Place, RobotError> {
        Ok(Place::Tcp(self.listen.clone()))
    }

    fn check(&self) -> Result<(), RobotError> {
        check_time("cycle", self.cycle)?;
        if self.cycle > 0.255 {
            return Err(config(
                "cycle",
                format!("must be at most 0.255, as the robot tells it in one byte of milliseconds, not {}", self.cycle),
            ));
        }
        if !(0.0..=60.0).contains(&self.watchdog) {
            return Err(config("watchdog", format!("must be between 0 and 60 (it is in seconds), not {}", self.watchdog)));
        }
        if !(0.0..=100.0).contains(&self.battery) {
            return Err(config("battery", format!("must be between 0 and 100 (it is in volts), not {}", self.battery)));
        }
        if self.sonars > 40 {
            return Err(config("sonars", format!("at most 40 fit into a packet, not {}", self.sonars)));
        }
        Ok(())
    }
}

/// How far a client has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Waiting for SYNC0, SYNC1 or SYNC2.
    Sync(u8),
    /// SYNC2 was answered.
    Ready,
    /// Information packets flow.
    Open,
}

/// What the client wants of the wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Target {
    v: f64,
    omega: f64,
}

/// The robot's side of the protocol.
pub struct PioneerEmulator {
    server: PioneerServer,
    conversion: Conversion,
    body: Body,
    /// Periods of the robot a cycle.
    periods: u32,
    passed: u32,
    decoder: Decoder,
    phase: Phase,
    enabled: bool,
    sonar: bool,
    encoder_stream: bool,
    target: Target,
    set_point: [f64; 2],
    /// Acceleration and deceleration of v \[m/s²\] and ω \[rad/s²\].
    ramps: [[f64; 2]; 2],
    limits: [f64; 2],
    /// Time since the client's last packet \[s\].
    silence: f64,
    /// Pose at the last SETO, as seen from the start.
    origin: [f64; 3],
    sent: u64,
    frozen: Option<Packet>,
    cut: bool,
}

impl PioneerEmulator {
    /// A robot that is on and waits for SYNC0.
    ///
    /// # Errors
    /// [`RobotError::Config`].
    pub fn new(server: &PioneerServer, robot: Live) -> Result<Self, RobotError> {
        server.check()?;
        let conversion = Conversion::of(&server.subclass)?;
        let body = Body::new(robot)?;
        let periods = (server.cycle / body.period()).round();
        if periods < 1.0 || (periods * body.period() - server.cycle).abs() > 1e-9 {
            let reason = format!("{} s must be a multiple of the robot's period of {} s", server.cycle, body.period());
            return Err(config("cycle", reason));
        }
        let [v, omega] = server.limits;
        let acceleration = 1e-3 * f64::from(server.acceleration);
        let turn = f64::from(server.turn_acceleration).to_radians();
        Ok(Self {
            server: server.clone(),
            conversion,
            body,
            periods: periods as u32,
            passed: 0,
            decoder: Decoder::default(),
            phase: Phase::Sync(0),
            enabled: false,
            sonar: true,
            encoder_stream: false,
            target: Target { v: 0.0, omega: 0.0 },
            set_point: [0.0; 2],
            ramps: [[acceleration; 2], [turn; 2]],
            limits: [1e-3 * f64::from(v), f64::from(omega).to_radians()],
            silence: 0.0,
            origin: [0.0; 3],
            sent: 0,
            frozen: None,
            cut: false,
        })
    }

    fn answer(&mut self, packet: &Packet, answers: &mut Vec<u8>) -> Result<(), RobotError> {
        self.silence = 0.0;
        match self.phase {
            Phase::Sync(stage) => self.synchronise(stage, packet, answers),
            Phase::Ready if packet.kind == number::OPEN => self.open(),
            // Asked for the names once more, or from the beginning: the last answer was lost.
            Phase::Ready if packet.kind <= number::SYNC2 => self.synchronise(packet.kind, packet, answers),
            Phase::Ready => {}
            Phase::Open => return self.obey(packet, answers),
        }
        Ok(())
    }

    /// Echoes the expected SYNC; anything else begins again.
    fn synchronise(&mut self, stage: u8, packet: &Packet, answers: &mut Vec<u8>) {
        if packet.kind != stage {
            // A client that lost an echo asks for the last one again.
            self.phase = Phase::Sync(u8::from(packet.kind == number::SYNC0));
            if packet.kind == number::SYNC0 {
                answers.extend(encode(number::SYNC0, &[]));
            }
            return;
        }
        if stage < number::SYNC2 {
            self.phase = Phase::Sync(stage + 1);
            answers.extend(encode(stage, &[]));
            return;
        }
        self.phase = Phase::Ready;
        let names = [&self.server.name, &self.server.class, &self.server.subclass];
        let texts: Vec<u8> = names.into_iter().flat_map(|n| n.bytes().chain([0])).collect();
        answers.extend(encode(number::SYNC2, &texts));
    }

    fn open(&mut self) {
        self.phase = Phase::Open;
        (self.sonar, self.encoder_stream, self.sent, self.frozen) = (true, false, 0, None);
    }

    fn obey(&mut self, packet: &Packet, answers: &mut Vec<u8>) -> Result<(), RobotError> {
        let argument = Argument::of(packet);
        let value = argument.integer();
        match (packet.kind, value) {
            (number::CLOSE, _) => self.close(),
            (number::ENABLE, Some(on)) => self.enable(on != 0),
            (number::VEL, Some(v)) => self.target.v = 1e-3 * f64::from(v),
            (number::RVEL | number::ROTATE, Some(rate)) => self.target.omega = f64::from(rate).to_radians(),
            (number::VEL2, Some(_)) => {
                if let Some([right, left]) = argument.bytes() {
                    let [left, right] = [left, right].map(|steps| f64::from(steps) * self.conversion.vel2);
                    let [v, omega] = self.conversion.to_body(left, right);
                    self.target = Target { v, omega };
                }
            }
            (number::STOP | number::ESTOP, _) => self.target = Target { v: 0.0, omega: 0.0 },
            (number::SETA, Some(a)) if a != 0 => self.ramps[0][usize::from(a < 0)] = 1e-3 * f64::from(a.abs()),
            (number::SETRA, Some(a)) if a != 0 => self.ramps[1][usize::from(a < 0)] = f64::from(a.abs()).to_radians(),
            (number::SETV, Some(v)) => self.limits[0] = 1e-3 * f64::from(v.abs()),
            (number::SETRV, Some(v)) => self.limits[1] = f64::from(v.abs()).to_radians(),
            (number::SETO, _) => self.origin = self.body.pose(),
            (number::SONAR, Some(on)) => self.sonar = on != 0,
            (number::CONFIG, _) => answers.extend(frame(&self.firmware().encode())),
            (number::ENCODER, Some(kind)) if self.server.ticks_per_mm > 0 => {
                self.encoder_stream = kind > 1;
                if kind == 1 {
                    answers.extend(self.encoders());
                }
            }
            (number::STEP, _) if self.server.clock == Clock::Stepped => {
                for _ in 0..self.periods {
                    self.pass(answers)?;
                }
            }
            // PULSE says only that the client lives; what is not known is ignored, as by the robot.
            _ => {}
        }
        Ok(())
    }

    fn close(&mut self) {
        self.enable(false);
        self.phase = Phase::Sync(0);
    }

    fn enable(&mut self, on: bool) {
        self.enabled = on;
        self.target = Target { v: 0.0, omega: 0.0 };
    }

    /// The set point a period later: on the ramp towards the target, or at once to zero where the motors are off.
    fn ramp(&mut self, period: f64) {
        if !self.enabled {
            self.set_point = [0.0; 2];
            return;
        }
        // The firmware remembers the command and takes it up again when the client speaks.
        let silent = self.server.watchdog > 0.0 && self.silence > self.server.watchdog;
        let target = if silent { [0.0; 2] } else { [self.target.v, self.target.omega] };
        for i in 0..2 {
            let target = target[i].clamp(-self.limits[i], self.limits[i]);
            let [up, down] = self.ramps[i];
            let rate = if target.abs() >= self.set_point[i].abs() { up } else { down };
            self.set_point[i] += (target - self.set_point[i]).clamp(-rate * period, rate * period);
        }
    }

    fn firmware(&self) -> Firmware {
        let [translation_limit, rotation_limit] = self.server.limits;
        let whole = |value: f64| value.round() as u16;
        let [[v_up, v_down], [turn_up, turn_down]] = self.ramps;
        Firmware {
            robot: [self.server.class.clone(), self.server.subclass.clone(), "emulated".to_owned()],
            rotation_top: rotation_limit,
            translation_top: translation_limit,
            rotation_acceleration_top: u16::MAX,
            translation_acceleration_top: u16::MAX,
            name: self.server.name.clone(),
            cycle: whole(1e3 * self.server.cycle) as u8,
            watchdog: whole(1e3 * self.server.watchdog),
            rotation_limit,
            translation_limit,
            rotation_ramp: [turn_up, turn_down].map(|r| whole(r.to_degrees())),
            rotation_gains: [0; 3],
            translation_ramp: [v_up, v_down].map(|r| whole(1e3 * r)),
            translation_gains: [0; 3],
            ticks_per_mm: self.server.ticks_per_mm,
            version: "2.9".to_owned(),
        }
    }

    fn sip(&self) -> Sip {
        let c = &self.conversion;
        let [v, omega] = self.body.velocity();
        let [left, right] = c.to_wheels([v, omega]).map(|speed| (speed / c.velocity).round() as i16);
        let [x, y, phi] = self.pose();
        // A counter of sixteen bits goes round.
        let wrapped = |value: f64| (value.round() as i64) as i16;
        let sonars = if self.sonar { self.server.sonars } else { 0 };
        let battery = (10.0 * self.server.battery).round();
        Sip {
            moving: left != 0 || right != 0,
            x: wrapped(x / c.distance),
            y: wrapped(y / c.distance),
            heading: (wrapped(phi / c.angle) as u16 % (std::f64::consts::TAU / c.angle).round() as u16).cast_signed(),
            left,
            right,
            battery: battery as u8,
            stall: 0,
            control: 0,
            flags: u16::from(self.enabled) | if self.sonar { 0x1E } else { 0 },
            compass: 0,
            sonar: (0..sonars).map(|n| (n, 5000)).collect(),
            tail: Some(Tail {
                battery: battery as i16,
                charge: 0,
                rotation: Some((10.0 * omega.to_degrees()).round() as i16),
                faults: Some(0),
            }),
        }
    }

    /// x, y, φ since the last SETO.
    fn pose(&self) -> [f64; 3] {
        let [x, y, phi] = self.body.pose();
        let [x0, y0, phi0] = self.origin;
        let (sin, cos) = phi0.sin_cos();
        [(x - x0) * cos + (y - y0) * sin, (y - y0) * cos - (x - x0) * sin, phi - phi0]
    }

    fn encoders(&self) -> Vec<u8> {
        let track = 2.0 / self.conversion.difference;
        let ticks = self.body.paths(track).map(|way| ((way * 1e3 * f64::from(self.server.ticks_per_mm)).floor() as i64) as i32);
        let data: Vec<u8> = ticks.into_iter().flat_map(i32::to_le_bytes).collect();
        encode(ENCODER, &data)
    }

    /// Sends the information packet of this cycle, as the faults leave it.
    fn inform(&mut self, answers: &mut Vec<u8>) {
        if self.encoder_stream {
            answers.extend(self.encoders());
        }
        let mut packet = self.sip().encode();
        let number = self.sent;
        self.sent += 1;
        let active = |fault: &&Fault| number >= fault.after && (fault.packets == 0 || number < fault.after + fault.packets);
        let kind = self.server.fault.iter().find(active).map(|fault| fault.kind);
        if kind == Some(FaultKind::Frozen) {
            packet = self.frozen.get_or_insert(packet).clone();
        }
        let mut bytes = frame(&packet);
        match kind {
            Some(FaultKind::Cut) => (self.cut, bytes) = (true, Vec::new()),
            Some(FaultKind::HalfPacket) => {
                self.cut = true;
                bytes.truncate(bytes.len() / 2);
            }
            Some(FaultKind::BadChecksum) => {
                if let Some(last) = bytes.last_mut() {
                    *last ^= 0x55;
                }
            }
            Some(FaultKind::Silent) => bytes.clear(),
            Some(FaultKind::MotorsOff) => self.enable(false),
            Some(FaultKind::Frozen) | None => {}
        }
        answers.extend(bytes);
    }
}

impl Protocol for PioneerEmulator {
    fn receive(&mut self, bytes: &[u8], answers: &mut Vec<u8>) -> Result<(), RobotError> {
        self.decoder.push(bytes);
        let mut packets = VecDeque::new();
        while let Some(packet) = self.decoder.next_packet() {
            packets.push_back(packet);
        }
        packets.iter().try_for_each(|packet| self.answer(packet, answers))
    }

    fn pass(&mut self, answers: &mut Vec<u8>) -> Result<(), RobotError> {
        let period = self.body.period();
        self.ramp(period);
        self.body.advance(self.set_point)?;
        self.silence += period;
        self.passed += 1;
        if self.passed >= self.periods {
            self.passed = 0;
            if self.phase == Phase::Open {
                self.inform(answers);
            }
        }
        Ok(())
    }

    fn period(&self) -> f64 {
        self.body.period()
    }

    fn state(&self) -> State {
        let [v, omega] = self.body.velocity();
        let [v_ref, omega_ref] = [self.target.v, self.target.omega];
        State { time: self.body.time(), open: self.phase == Phase::Open, enabled: self.enabled, v_ref, omega_ref, v, omega }
    }

    fn cuts_line(&mut self) -> bool {
        std::mem::take(&mut self.cut)
    }
}

fn frame(packet: &Packet) -> Vec<u8> {
    encode(packet.kind, &packet.data)
}
