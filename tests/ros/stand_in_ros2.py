"""A stand-in of rclpy's documented interface and of the messages that the node uses: it runs a script with them.

    python stand_in_ros2.py SCRIPT ARGUMENTS…

It plays one message of each kind to whoever subscribes, and writes down what is published in the file STAND_IN_LOG. As
rclpy.init, create_node, Node.create_publisher and create_subscription, spin and shutdown are documented for ROS 2.
"""

import json
import os
import runpy
import sys
import time
from enum import StrEnum
from types import ModuleType, SimpleNamespace


class Stamp:
    def __init__(self):
        self.sec, self.nanosec = 0, 0


class Header:
    def __init__(self):
        self.stamp, self.frame_id = Stamp(), ""


class Vector3:
    def __init__(self):
        self.x = self.y = self.z = 0.0


class Quaternion(Vector3):
    def __init__(self):
        super().__init__()
        self.w = 1.0


class Transform:
    def __init__(self):
        self.translation, self.rotation = Vector3(), Quaternion()


class TransformStamped:
    def __init__(self):
        self.header, self.child_frame_id, self.transform = Header(), "", Transform()


class PoseWithCovarianceStamped:
    """As geometry_msgs has it: header, and pose with a pose and 36 numbers, row by row."""

    def __init__(self):
        self.header, self.pose = Header(), SimpleNamespace(pose=None, covariance=[0.0] * 36)
        self.pose.pose = SimpleNamespace(position=Vector3(), orientation=Quaternion())


class Image:
    def __init__(self):
        self.header, self.height, self.width, self.encoding = Header(), 0, 0, ""
        self.is_bigendian, self.step, self.data = 0, 0, b""


class CompressedImage:
    def __init__(self):
        self.header, self.format, self.data = Header(), "", b""


class CameraInfo:
    def __init__(self):
        self.header, self.height, self.width, self.distortion_model = Header(), 0, 0, ""
        self.d, self.k, self.r, self.p = [], [0.0] * 9, [0.0] * 9, [0.0] * 12
        self.binning_x = self.binning_y = 0


class TFMessage:
    def __init__(self, *, transforms=()):
        self.transforms = list(transforms)


class DurabilityPolicy(StrEnum):
    TRANSIENT_LOCAL = "TRANSIENT_LOCAL"
    VOLATILE = "VOLATILE"


class QoSProfile:
    def __init__(self, *, depth, durability=DurabilityPolicy.VOLATILE):
        self.depth, self.durability = depth, durability


qos_profile_sensor_data = QoSProfile(depth=5)


_running = []


class Publisher:
    def __init__(self, kind, topic, profile):
        self.kind, self.topic = kind, topic
        self.latched = isinstance(profile, QoSProfile) and profile.durability == "TRANSIENT_LOCAL"

    def publish(self, message):
        if not isinstance(message, self.kind):
            raise TypeError(f"{self.topic}: a {type(message).__name__}")
        said = {"topic": self.topic, "latched": self.latched}
        if self.kind is TFMessage:
            one = message.transforms[0]
            t, q = one.transform.translation, one.transform.rotation
            said |= {"parent": one.header.frame_id, "child": one.child_frame_id}
            said |= {"place": [t.x, t.y, t.z, q.x, q.y, q.z, q.w]}
        elif self.kind is PoseWithCovarianceStamped:
            one = message
            p, q = one.pose.pose.position, one.pose.pose.orientation
            said |= {"frame": one.header.frame_id, "covariance": list(one.pose.covariance)}
            said |= {"place": [p.x, p.y, p.z, q.x, q.y, q.z, q.w]}
        else:
            one = message
            said |= {"size": [message.width, message.height, message.step], "bytes": len(message.data)}
        said["stamp"] = [one.header.stamp.sec, one.header.stamp.nanosec]
        with open(os.environ["STAND_IN_LOG"], "a", encoding="utf-8") as log:
            log.write(json.dumps(said) + "\n")


class Node:
    def __init__(self, name):
        self.name, self.subscriptions = name, []

    def create_publisher(self, msg_type, topic, qos_profile):
        return Publisher(msg_type, topic, qos_profile)

    def create_subscription(self, msg_type, topic, callback, qos_profile):
        self.subscriptions.append((msg_type, topic, callback))
        return self.subscriptions[-1]


def init(*, args=None):
    _running.append(True)


def create_node(node_name):
    return Node(node_name)


def spin(node):
    for kind, topic, callback in node.subscriptions:
        callback(_example(kind, topic))
    while _running:
        time.sleep(0.05)


def shutdown():
    _running.clear()


def _example(kind, topic):
    if kind is TFMessage:
        one = TransformStamped()
        one.header.frame_id, one.child_frame_id = ("base", "/tool0") if topic == "/tf" else ("tool0", "bracket")
        one.header.stamp.sec, one.header.stamp.nanosec = 12, 500_000_000
        one.transform.translation.x, one.transform.rotation.w = 0.25, 1.0
        return TFMessage(transforms=[one])
    message = kind()
    message.header.stamp.sec, message.header.frame_id = 12, "wrist_optical"
    if kind is CameraInfo:
        message.width, message.height, message.distortion_model = 4, 2, "plumb_bob"
        message.k, message.d = [2.0, 0.0, 1.5, 0.0, 2.0, 0.5, 0.0, 0.0, 1.0], [0.0] * 5
    elif kind is CompressedImage:
        message.format, message.data = "png", b"none"
    elif kind is Image:
        message.width, message.height, message.step, message.encoding = 4, 2, 5, "mono8"
        message.data = bytes(range(10))
    return message


def module(name, **names):
    made = ModuleType(name)
    vars(made).update(names)
    sys.modules[name] = made
    return made


def main():
    qos = module(
        "rclpy.qos",
        DurabilityPolicy=DurabilityPolicy,
        QoSProfile=QoSProfile,
        qos_profile_sensor_data=qos_profile_sensor_data,
    )
    module("rclpy", init=init, create_node=create_node, spin=spin, shutdown=shutdown, qos=qos)
    messages = {
        "geometry_msgs": {
            "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
            "TransformStamped": TransformStamped,
        },
        "sensor_msgs": {"Image": Image, "CompressedImage": CompressedImage, "CameraInfo": CameraInfo},
        "tf2_msgs": {"TFMessage": TFMessage},
    }
    for package, names in messages.items():
        module(package, msg=module(f"{package}.msg", **names))
    del sys.argv[0]
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
