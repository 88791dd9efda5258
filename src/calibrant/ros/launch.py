"""`calibrant ros launch`: the nodes of several cameras, each in its own process, until one fails or all end."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.live.camera_config import read_config
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome

EXAMPLE = 'cb.ros_launch(["wrist.yaml", "front.yaml", "top.yaml"])'
_PAUSE_S = 0.2
_END_S = 20.0


@dataclass(frozen=True, kw_only=True)
class Request:
    """Run the nodes of several cameras at once, one configuration each.

    calibrant ros launch wrist.yaml front.yaml top.yaml

    Ctrl-C ends all. See docs/ros.md.
    """

    configs: Annotated[tuple[Path, ...], Option("CONFIGS", positional=True)]
    """The cameras' configurations (YAML)."""
    window: Annotated[int | None, Option("N")] = None
    """Views that live estimates look back on, in place of the configurations'."""


def reads(request: Request) -> list[Path]:
    """The configurations."""
    return list(request.configs)


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """All nodes until they end. Raises: InputError for configurations that cannot be used, and where a node failed."""
    from calibrant.tasks.live.recorded import check_session

    configs = [read_config(path, window=request.window) for path in request.configs]
    for what, values in (("name", [c.name for c in configs]), ("session", [str(c.session) for c in configs])):
        twice = next((value for value in values if values.count(value) > 1), None)
        if twice is not None:
            raise InputError(f"two configurations have the {what} {twice}; give each camera its own")
    for config in configs:
        check_session(config.session)
    more = [] if request.window is None else ["--window", str(request.window)]
    commands = [[sys.executable, "-m", "calibrant", "ros", "run", str(path), *more] for path in request.configs]
    nodes = [subprocess.Popen(command, start_new_session=True) for command in commands]
    listener.note(f"{len(nodes)} nodes: {', '.join(config.name for config in configs)}")
    try:
        failed = _first_failed(nodes)
    except KeyboardInterrupt:  # as of one node: the person says that it is enough
        failed = None
    finally:
        _end(nodes)
    if failed is not None:
        raise InputError(f"the node of {configs[failed].name} failed with status {nodes[failed].returncode}; see above")
    return Outcome()


def _first_failed(nodes: Sequence[subprocess.Popen[bytes]]) -> int | None:
    """Number of the first node that ends with an error; None where all end well."""
    while True:
        states = [node.poll() for node in nodes]
        failed = next((i for i, state in enumerate(states) if state), None)
        if failed is not None or None not in states:
            return failed
        time.sleep(_PAUSE_S)


def _end(nodes: Sequence[subprocess.Popen[bytes]]) -> None:
    for node in nodes:
        with suppress(ProcessLookupError):
            node.send_signal(signal.SIGINT)
    for node in nodes:
        try:
            node.wait(_END_S)
        except subprocess.TimeoutExpired:
            node.kill()
            node.wait()
