"""One camera's node: events in; of every topic the newest picture at whose time the robot's pose is known is looked at.

What it is for, its work says: `calibrating` or `tracking`. It is driven by `step`, so that any transport runs it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.ros.transport import Event, Info, Transform, Transport
from calibrant.targets.registry import parse_target
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.live.camera_config import CameraConfig
from calibrant.tasks.live.picture import Picture
from calibrant.tasks.live.sampling import STILL_S, Look, Sampler
from calibrant.tasks.live.shown import shown
from calibrant.tasks.live.transform_buffer import TransformBuffer

_WAITING = 8
"""Pictures of a topic that wait for tf: more, and the robot's pose is not coming."""


@dataclass(eq=False)
class Surroundings:
    """What the work and the node share: the configuration, where to publish, whom to tell, tf and camera_info."""

    config: CameraConfig
    transport: Transport
    listener: Listener = SILENT
    tf: TransformBuffer = field(default_factory=TransformBuffer)
    info: Mapping[str, Any] | None = None
    _reason: str | None = None

    def say(self, reason: str | None) -> None:
        """A sentence for the person, where it is another than the last one."""
        if reason and reason != self._reason:
            self.listener.note(reason)
        self._reason = reason


class Work(Protocol):
    """What is done with the pictures."""

    @property
    def done(self) -> bool:
        """Whether pictures are not needed any more."""
        ...

    @property
    def words(self) -> str:
        """How far it is, to be shown in the picture."""
        ...

    def seen(self, topic: str, sampler: Sampler, look: Look, picture: Picture) -> None:
        """After a picture: its look, and the sampler with it."""
        ...


@dataclass(eq=False)
class Node:
    """A running camera; repeats: whether poses count again (see `Sampler`)."""

    around: Surroundings
    work: Work
    repeats: bool = False
    _waiting: dict[str, deque[Picture]] = field(default_factory=dict)
    _samplers: dict[str, Sampler] = field(default_factory=dict)

    def __post_init__(self) -> None:
        config = self.around.config
        target = parse_target(config.target)
        for topic in config.pictures:
            camera = "camera" if topic == config.image else "wrist"
            self._samplers[topic] = Sampler(target, camera=camera, repeats=self.repeats)
            self._waiting[topic] = deque(maxlen=_WAITING)

    def run(self) -> None:
        """Until no more events come. Raises: InputError as the transport."""
        while (events := self.around.transport.events()) is not None:
            self.step(events)

    def step(self, events: Sequence[Event]) -> None:
        """Take in what came, transforms before the pictures of their time."""
        around = self.around
        for event in events:
            if isinstance(event, Transform):
                around.tf.add(event.parent, event.child, event.T_parent_child, event.stamp, static=event.static)
            elif isinstance(event, Info):
                around.info = event.data
            elif event.topic in self._waiting:
                self._waiting[event.topic].append(event)
        for topic in around.config.pictures:
            found = self._placed(topic)
            if found is not None and not self.work.done:
                self._look(topic, *found)

    def _placed(self, topic: str) -> tuple[Picture, Array] | None:
        """The newest waiting picture with the robot's pose at its time; older ones are dropped."""
        config, waiting = self.around.config, self._waiting[topic]
        for i in reversed(range(len(waiting))):
            T = self.around.tf.pose(config.base, config.tool, waiting[i].stamp)
            if T is not None:
                found = waiting[i]
                for _ in range(i + 1):
                    waiting.popleft()
                return found, T
        if len(waiting) == _WAITING:
            tree = self.around.tf.described()
            self.around.say(f"no pose of {config.tool} in {config.base} at the pictures' time; frames in tf: {tree}")
        return None

    def _look(self, topic: str, picture: Picture, T_base_tool: Array) -> None:
        around = self.around
        config = around.config
        try:
            grey = picture.grey()
        except InputError as error:  # one damaged picture of thousands: the next may be whole
            around.say(str(error))
            return
        motion = around.tf.moved(config.base, config.tool, picture.stamp, STILL_S)
        sampler, look = self._samplers[topic].look(grey, T_base_tool, motion)
        self._samplers[topic] = sampler
        self.work.seen(topic, sampler, look, picture)
        if topic == config.image:
            painted = shown(grey, look, self.work.words)
            around.transport.show(painted, frame=picture.frame, stamp=picture.stamp)
