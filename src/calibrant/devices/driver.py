"""What a driver is to the register: its name, what it gives, and how it opens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from calibrant.data.devices import CameraSource, Robot
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import InputError


def _nothing() -> None:
    """Nothing to let go of."""


@dataclass(frozen=True, eq=False)
class Opened:
    """Devices that were opened together: a robot, where there is one, and cameras by name.

    looks: the camera that is taken where none is named; release: lets go of what the cameras' `close` does not.
    """

    robot: Robot | None = None
    cameras: Mapping[str, CameraSource] = field(default_factory=dict)
    looks: str = ""
    release: Callable[[], None] = _nothing

    def camera(self, name: str | None, *, source: str) -> CameraSource:
        """The camera of that name, or the only one. Raises: InputError listing the names."""
        chosen = name or self.looks or (next(iter(self.cameras)) if len(self.cameras) == 1 else "")
        if chosen in self.cameras:
            return self.cameras[chosen]
        listed = ", ".join(self.cameras) or "none"
        if name is None:
            raise InputError(f"{source} has several cameras: {listed}; name one with camera=NAME")
        raise InputError(f"{source} has no camera {name!r}; it has {listed}")


@dataclass(frozen=True)
class Driver:
    """A kind of device.

    name: what a spec begins with; form: of a spec; gives: what it can be, "robot", "camera"; says: one line for people;
    tested: against what; keys: of its options, where `camera` chooses one of several; extra: what must be installed.
    """

    name: str
    form: str
    gives: tuple[str, ...]
    says: str
    tested: str
    connect: Callable[[DeviceSpec], Opened]
    keys: tuple[str, ...] = ()
    extra: str = ""
