//! A ROS 2 robot with the habits of ros2_controllers' diff_drive_controller: it subscribes one type of command, stands when
//! none comes for half a second, and ignores stamped commands that are older.

use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};
use wheelwright_core::robot::{Live, RobotError};

use super::server::Emulator;
use crate::ros2::{COMMAND_TOPIC, CommandType, Network, ODOMETRY_TOPIC, check_topic};
use crate::wire::{Clock, check_time};

/// A ROS 2 robot to emulate: `[emulator] type = "ros2"`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Ros2Server {
    /// Where commands come from.
    pub command_topic: String,
    /// Where odometry goes.
    pub odometry_topic: String,
    /// Which message carries commands.
    pub command_type: CommandType,
    /// DDS domain; that of the environment (`ROS_DOMAIN_ID`) or 0 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub domain: Option<u16>,
    /// Addresses of this machine that are used; all of them if empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub interfaces: Vec<Ipv4Addr>,
    /// Period of the odometry \[s\], a multiple of the robot's.
    pub cycle: f64,
    /// Age of the last command at which the robot stands \[s\].
    pub timeout: f64,
    /// How time passes; `stepped` is one cycle a command.
    pub clock: Clock,
}

impl Default for Ros2Server {
    fn default() -> Self {
        Self {
            command_topic: COMMAND_TOPIC.to_owned(),
            odometry_topic: ODOMETRY_TOPIC.to_owned(),
            command_type: CommandType::Twist,
            domain: None,
            interfaces: Vec::new(),
            cycle: 0.02,
            timeout: 0.5,
            clock: Clock::Real,
        }
    }
}

impl Ros2Server {
    pub(super) fn start(&self, robot: Live) -> Result<Emulator, RobotError> {
        let network = self.check()?;
        start(self, &network, robot)
    }

    fn check(&self) -> Result<Network, RobotError> {
        check_topic("command_topic", &self.command_topic)?;
        check_topic("odometry_topic", &self.odometry_topic)?;
        check_time("cycle", self.cycle)?;
        check_time("timeout", self.timeout)?;
        Network::new(self.domain, &self.interfaces)
    }
}

#[cfg(not(feature = "ros2"))]
fn start(_: &Ros2Server, _: &Network, _: Live) -> Result<Emulator, RobotError> {
    Err(crate::ros2::without_feature())
}

#[cfg(feature = "ros2")]
use served::start;

#[cfg(feature = "ros2")]
mod served {
    use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

    use wheelwright_core::robot::{Live, RobotError};

    use super::super::body::Body;
    use super::super::server::{Board, Emulator, State};
    use super::Ros2Server;
    use crate::ros2::message::{Odometry, Time, Twist, TwistStamped};
    use crate::ros2::node::{Node, Reader, Writer};
    use crate::ros2::{CommandType, Network};
    use crate::wire::{Clock, config};

    /// Name of the node.
    const NAME: &str = "wheelwright_robot";
    /// How often a waiting robot looks whether it is to end; one with a stepped clock says then where it is.
    const LOOK: Duration = Duration::from_millis(50);
    /// A clock that is further behind starts again: the machine was asleep.
    const FAR_BEHIND: Duration = Duration::from_secs(1);

    pub(super) fn start(server: &Ros2Server, network: &Network, robot: Live) -> Result<Emulator, RobotError> {
        let robot = Robot::new(server, network, robot)?;
        let board = Board::new(robot.state());
        let address = format!("{network}: {}, {}", server.command_topic, server.odometry_topic);
        let shown = board.clone();
        Ok(Emulator::run(address, board, None, move || robot.serve(&shown)))
    }

    /// Takes commands of either type.
    enum Commands {
        Twist(Reader<Twist>),
        Stamped(Reader<TwistStamped>),
    }

    impl Commands {
        /// The next command, v and ω, and its stamp \[ns\], 0 without one.
        fn receive(&mut self, until: Instant) -> Result<Option<([f64; 2], i64)>, RobotError> {
            Ok(match self {
                Self::Twist(reader) => reader.receive(until)?.map(|twist| (twist.velocity(), 0)),
                Self::Stamped(reader) => reader.receive(until)?.map(|m| (m.twist.velocity(), m.header.stamp.nanoseconds())),
            })
        }
    }

    struct Robot {
        node: Node,
        commands: Commands,
        odometry: Writer<Odometry>,
        body: Body,
        /// Periods of the body a cycle.
        periods: u32,
        cycle: f64,
        timeout: f64,
        stepped: bool,
        /// The clock when the body's was zero \[ns\].
        epoch: i64,
        command: [f64; 2],
        /// Time of the last command \[s\].
        commanded: f64,
        /// Publishers of commands.
        clients: usize,
    }

    impl Robot {
        fn new(server: &Ros2Server, network: &Network, robot: Live) -> Result<Self, RobotError> {
            let body = Body::new(robot)?;
            let periods = (server.cycle / body.period()).round();
            if periods < 1.0 || (server.cycle / body.period() - periods).abs() > 1e-6 {
                return Err(config(
                    "cycle",
                    format!("must be a multiple of the robot's period of {} s, not {}", body.period(), server.cycle),
                ));
            }
            let mut node = Node::join(network, NAME)?;
            let topic = &server.command_topic;
            let commands = match server.command_type {
                CommandType::Twist => Commands::Twist(node.reliable_reader(topic)?),
                CommandType::TwistStamped => Commands::Stamped(node.reliable_reader(topic)?),
            };
            let odometry = node.writer(&server.odometry_topic)?;
            let epoch = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64);
            Ok(Self {
                node,
                commands,
                odometry,
                body,
                periods: periods as u32,
                cycle: server.cycle,
                timeout: server.timeout,
                stepped: server.clock == Clock::Stepped,
                epoch,
                command: [0.0; 2],
                commanded: f64::NEG_INFINITY,
                clients: 0,
            })
        }

        fn serve(mut self, board: &Board) -> Result<(), RobotError> {
            let cycle = Duration::from_secs_f64(self.cycle);
            let mut due = Instant::now() + cycle;
            while !board.ends() {
                self.count_clients(board);
                let look = Instant::now() + LOOK;
                let came = self.commands.receive(if self.stepped { look } else { due.min(look) })?;
                if let Some((velocity, stamp)) = came {
                    self.take(velocity, stamp);
                    board.publish(self.state(), true);
                }
                let now = Instant::now();
                let passes = if self.stepped { came.is_some() } else { now >= due };
                if passes {
                    self.pass()?;
                    due = if due + FAR_BEHIND < now { now } else { due } + cycle;
                }
                if passes || self.stepped {
                    self.tell()?;
                }
                board.publish(self.state(), false);
            }
            Ok(())
        }

        fn count_clients(&mut self, board: &Board) {
            let clients = match &self.commands {
                Commands::Twist(reader) => self.node.tellers(reader).len(),
                Commands::Stamped(reader) => self.node.tellers(reader).len(),
            };
            (self.clients..clients).for_each(|_| board.count_client());
            self.clients = clients;
        }

        /// Now \[ns\], by the robot's clock.
        fn now(&self) -> i64 {
            self.epoch.saturating_add((1e9 * self.body.time()).round() as i64)
        }

        /// Takes a command, unless it is too old. A command without a stamp is of now.
        fn take(&mut self, velocity: [f64; 2], stamp: i64) {
            let age = if stamp == 0 { 0.0 } else { 1e-9 * self.now().saturating_sub(stamp) as f64 };
            if age < self.timeout {
                self.command = velocity;
                self.commanded = self.body.time() - age;
            }
        }

        /// What the robot drives by.
        fn obeyed(&self) -> [f64; 2] {
            if self.body.time() - self.commanded > self.timeout { [0.0; 2] } else { self.command }
        }

        /// Lets a cycle pass.
        fn pass(&mut self) -> Result<(), RobotError> {
            for _ in 0..self.periods {
                self.body.advance(self.obeyed())?;
            }
            Ok(())
        }

        /// Publishes odometry.
        fn tell(&self) -> Result<(), RobotError> {
            let stamp = Time::from_nanoseconds(self.now());
            self.odometry.send(Odometry::planar(stamp, self.body.pose(), self.body.velocity()))
        }

        fn state(&self) -> State {
            let ([v, omega], [v_ref, omega_ref]) = (self.body.velocity(), self.obeyed());
            State { time: self.body.time(), open: self.clients > 0, enabled: true, v_ref, omega_ref, v, omega }
        }
    }
}
