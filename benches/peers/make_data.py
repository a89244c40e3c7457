"""Writes the recordings that the benchmarks read: CSV of 3e3, 1e5 and 1e6 rows, and an MCAP of 1e6 messages.

    python3 benches/peers/make_data.py FOLDER

Needs numpy, scipy and mcap. The robot is the thesis' simulation model, sampled at 20 Hz from an exact zero-order-hold step
of its linear part with the quadratic terms held over sub-steps of 5 ms, with white noise of 0.005.
"""

import pathlib
import struct
import sys

import numpy as np

THETA = [0.2604, 0.2509, -0.0004, 0.9965, 0.0026, 1.0768]


def commands(t):
    v_ref = 0.4 + 0.1 * (np.sin(2 * t) + np.sin(t) + np.sin(t / 3) + np.sin(t / 11))
    omega_ref = 0.75 + 0.25 * (np.sin(1.5 * t) + np.sin(t) + np.sin(t / 2) + np.sin(t / 5))
    return v_ref, omega_ref


def simulate(rows, period=0.05, substeps=10):
    t1, t2, t3, t4, t5, t6 = THETA
    time = np.arange(rows) * period
    v_ref, omega_ref = commands(time)
    ev, ew = np.exp(-t4 / t1 * period / substeps), np.exp(-t6 / t2 * period / substeps)
    out = np.zeros((rows, 2))
    v = w = 0.0
    for k in range(rows - 1):
        for _ in range(substeps):
            qv, qw = v_ref[k] + t3 * w * w, omega_ref[k] - t5 * v * w
            v, w = qv / t4 + (v - qv / t4) * ev, qw / t6 + (w - qw / t6) * ew
        out[k + 1] = v, w
    return time, v_ref, omega_ref, out


def write_csv(path, rows, rng):
    time, v_ref, omega_ref, out = simulate(rows)
    out = out + 0.005 * rng.standard_normal(out.shape)
    table = np.column_stack([time, v_ref, omega_ref, out])
    np.savetxt(path, table, delimiter=",", header="t,v_ref,omega_ref,v,omega", comments="", fmt="%.6f")
    return table


def definition(*parts):
    """A ROS 2 definition: the message's own fields, then those of every message it holds."""
    first, *rest = parts
    return ("\n" + "=" * 80 + "\n").join([first] + [f"MSG: {name}\n{fields}" for name, fields in rest]).encode()


VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")
TWIST_FIELDS = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular"
TWIST = definition(TWIST_FIELDS, VECTOR)
ODOMETRY = definition(
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
    ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"),
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec"),
    ("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance"),
    ("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z"),
    ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
    ("geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist twist\nfloat64[36] covariance"),
    ("geometry_msgs/Twist", TWIST_FIELDS),
    VECTOR,
)


def write_mcap(path, table, messages):
    from mcap.writer import CompressionType, Writer

    with open(path, "wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "make_data")
        twist = writer.register_schema("geometry_msgs/msg/Twist", "ros2msg", TWIST)
        odometry = writer.register_schema("nav_msgs/msg/Odometry", "ros2msg", ODOMETRY)
        cmd = writer.register_channel("/cmd_vel", "cdr", twist)
        odom = writer.register_channel("/odom", "cdr", odometry)
        head = b"\x00\x01\x00\x00"
        start = 1_700_000_000_000_000_000
        for k in range(messages // 2):
            row = table[k % len(table)]
            now = start + 50_000_000 * k
            data = head + struct.pack("<6d", row[1], 0, 0, 0, 0, row[2])
            writer.add_message(cmd, now, data, now)
            # stamp, "odom\0" at 4-byte alignment, "base\0", padding to 8, pose, covariance, twist, covariance
            body = struct.pack("<iI", now // 10**9, now % 10**9)
            body += struct.pack("<I", 5) + b"odom\0" + b"\0" * 3 + struct.pack("<I", 5) + b"base\0"
            body += b"\0" * (-len(body) % 8)
            body += struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1) + bytes(288)
            body += struct.pack("<6d", row[3], 0, 0, 0, 0, row[4]) + bytes(288)
            writer.add_message(odom, now, head + body, now)
        writer.finish()


if __name__ == "__main__":
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    for rows in (3_000, 100_000, 1_000_000):
        table = write_csv(folder / f"{rows}.csv", rows, rng)
    write_mcap(folder / "million.mcap", table, 1_000_000)
