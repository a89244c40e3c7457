//! Drives a ROS 2 robot, one period at the pace of its odometry.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::GUID;
use wheelwright_core::channel::{self, Channel};
use wheelwright_core::robot::{Robot, RobotError};

use super::graph::{self, Direction};
use super::message::{Header, Odometry, Twist, TwistStamped};
use super::node::{Node, Reader, Writer};
use super::timeline::{Moment, Rhythm, Timeline};
use super::{CommandType, Network, Ros2Config, TimeSource};
use crate::wire::{Clock, Tally, check_room, clamp, config as wrong, velocity_command};

static INPUTS: [Channel; 2] = [channel::V_REF, channel::OMEGA_REF];
static OUTPUTS: [Channel; 5] = [channel::V, channel::OMEGA, channel::X, channel::Y, channel::PHI];

/// Name of the node.
const NAME: &str = "wheelwright";
/// How often discovery is asked.
const LOOK: Duration = Duration::from_millis(20);
/// Networks hold messages back for a while; a robot that is silent for less is not told to stand \[s\].
const JITTER: f64 = 0.1;
/// Odometry that is looked at before the first command.
const LISTENING: usize = 12;
/// Drivers of robots stop, commonly after 0.5 s, when no command comes; a command is sent again after this.
const KEEP_ALIVE: Duration = Duration::from_millis(50);
/// A control period may differ from a multiple of the odometry's by this share of the latter.
const UNEVEN: f64 = 0.1;
/// Zero commands of one stop, fewest and most.
const ZEROS: (u32, u32) = (3, 40);
/// A robot below this stands \[m/s, rad/s\].
const STANDING: [f64; 2] = [0.005, 0.02];

/// A connected robot.
pub(super) struct Ros2Robot {
    node: Node,
    odometry: Reader<Odometry>,
    commander: Commander,
    topics: [String; 2],
    /// Who takes the commands, and who tells the odometry.
    partners: [BTreeSet<GUID>; 2],
    limits: [Option<f64>; 2],
    timeout: Duration,
    stepped: bool,
    rhythm: Rhythm,
    /// Odometry a control period.
    cycles: u32,
    timeline: Timeline,
    time: f64,
    measured: [f64; OUTPUTS.len()],
    held: [f64; 2],
    sent: Instant,
    tally: Tally,
    silences: Silences,
    remarks: Vec<String>,
    state: State,
}

/// How often, and how long \[s\] at most, the robot was told to stand because it was silent.
#[derive(Debug, Clone, Copy, Default)]
struct Silences {
    count: u32,
    longest: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Driving,
    Stopped,
    Failed,
}

/// Publishes commands as the robot subscribes them.
enum Commander {
    Twist(Writer<Twist>),
    Stamped(Writer<TwistStamped>),
}

impl Commander {
    fn new(node: &mut Node, topic: &str, kind: CommandType) -> Result<Self, RobotError> {
        Ok(match kind {
            CommandType::Twist => Self::Twist(node.writer(topic)?),
            CommandType::TwistStamped => Self::Stamped(node.writer(topic)?),
        })
    }

    fn id(&self) -> GUID {
        match self {
            Self::Twist(writer) => writer.id(),
            Self::Stamped(writer) => writer.id(),
        }
    }

    fn listeners(&self, node: &mut Node) -> BTreeSet<GUID> {
        match self {
            Self::Twist(writer) => node.listeners(writer),
            Self::Stamped(writer) => node.listeners(writer),
        }
    }

    fn send(&self, velocity: [f64; 2], timeline: &Timeline) -> Result<(), RobotError> {
        let twist = Twist::planar(velocity);
        match self {
            Self::Twist(writer) => writer.send(twist),
            Self::Stamped(writer) => {
                let header = Header { stamp: timeline.now(), frame_id: "base_link".to_owned() };
                writer.send(TwistStamped { header, twist })
            }
        }
    }
}

impl Ros2Robot {
    /// Waits until both ends have found each other and odometry comes.
    pub(super) fn connect(config: &Ros2Config, network: &Network) -> Result<Self, RobotError> {
        let mut node = Node::join(network, NAME)?;
        let mut odometry = node.reader(&config.odometry_topic)?;
        let (commander, partners) = meet(config, network, &mut node, &odometry)?;
        let (first, last) = listen(config, &mut odometry)?;
        let rhythm = match config.period.filter(|_| config.clock == Clock::Stepped) {
            Some(period) => Rhythm { source: TimeSource::Stamp, cycle: period, interval: period },
            None => Rhythm::of(&first, config.time)?,
        };
        let cycles = cycles(config.period, rhythm.cycle)?;
        let origin = first.last().copied().ok_or_else(|| RobotError::Driver("no odometry was kept".to_owned()))?;
        let mut robot = Self {
            remarks: remarks(config, &node, rhythm, partners[1].len()),
            partners,
            node,
            odometry,
            commander,
            topics: [config.command_topic.clone(), config.odometry_topic.clone()],
            limits: [config.limits.v, config.limits.omega],
            timeout: Duration::from_secs_f64(config.timeout),
            stepped: config.clock == Clock::Stepped,
            rhythm,
            cycles,
            timeline: Timeline::new(rhythm.source, origin),
            time: 0.0,
            measured: [0.0; OUTPUTS.len()],
            held: [0.0; 2],
            sent: Instant::now(),
            tally: Tally::default(),
            silences: Silences::default(),
            state: State::Driving,
        };
        robot.read(&last);
        Ok(robot)
    }

    fn limited(&self, [v, omega]: [f64; 2]) -> [f64; 2] {
        [clamp(v, self.limits[0]), clamp(omega, self.limits[1])]
    }

    fn send(&mut self, velocity: [f64; 2]) -> Result<(), RobotError> {
        self.held = velocity;
        self.sent = Instant::now();
        self.commander.send(velocity, &self.timeline)
    }

    /// Somebody must take the commands.
    fn check_listener(&mut self) -> Result<(), RobotError> {
        let commander = self.commander.id();
        self.check_partner(commander, "subscribes", 0)
    }

    /// Somebody must tell what the robot does.
    fn check_teller(&mut self) -> Result<(), RobotError> {
        let odometry = self.odometry.id();
        self.check_partner(odometry, "publishes", 1)
    }

    fn check_partner(&mut self, own: GUID, verb: &str, direction: usize) -> Result<(), RobotError> {
        let known = self.partners[direction].iter().copied();
        if !self.node.graph().partners(own, known).is_empty() {
            return Ok(());
        }
        let topic = &self.topics[direction];
        Err(RobotError::Connection(format!("nobody {verb} {topic} any more: the robot's driver ended, or the network is cut")))
    }

    /// Takes one message, if any comes in time; it counts if it is newer than the last.
    fn take(&mut self, until: Instant) -> Result<bool, RobotError> {
        let Some(odometry) = self.odometry.receive(until)? else { return Ok(false) };
        if let Some(time) = self.timeline.advance(moment(&odometry)) {
            self.time = time;
            self.read(&odometry);
        }
        Ok(true)
    }

    fn read(&mut self, odometry: &Odometry) {
        let [v, omega] = odometry.twist.twist.velocity();
        let pose = &odometry.pose.pose;
        let before = self.measured[4];
        let turn = pose.orientation.yaw() - before;
        // Headings go round; what is reported does not.
        let phi = before + turn - std::f64::consts::TAU * (turn / std::f64::consts::TAU).round();
        self.measured = [v, omega, pose.position.x, pose.position.y, phi];
    }

    /// Waits for the odometry of a time \[s\] or later. A robot that is silent for two periods, or longer than networks are, is told
    /// to stand.
    fn advance(&mut self, target: f64) -> Result<(), RobotError> {
        let begin = Instant::now();
        let patience = (2.0 * self.rhythm.interval * f64::from(self.cycles)).max(JITTER);
        let patience = Duration::from_secs_f64(patience).min(self.timeout);
        let mut told = self.stepped;
        loop {
            let alarm = begin + if told { self.timeout } else { patience };
            let until = if self.stepped { alarm } else { alarm.min(self.sent + KEEP_ALIVE) };
            self.take(until)?;
            if self.time >= target {
                break;
            }
            let now = Instant::now();
            if now >= begin + self.timeout {
                return Err(self.silence());
            }
            if now >= alarm {
                told = true;
                self.send([0.0; 2])?;
            } else if !self.stepped && now >= self.sent + KEEP_ALIVE {
                self.send(self.held)?;
            }
        }
        if told && !self.stepped {
            self.silences.count += 1;
            self.silences.longest = self.silences.longest.max(begin.elapsed().as_secs_f64());
        }
        Ok(())
    }

    fn silence(&mut self) -> RobotError {
        if let Err(error) = self.check_teller() {
            return error;
        }
        let what = format!("newer odometry on {}, whose publisher is still there", self.topics[1]);
        RobotError::Timeout { limit_s: self.timeout.as_secs_f64(), what }
    }

    /// Takes what has come already; true if a period went by with it.
    fn drain(&mut self) -> Result<bool, RobotError> {
        let late = self.time + self.period() - 0.5 * self.rhythm.cycle;
        while !self.stepped && self.take(Instant::now())? {}
        Ok(self.time >= late)
    }

    fn drive(&mut self, wanted: [f64; 2]) -> Result<(), RobotError> {
        self.check_listener()?;
        let mut base = self.time;
        if self.drain()? {
            self.tally.late();
            base = self.time;
        }
        let limited = self.limited(wanted);
        self.tally.count(wanted, limited, limited);
        self.send(limited)?;
        self.advance(base + self.period() - 0.5 * self.rhythm.cycle)
    }

    /// Zero several times, until the robot says that it stands.
    fn halt(&mut self) -> Result<(), RobotError> {
        for sent in 1..=ZEROS.1 {
            self.send([0.0; 2])?;
            let until = self.sent + KEEP_ALIVE;
            while Instant::now() < until {
                self.take(until)?;
                if self.stepped {
                    break;
                }
            }
            let stands = self.measured.iter().zip(STANDING).all(|(speed, standing)| speed.abs() < standing);
            if stands && sent >= ZEROS.0 {
                break;
            }
        }
        self.check_listener()
    }
}

impl Robot for Ros2Robot {
    fn inputs(&self) -> &[Channel] {
        &INPUTS
    }

    fn outputs(&self) -> &[Channel] {
        &OUTPUTS
    }

    fn period(&self) -> f64 {
        self.rhythm.cycle * f64::from(self.cycles)
    }

    fn real_time(&self) -> bool {
        !self.stepped
    }

    fn executed(&self, command: &mut [f64]) {
        if let Ok(wanted) = velocity_command(command) {
            command.copy_from_slice(&self.limited(wanted));
        }
    }

    fn measure(&mut self, measured: &mut [f64]) -> Result<f64, RobotError> {
        check_room(measured, OUTPUTS.len())?;
        if !self.stepped {
            // What has come already is of some time ago; the next odometry begins a period.
            self.drain()?;
            self.advance(self.time + 0.5 * self.rhythm.cycle)?;
        }
        measured.copy_from_slice(&self.measured);
        Ok(self.time)
    }

    fn step(&mut self, command: &[f64], measured: &mut [f64]) -> Result<f64, RobotError> {
        if self.state != State::Driving {
            return Err(RobotError::Fault("the robot was stopped; connect again to drive it".to_owned()));
        }
        let driven = check_room(measured, OUTPUTS.len()).and_then(|()| velocity_command(command)).and_then(|wanted| self.drive(wanted));
        if let Err(error) = driven {
            self.state = State::Failed;
            // The error that ended the drive is the one to report; `stop` says whether the robot could be told.
            let _ = self.send([0.0; 2]);
            return Err(error);
        }
        measured.copy_from_slice(&self.measured);
        Ok(self.time)
    }

    fn stop(&mut self) -> Result<(), RobotError> {
        if self.state == State::Stopped {
            return Ok(());
        }
        self.state = State::Failed;
        self.halt()?;
        self.state = State::Stopped;
        Ok(())
    }

    fn warnings(&self) -> Vec<String> {
        let Silences { count, longest } = self.silences;
        let silent = (count > 0).then(|| {
            format!("odometry stayed away {count} times, for {longest:.2} s at the longest; the robot was told to stand meanwhile")
        });
        self.remarks.iter().cloned().chain(silent).chain(self.tally.warnings()).collect()
    }
}

impl Drop for Ros2Robot {
    fn drop(&mut self) {
        // The robot's own watchdog is next in line.
        let _ = self.stop();
    }
}

fn moment(odometry: &Odometry) -> Moment {
    Moment { stamp: odometry.header.stamp.nanoseconds(), arrival: Instant::now() }
}

/// Waits until the robot subscribes the commands and its odometry has been found.
fn meet(
    config: &Ros2Config,
    network: &Network,
    node: &mut Node,
    odometry: &Reader<Odometry>,
) -> Result<(Commander, [BTreeSet<GUID>; 2]), RobotError> {
    let end = Instant::now() + Duration::from_secs_f64(config.discovery);
    let mut commander: Option<Commander> = None;
    loop {
        let taken = graph::command_types(&node.subscribed(), &config.command_topic);
        if taken.len() > 1 && config.command_type.is_none() {
            let reason =
                format!("is needed: both {} are subscribed on {}", graph::fitting_commands(None).join(" and "), config.command_topic);
            return Err(wrong("command_type", reason));
        }
        if let (None, Some(kind)) = (&commander, config.command_type.or(taken.first().copied())) {
            commander = Some(Commander::new(node, &config.command_topic, kind)?);
        }
        let listeners = commander.as_ref().map(|c| c.listeners(node)).unwrap_or_default();
        let partners = [listeners, node.tellers(odometry)];
        let found = partners.each_ref().map(|partners| !partners.is_empty());
        match commander {
            Some(commander) if found == [true; 2] => return Ok((commander, partners)),
            _ if Instant::now() >= end => {
                return Err(not_found(config, network, node, commander.map(|c| c.id()), odometry.id(), found));
            }
            _ => std::thread::sleep(LOOK),
        }
    }
}

/// Why the two ends did not find each other.
fn not_found(
    config: &Ros2Config,
    network: &Network,
    node: &mut Node,
    commander: Option<GUID>,
    odometry: GUID,
    found: [bool; 2],
) -> RobotError {
    let graph = node.graph();
    if graph.programs_beside(odometry) == 0 {
        return RobotError::Connection(graph::alone(network));
    }
    let [command_refusal, odometry_refusal] = [commander, Some(odometry)].map(|own| own.and_then(|own| graph.refusal(own)));
    let (subscribed, published) = (node.subscribed(), node.published());
    let directions = [
        Direction {
            verb: "subscribes",
            key: "command_topic",
            topic: &config.command_topic,
            fitting: graph::fitting_commands(config.command_type),
            endpoints: &subscribed,
            refusal: command_refusal,
        },
        Direction {
            verb: "publishes",
            key: "odometry_topic",
            topic: &config.odometry_topic,
            fitting: graph::fitting_odometry(),
            endpoints: &published,
            refusal: odometry_refusal,
        },
    ];
    let missing = directions.iter().zip(found).filter(|(_, found)| !found);
    let complaints: Vec<_> = missing.map(|(direction, _)| direction.complaint()).collect();
    RobotError::Connection(format!("{} ({network}, after {} s)", complaints.join("; "), config.discovery))
}

/// The first odometry: when it came, and the last of it.
fn listen(config: &Ros2Config, odometry: &mut Reader<Odometry>) -> Result<(Vec<Moment>, Odometry), RobotError> {
    let messages = if config.clock == Clock::Stepped { 1 } else { LISTENING };
    let timeout = Duration::from_secs_f64(config.timeout);
    let mut moments = Vec::new();
    loop {
        let Some(message) = odometry.receive(Instant::now() + timeout)? else {
            let what = format!(
                "odometry on {}, which is published, {} of {messages} messages came: does the robot run, and do its messages come within `timeout`?",
                config.odometry_topic,
                moments.len()
            );
            return Err(RobotError::Timeout { limit_s: config.timeout, what });
        };
        moments.push(moment(&message));
        if moments.len() == messages {
            return Ok((moments, message));
        }
    }
}

/// Odometry a control period.
fn cycles(period: Option<f64>, cycle: f64) -> Result<u32, RobotError> {
    let wanted = period.unwrap_or(cycle) / cycle;
    let cycles = wanted.round();
    if cycles.is_finite() && cycles >= 1.0 && (wanted - cycles).abs() <= UNEVEN {
        return Ok(cycles as u32);
    }
    Err(wrong("period", format!("must be a multiple of the odometry's, which comes every {cycle} s")))
}

/// What should be known about the robot besides.
fn remarks(config: &Ros2Config, node: &Node, rhythm: Rhythm, tellers: usize) -> Vec<String> {
    let mut remarks = Vec::new();
    if rhythm.source == TimeSource::Arrival && config.time.is_none() {
        remarks.push("the stamps of the odometry do not advance: times are those of arrival, with the network's jitter".to_owned());
    }
    if tellers > 1 {
        remarks.push(format!("{tellers} publishers of {} are mixed up in the recording", config.odometry_topic));
    }
    let rivals = node.published().iter().filter(|e| e.topic == config.command_topic).count();
    if rivals > 0 {
        remarks.push(format!("{rivals} other publishers of {} may drive the robot at the same time", config.command_topic));
    }
    remarks
}
