"""Samples kept in a folder until there are enough, then the hand-eye task, then the camera as a static transform."""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.data import CalibrationResult
from calibrant.errors import InputError, RefusedError
from calibrant.ros.node import Surroundings
from calibrant.ros.transport import Transform
from calibrant.tasks.live.picture import Picture
from calibrant.tasks.live.recorded import calibrated, write_sample
from calibrant.tasks.live.sampling import Look, Sampler

AGAIN = 3
"""Samples more before the next try, where a calibration was refused."""


@dataclass(eq=False)
class Calibrating:
    """The work of a camera whose place is looked for."""

    around: Surroundings
    result: CalibrationResult | None = None
    count: int = 0
    next_try: int = 0

    @property
    def done(self) -> bool:
        """Whether the result is there."""
        return self.result is not None

    @property
    def words(self) -> str:
        """How many samples of how many."""
        return f"{self.count} of {max(self.next_try, self.around.config.views)}"

    def seen(self, topic: str, sampler: Sampler, look: Look, picture: Picture) -> None:
        """Keep a sample; calibrate where there are enough. A refusal asks for more samples."""
        around, config = self.around, self.around.config
        if look.sample is None:
            around.say(look.reason)
            return
        self.count = sampler.count
        write_sample(config.session, sampler.samples, around.info)
        around.listener.note(f"{look.sample.view.id}: {self.words} samples")
        if self.count < max(self.next_try, config.views):
            return
        try:
            self.result = calibrated(config, around.listener)
        except (RefusedError, InputError) as error:
            self.next_try = self.count + AGAIN
            around.listener.note(f"{error}. {AGAIN} samples more are taken: go to other poses")
            return
        self._publish(self.result, picture)

    def _publish(self, result: CalibrationResult, picture: Picture) -> None:
        """The camera in the frame that carries it; where tf has frames above the camera's own, their top is placed."""
        around, config = self.around, self.around.config
        frames = {"gripper": config.tool, "base": config.base}
        place = next(t for t in result.transforms if t.child == config.name and t.parent in frames)
        T, child = place.matrix, config.frame or picture.frame or f"{config.name}_optical_frame"
        top = around.tf.root_of(child)
        if top == around.tf.root_of(config.base):
            # Who placed the frame goes on doing so: a second parent would make tf jump between both.
            child = f"{child}_calibrated"
            around.listener.note(f"tf has the camera's frame in the robot's tree already; published is {child}")
        elif top != child:
            T_child_top = around.tf.pose(child, top, picture.stamp)
            T, child = (T, child) if T_child_top is None else (T @ T_child_top, top)
        around.transport.publish_static(Transform(frames[place.parent], child, T, picture.stamp, static=True))
        around.listener.note(f"published {child} in {frames[place.parent]}; the result is in {config.session}")
