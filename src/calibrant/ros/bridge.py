"""ROS through a process of the Python that has it: `side.py` and its frames, read by a thread that keeps the newest."""

from __future__ import annotations

import json
import subprocess
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.ros.side import read_frame, write_frame
from calibrant.ros.transport import Event, Info, Transform
from calibrant.tasks.live.camera_config import CameraConfig
from calibrant.tasks.live.picture import Picture

SIDE = Path(__file__).with_name("side.py")
KEPT_PICTURES = 8
"""Of a topic: enough that the newest with a known pose is among them, however slowly tf comes."""
_KEPT_TRANSFORMS = 50_000
_WAIT_S = 0.2
_PATIENCE_S = 20.0
_END_S = 3.0


class Bridge:
    """A `Transport` to ROS 1 or 2. Raises: InputError where there is no such Python, no ROS in it, or no master."""

    def __init__(self, config: CameraConfig) -> None:
        self._pictures: dict[str, deque[Picture]] = {t: deque(maxlen=KEPT_PICTURES) for t in config.pictures}
        self._others: deque[Event] = deque(maxlen=_KEPT_TRANSFORMS)
        self._changed = threading.Condition()
        self._ended = self._closed = False
        self._failed: str | None = None
        self._ready = threading.Event()
        self._out = threading.Lock()
        self._config = config
        asked = {
            "ros": config.ros,
            "name": f"calibrant_{config.name}",
            "images": list(config.pictures),
            "infos": [] if config.camera_info is None else [config.camera_info],
            "show": f"/calibrant/{config.name}/samples",
            "pose": f"/calibrant/{config.name}/pose",
        }
        try:
            self._process = subprocess.Popen(
                [config.python, str(SIDE), json.dumps(asked)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            words = f"{config.python} cannot be run ({error.strerror})"
            raise InputError(f"{words}; name the Python that has ROS: python: in the configuration") from None
        threading.Thread(target=self._listen, daemon=True).start()
        if not self._ready.wait(_PATIENCE_S) or self._failed is not None:
            words = self._failed or f"no answer within {_PATIENCE_S:.0f} s"
            self.close()
            raise InputError(f"ROS {config.ros} by {config.python}: {words}")

    def events(self) -> Sequence[Event] | None:
        """As `Transport.events`."""
        with self._changed:
            if not self._ended and not self._waiting():
                self._changed.wait(_WAIT_S)
            found = [*self._others, *(p for queue in self._pictures.values() for p in queue)]
            self._others.clear()
            for queue in self._pictures.values():
                queue.clear()
            if found or not self._ended:
                return found
            if self._closed:
                return None
            raise InputError(
                f"ROS {self._config.ros} ended: {self._failed or 'its process is gone'}; is it still running?"
            )

    def publish_static(self, transform: Transform) -> None:
        """As `Transport.publish_static`."""
        self._send({"kind": "static", **_words(transform)})

    def publish_live(self, transform: Transform) -> None:
        """As `Transport.publish_live`."""
        self._send({"kind": "live", **_words(transform)})

    def publish_pose(self, transform: Transform, covariance: Array) -> None:
        """As `Transport.publish_pose`."""
        # ROS has the place first, then turns about the parent's axes (REP 103).
        order = [3, 4, 5, 0, 1, 2]
        numbers = [float(v) for v in covariance[np.ix_(order, order)].ravel()]
        self._send({"kind": "pose", **_words(transform), "covariance": numbers})

    def show(self, picture: NDArray[np.uint8], *, frame: str, stamp: float) -> None:
        """As `Transport.show`."""
        height, width = picture.shape[:2]
        header = {"kind": "show", "frame": frame, "stamp": stamp, "width": width, "height": height}
        self._send(header, np.ascontiguousarray(picture).tobytes())

    def close(self) -> None:
        """As `Transport.close`."""
        self._closed = True
        with suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _waiting(self) -> bool:
        return bool(self._others) or any(self._pictures.values())

    def _send(self, header: Mapping[str, Any], payload: bytes = b"") -> None:
        if self._process.stdin is None:
            return
        with self._out, suppress(OSError, ValueError):  # that it has ended, `events` says
            write_frame(self._process.stdin, dict(header), payload)  # type: ignore[arg-type]

    def _listen(self) -> None:
        stream = self._process.stdout
        try:
            while stream is not None and (frame := read_frame(stream)) is not None:  # type: ignore[arg-type]
                self._take(*frame)
        except (OSError, ValueError, KeyError) as error:
            self._failed = f"what came from there is not understood ({error})"
        with self._changed:
            self._ended = True
            self._failed = self._failed or (None if self._ready.is_set() else "it ended at once")
            self._ready.set()
            self._changed.notify_all()

    def _take(self, header: Mapping[str, Any], payload: bytes) -> None:
        kind = header["kind"]
        if kind in ("ready", "failed"):
            self._failed = None if kind == "ready" else str(header["words"])
            self._ready.set()
            return
        with self._changed:
            if kind == "picture" and header["topic"] in self._pictures:
                self._pictures[header["topic"]].append(_picture(header, payload))
            elif kind == "info":
                self._others.append(Info(header["topic"], header["data"]))
            elif kind == "transform":
                self._others.append(_transform(header))
            self._changed.notify_all()


def _picture(header: Mapping[str, Any], payload: bytes) -> Picture:
    numbers = {key: int(header[key]) for key in ("width", "height", "step")}
    return Picture(
        topic=str(header["topic"]), stamp=float(header["stamp"]), frame=str(header["frame"]),
        encoding=str(header["encoding"]), data=np.frombuffer(payload, np.uint8),
        is_bigendian=bool(header["big_endian"]), format=str(header["format"]), **numbers,
    )  # fmt: skip


def _transform(header: Mapping[str, Any]) -> Transform:
    x, y, z, w = (float(v) for v in header["xyzw"])
    T = se3.make(so3.from_quaternion_wxyz([w, x, y, z]), header["xyz"])
    return Transform(str(header["parent"]), str(header["child"]), T, float(header["stamp"]), bool(header["static"]))


def _words(transform: Transform) -> dict[str, Any]:
    w, x, y, z = (float(v) for v in so3.quaternion_wxyz(transform.T_parent_child[:3, :3]))
    place = {"xyz": [float(v) for v in transform.T_parent_child[:3, 3]], "xyzw": [x, y, z, w]}
    return {"parent": transform.parent, "child": transform.child, "stamp": transform.stamp, **place}
