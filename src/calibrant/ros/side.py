"""ROS's side of the node: run by the Python that has rospy or rclpy, it imports nothing of calibrant.

    /usr/bin/python3 side.py '{"ros": 1, "name": "calibrant", "images": [...], "infos": [...], "show": {...}}'

Both sides talk through its standard input and output in frames: the length of a JSON header in four bytes (big endian),
the header, and as many bytes as its "bytes" says.

    out   {"kind": "picture" | "info" | "transform" | "ready" | "failed", …}
    in    {"kind": "static" | "live" | "pose" | "show", …}; when it ends, so does this process

ROS 2's class is written against rclpy's documented interface and tested against a stand-in of it, not on a real one.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import threading
from typing import Any, BinaryIO

LONGEST_HEADER = 1_000_000
LARGEST = 1_000_000_000
_INFO = ("width", "height", "distortion_model", "binning_x", "binning_y")
_MATRICES = (("d", "D"), ("k", "K"), ("r", "R"), ("p", "P"))
COMPRESSED_TOPIC = "compressed"


def write_frame(stream: BinaryIO, header: dict[str, Any], payload: bytes = b"") -> None:
    """One frame."""
    text = json.dumps({**header, "bytes": len(payload)}).encode()
    stream.write(struct.pack(">I", len(text)) + text + payload)
    stream.flush()


def read_frame(stream: BinaryIO) -> tuple[dict[str, Any], bytes] | None:
    """The next frame; None at the end. Raises: ValueError for what is no frame."""
    start = stream.read(4)
    if len(start) < 4:
        return None
    (length,) = struct.unpack(">I", start)
    if length > LONGEST_HEADER:
        raise ValueError(f"a header of {length} bytes")
    header = json.loads(stream.read(length))
    count = int(header["bytes"])
    if not 0 <= count <= LARGEST:
        raise ValueError(f"a frame of {count} bytes")
    payload = stream.read(count) if count else b""
    return None if len(payload) < count else (header, payload)


class Sender:
    """Frames to the other side, from any thread; when that is gone, so are we."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream, self._lock = stream, threading.Lock()

    def __call__(self, header: dict[str, Any], payload: bytes = b"") -> None:
        with self._lock:
            try:
                write_frame(self._stream, header, payload)
            except OSError:
                os._exit(0)

    def picture(self, topic: str, message: Any, stamp: float) -> None:
        """sensor_msgs/Image or CompressedImage, as it is."""
        header: dict[str, Any] = {"kind": "picture", "topic": topic, "stamp": stamp, "frame": message.header.frame_id}
        if hasattr(message, "encoding"):
            header |= {key: getattr(message, key) for key in ("width", "height", "encoding", "step")}
            header |= {"big_endian": bool(message.is_bigendian), "format": ""}
        else:
            header |= {"width": 0, "height": 0, "encoding": "compressed", "step": 0, "big_endian": False}
            header["format"] = str(message.format)
        self(header, bytes(message.data))

    def info(self, topic: str, message: Any) -> None:
        """sensor_msgs/CameraInfo; ROS 1 calls its matrices by capitals."""
        data: dict[str, Any] = {key: getattr(message, key) for key in _INFO}
        for small, capital in _MATRICES:
            values = getattr(message, small) if hasattr(message, small) else getattr(message, capital)
            data[small] = [float(v) for v in values]
        self({"kind": "info", "topic": topic, "data": data})

    def transforms(self, message: Any, stamp_of: Any, *, static: bool) -> None:
        """tf2_msgs/TFMessage."""
        for one in message.transforms:
            t, q = one.transform.translation, one.transform.rotation
            names = {"parent": one.header.frame_id.lstrip("/"), "child": one.child_frame_id.lstrip("/")}
            place = {"xyz": [t.x, t.y, t.z], "xyzw": [q.x, q.y, q.z, q.w]}
            self({"kind": "transform", "stamp": stamp_of(one.header.stamp), "static": static, **names, **place})


def _fill(message: Any, header: dict[str, Any]) -> Any:
    """A TransformStamped of a frame's header, but for its stamp."""
    message.header.frame_id, message.child_frame_id = header["parent"], header["child"]
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = header["xyz"]
    q.x, q.y, q.z, q.w = header["xyzw"]
    return message


def _believe(message: Any, header: dict[str, Any]) -> Any:
    """A PoseWithCovarianceStamped of a frame's header, but for its stamp; the frame it is in is its header's."""
    message.header.frame_id = header["parent"]
    p, q = message.pose.pose.position, message.pose.pose.orientation
    p.x, p.y, p.z = header["xyz"]
    q.x, q.y, q.z, q.w = header["xyzw"]
    message.pose.covariance = [float(v) for v in header["covariance"]]
    return message


def _paint(message: Any, header: dict[str, Any], payload: bytes) -> Any:
    """An Image of a frame, but for its stamp."""
    message.header.frame_id = header["frame"]
    message.width, message.height, message.encoding = header["width"], header["height"], "bgr8"
    message.step, message.is_bigendian, message.data = 3 * header["width"], 0, payload
    return message


class Ros1:
    """rospy: subscriptions, a latched /tf_static, /tf and the picture that shows samples."""

    def __init__(self, asked: dict[str, Any], send: Sender) -> None:
        import rosgraph
        import rospy
        from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image
        from tf2_msgs.msg import TFMessage

        if not rosgraph.is_master_online():
            raise RuntimeError(f"no roscore answers at {os.environ.get('ROS_MASTER_URI', 'http://localhost:11311')}")
        self._rospy, self._transform, self._tf, self._image = rospy, TransformStamped, TFMessage, Image
        rospy.init_node(asked["name"], anonymous=True, disable_signals=True)
        self._static = rospy.Publisher("/tf_static", TFMessage, queue_size=10, latch=True)
        self._live = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._show = rospy.Publisher(asked["show"], Image, queue_size=1)
        self._pose = PoseWithCovarianceStamped
        self._poses = rospy.Publisher(asked["pose"], PoseWithCovarianceStamped, queue_size=10)

        def seconds(stamp: Any) -> float:
            return float(stamp.to_sec())

        def picture(message: Any, topic: str) -> None:
            send.picture(topic, message, seconds(message.header.stamp))

        def transforms(message: Any, static: bool) -> None:
            send.transforms(message, seconds, static=static)

        for topic in asked["images"]:
            kind = CompressedImage if topic.endswith(COMPRESSED_TOPIC) else Image
            rospy.Subscriber(topic, kind, picture, callback_args=topic, queue_size=1, buff_size=2**26)
        for topic in asked["infos"]:
            rospy.Subscriber(topic, CameraInfo, lambda m, at: send.info(at, m), callback_args=topic, queue_size=1)
        for topic, static in (("/tf", False), ("/tf_static", True)):
            rospy.Subscriber(topic, TFMessage, transforms, callback_args=static, queue_size=200)

    def handle(self, header: dict[str, Any], payload: bytes) -> None:
        """Publish what a frame says."""
        stamp = self._rospy.Time.from_sec(header["stamp"])
        if header["kind"] == "show":
            message = _paint(self._image(), header, payload)
            message.header.stamp = stamp
            self._show.publish(message)
            return
        if header["kind"] == "pose":
            message = _believe(self._pose(), header)
            message.header.stamp = stamp
            self._poses.publish(message)
            return
        message = _fill(self._transform(), header)
        message.header.stamp = stamp
        (self._static if header["kind"] == "static" else self._live).publish(self._tf([message]))

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("calibrant has ended")


class Ros2:
    """rclpy: the same with quality of service; not run on a real ROS 2 yet."""

    def __init__(self, asked: dict[str, Any], send: Sender) -> None:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
        from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
        from sensor_msgs.msg import CameraInfo, CompressedImage, Image
        from tf2_msgs.msg import TFMessage

        self._rclpy, self._transform, self._tf, self._image = rclpy, TransformStamped, TFMessage, Image
        rclpy.init()
        self._node = node = rclpy.create_node(asked["name"])
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._static = node.create_publisher(TFMessage, "/tf_static", latched)
        self._live = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self._show = node.create_publisher(Image, asked["show"], 1)
        self._pose = PoseWithCovarianceStamped
        self._poses = node.create_publisher(PoseWithCovarianceStamped, asked["pose"], QoSProfile(depth=10))

        def seconds(stamp: Any) -> float:
            return float(stamp.sec) + 1e-9 * float(stamp.nanosec)

        def listen(kind: Any, topic: str, call: Any, profile: Any) -> None:
            node.create_subscription(kind, topic, call, profile)

        for topic in asked["images"]:
            kind = CompressedImage if topic.endswith(COMPRESSED_TOPIC) else Image
            listen(
                kind, topic, lambda m, at=topic: send.picture(at, m, seconds(m.header.stamp)), qos_profile_sensor_data
            )
        for topic in asked["infos"]:
            listen(CameraInfo, topic, lambda m, at=topic: send.info(at, m), qos_profile_sensor_data)
        listen(TFMessage, "/tf", lambda m: send.transforms(m, seconds, static=False), QoSProfile(depth=100))
        listen(TFMessage, "/tf_static", lambda m: send.transforms(m, seconds, static=True), latched)
        threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()

    def handle(self, header: dict[str, Any], payload: bytes) -> None:
        """Publish what a frame says."""
        kind = header["kind"]
        if kind == "show":
            message = _paint(self._image(), header, payload)
        else:
            message = _believe(self._pose(), header) if kind == "pose" else _fill(self._transform(), header)
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(round(1e9 * header["stamp"]), 10**9)
        if kind in ("show", "pose"):
            (self._show if kind == "show" else self._poses).publish(message)
            return
        (self._static if header["kind"] == "static" else self._live).publish(self._tf(transforms=[message]))

    def close(self) -> None:
        """Leave ROS."""
        self._rclpy.shutdown()


def main(asked: dict[str, Any]) -> int:
    """Bring frames both ways until the other side ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what ROS prints is for people, not for the other side
    send = Sender(out)
    try:
        ros = (Ros1 if asked["ros"] == 1 else Ros2)(asked, send)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other side says it to the person
        send({"kind": "failed", "words": f"{type(error).__name__}: {error}"})
        return 1
    send({"kind": "ready"})
    while True:
        frame = read_frame(sys.stdin.buffer)
        if frame is None:
            ros.close()
            return 0
        ros.handle(*frame)


if __name__ == "__main__":
    sys.exit(main(json.loads(sys.argv[1])))
