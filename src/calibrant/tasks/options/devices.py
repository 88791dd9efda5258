"""Options of commands that read a camera or move a robot: simulated, recorded or real, all by a spec."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import RefusedError
from calibrant.tasks.options.option import Option

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibrant.data.devices import Robot
    from calibrant.detection.live import Frame
    from calibrant.devices import Devices
    from calibrant.tasks.listener import Listener

MOMENT_S = 0.5
"""Pictures that follow each other within this are of a camera that runs: what they show may move between them."""


@dataclass(frozen=True, kw_only=True)
class CameraDeviceOptions:
    """A camera that gives pictures while the command runs."""

    camera_device: Annotated[str | None, Option("SPEC")] = None
    """Camera: opencv:0, realsense:SERIAL, cell:camera=top, folder:DIR, bag:FILE … (docs/devices.md)."""

    def opened_camera(self) -> Devices:
        """The camera. Raises: as `open_devices`."""
        from calibrant.devices import open_devices

        return open_devices(camera=self.camera_device)

    def frames(self, listener: Listener) -> Iterator[Frame]:
        """Its pictures in grey, until the camera is gone or the recording has ended: that is noted, and no error."""
        from calibrant.detection.images.images import to_grey8
        from calibrant.detection.live import Frame
        from calibrant.errors import DeviceError

        with self.opened_camera() as devices:
            before = float("-inf")
            while True:
                try:
                    picture = devices.camera.take()
                except DeviceError as error:
                    listener.note(str(error))
                    return
                yield Frame(picture.name, to_grey8(picture.colour), running=picture.time_s - before < MOMENT_S)
                before = picture.time_s


@dataclass(frozen=True, kw_only=True)
class DeviceOptions(CameraDeviceOptions):
    """A robot that moves and a camera that looks, while the command runs."""

    robot_device: Annotated[str | None, Option("SPEC")] = None
    """Robot: ur:192.168.0.10, panda:ADDRESS, cell:seed=3 … (docs/devices.md)."""
    yes: bool = False
    """Let a robot that could hit something move without asking."""

    def opened(self) -> Devices:
        """Both, as far as they are named. Raises: as `open_devices`."""
        from calibrant.devices import open_devices

        return open_devices(robot=self.robot_device, camera=self.camera_device)

    def confirm(self, robot: Robot, words: str, listener: Listener) -> None:
        """Ask before a robot moves that could hit something. words: what it will do.

        Raises: RefusedError where it is not confirmed, or nobody can be asked; nothing has moved then.
        """
        if self.yes or not robot.moves_matter:
            return
        if not listener.ask(f"{robot.name}: {words}. Is the way free, and a hand on the stop? Move it"):
            raise RefusedError(
                f"{robot.name}: {words}. Not confirmed: the arm has not moved. Answer y when it is asked, or give --yes"
            )
