"""Small bags for tests, written by rosbags: pictures, camera_info, transforms and joint values of ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.geometry import so3

pytest.importorskip("rosbags", reason="bags are written by rosbags: pip install 'calibrant[ros]'")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("ros1", "mcap", "sqlite3")
TRANSFORMS = "tf2_msgs/msg/TFMessage"
EPOCH_NS = 1_700_000_000_000_000_000


class BagWriter:
    """Writes messages by topic. Times are seconds since the recording began."""

    def __init__(self, writer: Any, store: Any, *, ros1: bool) -> None:
        self.writer, self.store, self.ros1 = writer, store, ros1
        self.connections: dict[str, Any] = {}

    def write(self, topic: str, message: Any, t: float) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        to_bytes = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        self.writer.write(self.connections[topic], nanoseconds(t), to_bytes(message, kind))

    def header(self, t: float | None, frame: str = "") -> Any:
        ns = 0 if t is None else nanoseconds(t)
        stamp = self.type("builtin_interfaces/msg/Time")(sec=ns // 10**9, nanosec=ns % 10**9)
        seq = {"seq": 0} if self.ros1 else {}
        return self.type("std_msgs/msg/Header")(stamp=stamp, frame_id=frame, **seq)

    def type(self, name: str) -> Any:
        return self.store.types[name]

    def image(self, topic: str, picture: NDArray, t: float, encoding: str, *, stamp: float | None = -1.0) -> None:
        """A raw picture, its rows as they are in the array; received at t, stamped so too unless told."""
        rows = np.ascontiguousarray(picture)
        h, w = rows.shape[:2]
        message = self.type("sensor_msgs/msg/Image")(
            header=self.header(t if stamp == -1.0 else stamp, "camera"),
            height=h, width=w, encoding=encoding, is_bigendian=int(rows.dtype.byteorder == ">"),
            step=rows.nbytes // h, data=rows.view(np.uint8).ravel(),
        )  # fmt: skip
        self.write(topic, message, t)

    def compressed(
        self, topic: str, picture: NDArray, t: float, form: str = "bgr8; png compressed ", *, stamp: float = -1.0
    ) -> None:
        ending = ".jpg" if "jpeg" in form else ".png"
        data = np.frombuffer(cv2.imencode(ending, picture)[1].tobytes(), np.uint8)
        header = self.header(t if stamp == -1.0 else stamp, "camera")
        self.write(topic, self.type("sensor_msgs/msg/CompressedImage")(header=header, format=form, data=data), t)

    def transforms(self, topic: str, T: Mapping[tuple[str, str], NDArray], t: float, *, stamp: float = -1.0) -> None:
        """Transforms T_parent_child by (parent, child)."""
        made = []
        for (parent, child), matrix in T.items():
            w, x, y, z = so3.quaternion_wxyz(matrix[:3, :3])
            place = self.type("geometry_msgs/msg/Transform")(
                translation=self.type("geometry_msgs/msg/Vector3")(*map(float, matrix[:3, 3])),
                rotation=self.type("geometry_msgs/msg/Quaternion")(*map(float, (x, y, z, w))),
            )
            header = self.header(t if stamp == -1.0 else stamp, parent)
            made.append(
                self.type("geometry_msgs/msg/TransformStamped")(header=header, child_frame_id=child, transform=place)
            )
        self.write(topic, self.type(TRANSFORMS)(transforms=made), t)

    def joints(self, topic: str, values: Mapping[str, float], t: float) -> None:
        nothing = np.zeros(0)
        message = self.type("sensor_msgs/msg/JointState")(
            header=self.header(t), name=list(values), position=np.array(list(values.values()), float),
            velocity=nothing, effort=nothing,
        )  # fmt: skip
        self.write(topic, message, t)

    def camera_info(self, topic: str, K: NDArray, D: Sequence[float], size: tuple[int, int], t: float) -> None:
        cls = self.type("sensor_msgs/msg/CameraInfo")
        P = np.concatenate([K, np.zeros((3, 1))], axis=1)
        arrays = {"d": np.array(D, float), "k": K.ravel(), "r": np.eye(3).ravel(), "p": P.ravel()}
        arrays = {k.upper(): v for k, v in arrays.items()} if self.ros1 else arrays
        roi = self.type("sensor_msgs/msg/RegionOfInterest")(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        message = cls(
            header=self.header(t), height=size[1], width=size[0], distortion_model="plumb_bob", **arrays,
            binning_x=0, binning_y=0, roi=roi,
        )  # fmt: skip
        self.write(topic, message, t)


def nanoseconds(t: float) -> int:
    return EPOCH_NS + round(t * 1e9)


@contextmanager
def written_bag(folder: Path, kind: str, *, compressed: bool = False) -> Iterator[tuple[Path, BagWriter]]:
    """The path of a bag (ROS 2: its folder) and what writes it."""
    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    if TRANSFORMS not in store.fielddefs:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", TRANSFORMS))
    if kind == "ros1":
        path = folder / "run.bag"
        writer1 = Writer1(path)
        if compressed:
            writer1.set_compression(Writer1.CompressionFormat.BZ2)
        with writer1:
            yield path, BagWriter(writer1, store, ros1=True)
        return
    path = folder / "run"
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer2:
        yield path, BagWriter(writer2, store, ros1=False)
