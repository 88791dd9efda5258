"""The drivers by name, and devices opened by what names them.

    with open_devices(robot="cell:seed=3", camera="cell:camera=wrist") as devices:
        devices.robot.move_to(devices.robot.pose())
        picture = devices.camera.take()

Robot and camera of one driver and one place are opened together, once: they are one cell, or one recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib import import_module

from calibrant.data.devices import CameraSource, Robot
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.spec import DeviceSpec, split_spec
from calibrant.errors import InputError

_ROOM = "calibrant.devices"
MODULES: Mapping[str, str] = {
    "cell": "simulated_cell",
    "folder": "recorded.folder",
    "bag": "recorded.bag",
    "project": "recorded.project",
    "opencv": "opencv_camera",
    "ur": "universal_robots",
    "panda": "franka",
    "realsense": "realsense",
}
"""A driver's name and the file that has it as DRIVER: to add one is a line here."""

CAMERA = "camera"
"""The option by which a camera is chosen where a place has several."""


def drivers() -> Iterator[Driver]:
    """Every driver; a maker's library is loaded when a device is opened."""
    return (driver_named(name) for name in MODULES)


def driver_named(name: str) -> Driver:
    """The driver of that name. Raises: InputError listing the names."""
    if name not in MODULES:
        raise InputError(
            f"there is no device called {name!r}; a spec begins with a driver's name: {', '.join(MODULES)}"
        )
    driver: Driver = import_module(f"{_ROOM}.{MODULES[name]}").DRIVER
    return driver


def parse_spec(text: str, *, gives: str | None = None) -> DeviceSpec:
    """A spec checked against its driver. gives: "robot" or "camera", what it must be.

    Raises: InputError for an unknown driver or option, or a camera where a robot is asked for.
    """
    spec = split_spec(text)
    driver = driver_named(spec.driver)
    unknown = [key for key in spec.options if key not in driver.keys]
    if unknown:
        known = ", ".join(driver.keys) or "none"
        raise InputError(f"{text}: {driver.name} has no option {unknown[0]!r}; its options: {known} ({driver.form})")
    if gives is not None and gives not in driver.gives:
        others = ", ".join(d.name for d in drivers() if gives in d.gives)
        raise InputError(f"{text}: {driver.name} is no {gives}, it is {driver.says}; drivers of a {gives}: {others}")
    return spec


@dataclass(eq=False)
class Devices:
    """A robot and a camera, as far as they were asked for. A context manager: leaving it lets go of both."""

    _robot: Robot | None
    _camera: CameraSource | None
    _stack: ExitStack

    @property
    def robot(self) -> Robot:
        """Raises: InputError where none was opened."""
        if self._robot is None:
            raise InputError("no robot was opened: name one, such as cell or ur:192.168.0.10")
        return self._robot

    @property
    def camera(self) -> CameraSource:
        """Raises: InputError where none was opened."""
        if self._camera is None:
            raise InputError("no camera was opened: name one, such as cell, opencv:0 or realsense")
        return self._camera

    def __enter__(self) -> Devices:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """The robot stands still, and both are let go of; nothing happens the second time."""
        self._stack.close()


def open_devices(*, robot: str | None = None, camera: str | None = None) -> Devices:
    """Open a robot, a camera or both by their specs.

    Raises: InputError for a spec that cannot be; DeviceError for a device that does not answer; MissingExtraError
    without the library of its maker.

        >>> from calibrant.devices.register import open_devices
        >>> with open_devices(robot="cell:seed=3", camera="cell:camera=top") as devices:  # doctest: +SKIP
        ...     devices.camera.take().size
        (640, 480)
    """
    arm = None if robot is None else parse_spec(robot, gives="robot")
    eye = None if camera is None else parse_spec(camera, gives="camera")
    if arm is not None and eye is not None and (arm.driver, arm.place) == (eye.driver, eye.place):
        arm = eye = _as_one(arm, eye)
    stack = ExitStack()
    try:
        moving = None if arm is None else _opened(arm, stack)
        seeing = moving if eye is arm else None if eye is None else _opened(eye, stack)
        found, source = None, None
        if arm is not None and moving is not None:
            found = moving.robot
            if found is None:
                raise InputError(f"{arm.text}: there is no robot in it: {_what_lacks(arm)}")
            stack.callback(found.stop)
        if eye is not None and seeing is not None:
            source = seeing.camera(eye.options.get(CAMERA), source=eye.text)
    except BaseException:
        stack.close()
        raise
    return Devices(found, source, stack)


def _opened(spec: DeviceSpec, stack: ExitStack) -> Opened:
    opened = driver_named(spec.driver).connect(spec)
    stack.callback(opened.release)
    for source in opened.cameras.values():
        stack.callback(source.close)
    return opened


def _as_one(arm: DeviceSpec, eye: DeviceSpec) -> DeviceSpec:
    """One spec of both. Raises: InputError where they say different things of the same place."""
    for key, value in eye.without(CAMERA).items():
        if arm.options.get(key, value) != value:
            raise InputError(
                f"{arm.text} and {eye.text} are one {arm.driver}, and say {key}={arm.options[key]} and {key}={value}; "
                "say the same in both, or say it once"
            )
    return replace(arm, options={**arm.options, **eye.options})


def _what_lacks(spec: DeviceSpec) -> str:
    if spec.driver == "project":
        return "its observations have no robot poses"
    return "give the poses of its pictures, poses=FILE"
