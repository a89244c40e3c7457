"""The other end of a ROS 2 robot's topics, by Eclipse Cyclone DDS (PyPI: cyclonedds), which shares no code with ours.

`peer.py robot` plays a robot of first order and prints each command that reaches it; `peer.py client` drives a robot and prints
its odometry. One JSON object a line; both end with their standard input.
"""

import argparse
import json
import math
import sys
import threading
import time
from dataclasses import dataclass, field

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose = field(default_factory=Pose)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist = field(default_factory=Twist)
    covariance: array[float64, 36] = field(default_factory=lambda: [0.0] * 36)


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


COMMANDS = {"twist": Twist, "twist-stamped": TwistStamped}
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))


def say(**values):
    print(json.dumps(values), flush=True)


def stamp(nanoseconds):
    return Time(nanoseconds // 10**9, nanoseconds % 10**9)


def velocity(command):
    twist = getattr(command, "twist", command)
    return twist.linear.x, twist.angular.z


def ended():
    """An event that is set when the standard input ends."""
    event = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), event.set()), daemon=True).start()
    return event


def newest(reader):
    """What has come since the last time."""
    return [sample for sample in reader.take(N=100) if sample.sample_info.valid_data]


class Robot:
    """v and omega follow their commands by lags of first order; x, y and phi follow them."""

    def __init__(self, lags, period):
        self.decay = [math.exp(-period / lag) for lag in lags]
        self.lags, self.period = lags, period
        self.velocity, self.command = [0.0, 0.0], [0.0, 0.0]
        self.x = self.y = self.phi = 0.0

    def advance(self):
        path = [0.0, 0.0]
        for i in range(2):
            away = self.velocity[i] - self.command[i]
            path[i] = self.command[i] * self.period + away * self.lags[i] * (1.0 - self.decay[i])
            self.velocity[i] = self.command[i] + away * self.decay[i]
        heading = self.phi + 0.5 * path[1]
        self.x += path[0] * math.cos(heading)
        self.y += path[0] * math.sin(heading)
        self.phi += path[1]

    def odometry(self, nanoseconds):
        message = Odometry(header=Header(stamp(nanoseconds), "odom"), child_frame_id="base_link")
        pose = message.pose.pose
        pose.position = Point(self.x, self.y, 0.0)
        pose.orientation = Quaternion(z=math.sin(0.5 * self.phi), w=math.cos(0.5 * self.phi))
        message.twist.twist.linear.x, message.twist.twist.angular.z = self.velocity
        return message


def play_robot(options):
    participant = DomainParticipant(options.domain)
    kind = COMMANDS[options.type]
    reader = DataReader(participant, Topic(participant, "rt/cmd_vel", kind), qos=RELIABLE)
    quality = BEST_EFFORT if options.best_effort else RELIABLE
    writer = DataWriter(participant, Topic(participant, "rt/odom", Odometry), qos=quality)
    robot = Robot(options.lags, options.period)
    if options.lockstep:
        return step_robot(options, robot, reader, writer)
    end, begin, told, cycle, published = ended(), int(1e9 * options.clock), None, 0, 0
    start = last = time.monotonic()
    say(ready=True)
    while not end.is_set():
        cycle += 1
        time.sleep(max(0.0, start + cycle * options.period - time.monotonic()))
        faulty = options.fault is not None and told is not None and cycle - told > options.after
        for command in newest(reader):
            robot.command = list(velocity(command))
            told = told or cycle
            age = begin + 1e9 * cycle * options.period - stamp_of(command)
            say(command=robot.command, silence=time.monotonic() - last, faulty=faulty, age=1e-9 * age)
        robot.advance()
        if not (faulty and options.fault == "silent"):
            now = begin + int(1e9 * options.period) * (cycle if not options.no_stamps else 0)
            frozen = faulty and options.fault == "frozen"
            message = sent if frozen else robot.odometry(now)
            message.header.stamp = stamp(now)
            writer.write(message)
            sent, published = message, published + 1
            if not faulty:
                last = time.monotonic()
    say(velocity=robot.velocity, published=published)


def step_robot(options, robot, reader, writer):
    """A cycle passes for each command, and only then."""
    end, cycle, idle = ended(), 0, 0
    say(ready=True)
    while not end.is_set():
        commands = newest(reader)
        for command in commands:
            robot.command = list(velocity(command))
            robot.advance()
            cycle += 1
        idle = 0 if commands else idle + 1
        if idle % 50 == 0:
            writer.write(robot.odometry(10**9 + int(1e9 * options.period) * cycle))
        if not commands:
            time.sleep(0.001)
    say(velocity=robot.velocity, published=cycle)


def stamp_of(command):
    header = getattr(command, "header", None)
    return header.stamp.sec * 10**9 + header.stamp.nanosec if header else 0


def play_client(options):
    participant = DomainParticipant(options.domain)
    kind = COMMANDS[options.type]
    writer = DataWriter(participant, Topic(participant, "rt/cmd_vel", kind), qos=RELIABLE)
    reader = DataReader(participant, Topic(participant, "rt/odom", Odometry), qos=BEST_EFFORT)
    end, left = ended(), options.commands
    say(ready=True)
    while not end.is_set():
        for odometry in newest(reader):
            pose = odometry.pose.pose
            say(
                t=odometry.header.stamp.sec + 1e-9 * odometry.header.stamp.nanosec,
                velocity=velocity(odometry.twist),
                x=pose.position.x,
                phi=2.0 * math.atan2(pose.orientation.z, pose.orientation.w),
                frames=[odometry.header.frame_id, odometry.child_frame_id],
            )
        if left > 0 and writer.get_matched_subscriptions():
            left -= 1
            twist = Twist(Vector3(options.velocity[0]), Vector3(0.0, 0.0, options.velocity[1]))
            header = Header(stamp(time.time_ns() - int(1e9 * options.old)), "base_link")
            writer.write(twist if kind is Twist else TwistStamped(header, twist))
        time.sleep(options.period)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", choices=["robot", "client"])
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--type", choices=sorted(COMMANDS), default="twist")
    parser.add_argument("--period", type=float, default=0.02, help="of odometry or commands [s]")
    parser.add_argument("--lags", type=float, nargs=2, default=[0.2, 0.15], help="of v and omega [s]")
    parser.add_argument("--lockstep", action="store_true", help="a robot whose time passes by one period for each command")
    parser.add_argument("--best-effort", action="store_true", help="odometry that is not sent again when lost")
    parser.add_argument("--clock", type=float, default=time.time(), help="the robot's, at the start [s]")
    parser.add_argument("--no-stamps", action="store_true", help="odometry whose stamps stand still")
    parser.add_argument("--fault", choices=["silent", "frozen"], help="what happens to the odometry")
    parser.add_argument("--after", type=int, default=0, help="cycles from the first command to the fault")
    parser.add_argument("--velocity", type=float, nargs=2, default=[0.3, 0.2], help="what a client commands [m/s rad/s]")
    parser.add_argument("--commands", type=int, default=50, help="how often a client commands it")
    parser.add_argument("--old", type=float, default=0.0, help="age of a client's stamps [s]")
    options = parser.parse_args()
    play_robot(options) if options.role == "robot" else play_client(options)


if __name__ == "__main__":
    main()
