"""`calibrant ros run`: one camera's node beside a running robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.cancel import answered
from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.live.camera_config import CameraConfig, read_config
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.ros.transport import Transport

EXAMPLE = 'cb.ros_run("wrist.yaml")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate a camera beside a running robot, through ROS.

    calibrant ros run wrist.yaml

    Takes samples by itself whenever robot and board stand still, shows them on /calibrant/NAME/samples, calibrates,
    publishes the camera as a static transform, and goes on doing so until Ctrl-C. A configuration with `through` is
    of a camera that is located live by the dynamic method. See docs/ros.md.
    """

    config: Annotated[Path, Option("CONFIG", positional=True)]
    """The camera's configuration (YAML)."""
    window: Annotated[int | None, Option("N")] = None
    """Views that the live estimate looks back on, in place of the configuration's."""


def reads(request: Request) -> list[Path]:
    """The configuration."""
    return [request.config]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The result when the person ends it, or no more pictures come.

    Raises: InputError for a configuration that cannot be used, and where ROS cannot be reached.
    """
    from calibrant.ros.bridge import Bridge
    from calibrant.tasks.live.recorded import check_session

    if request.window is not None and request.window < 1:
        raise InputError(f"--window {request.window}: expected 1 view or more")
    config = read_config(request.config, window=request.window)
    check_session(config.session)
    return serve(config, Bridge(config), listener)


def serve(config: CameraConfig, transport: Transport, listener: Listener = SILENT) -> Outcome:
    """The node on any transport, which is closed at the end."""
    from calibrant.ros.calibrating import Calibrating
    from calibrant.ros.node import Node, Surroundings
    from calibrant.ros.tracking import Tracking

    around = Surroundings(config, transport, listener)
    work = Calibrating(around) if config.through is None else Tracking(around, config.through)
    try:
        Node(around, work, repeats=config.through is not None).run()
    except KeyboardInterrupt:  # a node has no end of its own: this is how a person says that it is enough
        answered()
        listener.note("Stopped.")
    finally:
        transport.close()
    return Outcome(result=work.result if isinstance(work, Calibrating) else None)
