"""Reads every Twist and Odometry of a bag with rosbags, as `wheelwright inspect` does.

    python3 benches/peers/read_bag.py FILE.mcap
"""

import pathlib
import sys

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def read(path):
    count, total = 0, 0.0
    with AnyReader([pathlib.Path(path)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            twist = message.twist.twist if connection.msgtype.endswith("Odometry") else message
            total += twist.linear.x + twist.angular.z
            count += 1
    return count, total


if __name__ == "__main__":
    print(*read(sys.argv[1]))
