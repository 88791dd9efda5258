"""The live estimate of a camera beside the robot: when both cameras see the target, the dynamic method once more."""

from __future__ import annotations

from dataclasses import dataclass, field

from calibrant.geometry import se3
from calibrant.ros.node import Surroundings
from calibrant.ros.transport import Transform
from calibrant.tasks.live.camera_config import Through
from calibrant.tasks.live.picture import Picture
from calibrant.tasks.live.recorded import write_lens
from calibrant.tasks.live.sampling import STILL_MM, Look, Sample, Sampler
from calibrant.tasks.live.tracking import Tracker, tracker_of

LIVE = "_live"
"""What the estimated frame is called after the camera's own."""
PAUSE_S = 0.5
"""Between two pairs of views: pictures of one stand tell the same."""
TOGETHER_S = 2.0
"""Between the pictures of a pair: the target lies still meanwhile."""


@dataclass(eq=False)
class Tracking:
    """The work of a camera that is located through the wrist camera."""

    around: Surroundings
    through: Through
    tracker: Tracker | None = None
    seen_by: dict[str, tuple[Sample, float]] = field(default_factory=dict)
    last: float = float("-inf")

    @property
    def done(self) -> bool:
        """Never: it goes on while the robot works."""
        return False

    @property
    def words(self) -> str:
        """How many views are in the window."""
        count = 0 if self.tracker is None else len(self.tracker.far)
        return f"{count} views in the window of {self.around.config.window}"

    def seen(self, topic: str, sampler: Sampler, look: Look, picture: Picture) -> None:
        """A view of one of the two cameras; both of one stand of the robot give a new estimate."""
        if look.sample is None:
            self.around.say(f"{topic}: {look.reason}")
            return
        self.seen_by[topic] = (look.sample, picture.stamp)
        if len(self.seen_by) < 2 or picture.stamp < self.last + PAUSE_S:
            return
        (near, near_s), (far, far_s) = self.seen_by[self.through.image], self.seen_by[self.around.config.image]
        apart_mm = float(se3.deviation(near.T_base_tool, far.T_base_tool)[0])
        if apart_mm > STILL_MM or abs(near_s - far_s) > TOGETHER_S:
            return
        tracker = self.tracker or self._begun()
        if tracker is None:
            return
        self.tracker = tracker.seen((near.view, near.T_base_tool), far.view)
        self.seen_by, self.last = {}, picture.stamp
        self._publish(self.tracker, picture)

    def _begun(self) -> Tracker | None:
        config = self.around.config
        lens = config.camera
        if lens is None:
            if self.around.info is None:
                self.around.say(f"waiting for {config.camera_info}")
                return None
            lens = write_lens(config.session, self.around.info)
        return tracker_of(self.through.result, lens, config.window)

    def _publish(self, tracker: Tracker, picture: Picture) -> None:
        around, config = self.around, self.around.config
        if tracker.surprise is not None:
            around.listener.note(f"{tracker.surprise} contradicts the views before: the window starts anew")
        if tracker.estimate is None:
            return
        frame = config.frame or f"{config.name}_optical_frame"
        where = Transform(config.base, f"{frame}{LIVE}", tracker.estimate.matrix, picture.stamp, static=False)
        around.transport.publish_live(where)
        if tracker.estimate.covariance is not None:
            around.transport.publish_pose(where, tracker.estimate.covariance)
