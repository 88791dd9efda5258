"""Where a camera beside the robot is, as the wrist camera and it see the target: the dynamic method over a window.

The last N views of each camera are one problem (`calibrate.dynamic.track`); older ones are forgotten, so that the
estimate follows a camera that is moved. A view that contradicts the others starts the window anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.arrays import Array
from calibrant.data import TransformEstimate, View
from calibrant.errors import InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.calibrate.dynamic.problem import WristCamera
    from calibrant.calibrate.dynamic.track import DynamicNoise
    from calibrant.cameras import Camera


@dataclass(frozen=True, eq=False)
class Tracker:
    """window: views of each camera that count; near, far: those of the wrist camera with T_base_tool, and of the other.

    estimate: T_base_camera with its covariance, None before both have seen the target; surprise: the view that the
    last estimate left out what was before for.
    """

    wrist: WristCamera
    external: Camera
    noise: DynamicNoise
    window: int
    near: tuple[tuple[View, Array], ...] = ()
    far: tuple[View, ...] = ()
    estimate: TransformEstimate | None = None
    surprise: str | None = None

    def seen(self, near: tuple[View, Array], far: View) -> Tracker:
        """After a view of each of the target in one place, the wrist's at a robot pose (4, 4)."""
        grown = replace(self, near=(*self.near, near)[-self.window :], far=(*self.far, far)[-self.window :])
        found = grown._estimated()
        if found is not None:
            return replace(grown, estimate=found, surprise=None)
        anew = replace(self, near=(near,), far=(far,))
        return replace(anew, estimate=anew._estimated(), surprise=far.id)

    def _estimated(self) -> TransformEstimate | None:
        """None where the views contradict each other."""
        import numpy as np

        from calibrant.tasks.robots.dynamic_views import NO_FIT, take_in

        views, poses = [v for v, _ in self.near], np.array([T for _, T in self.near])
        try:
            taken = take_in(self.wrist, self.external, self.noise, views, poses, self.far, moves=False)
        except RefusedError:
            return None
        last = {self.near[-1][0].id, self.far[-1].id}
        if (last & set(taken.surprises) and len(self.far) > 1) or taken.off > NO_FIT:
            return None
        return taken.known.T_base_external


def tracker_of(wrist: Path, camera: Path, window: int) -> Tracker:
    """A tracker of the wrist camera's hand-eye result and the other camera's file.

    Raises: InputError for a result that is not of a camera on the gripper, a file without a camera, no window.
    """
    from calibrant.formats.cameras.read import read_camera
    from calibrant.tasks.robots.dynamic_views import wrist_of

    if window < 1:
        raise InputError(f"--window {window}: expected 1 view or more")
    known, noise = wrist_of(wrist)
    return Tracker(known, read_camera(camera), noise, window)
