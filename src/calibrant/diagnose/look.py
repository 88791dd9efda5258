"""A finished result, and what is computed from it for whoever shows it: each thing once, when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from calibrant.arrays import Array
from calibrant.data import CalibrationResult

if TYPE_CHECKING:
    from calibrant.calibrate.review.coverage import CameraCoverage as CameraCoverage
    from calibrant.calibrate.review.residuals import ViewResiduals as ViewResiduals
    from calibrant.calibrate.stereo.drawn import DrawnPair as DrawnPair
    from calibrant.diagnose.budget.workspace import WorkspaceUncertainty
    from calibrant.diagnose.influence import ViewInfluence
    from calibrant.diagnose.loop import LoopView


@dataclass(frozen=True, eq=False)
class Look:
    """What a terminal and a page show of a result. One look serves both, so that nothing is solved twice."""

    result: CalibrationResult

    def at(self, result: CalibrationResult) -> Look:
        """A look at the same result in other words, with all that was computed already."""
        other = Look(result)
        other.__dict__.update({name: value for name, value in self.__dict__.items() if name != "result"})
        return other

    @cached_property
    def poses(self) -> dict[tuple[str, str], Array]:
        """T_camera_target (4, 4) by (camera, view id), as stated or fitted."""
        from calibrant.calibrate.review.residuals import fitted_poses

        return fitted_poses(self.result)

    @cached_property
    def residuals(self) -> tuple[ViewResiduals, ...]:
        """Residuals of every view; empty without observations."""
        from calibrant.calibrate.review.residuals import view_residuals

        return () if self.result.observations is None else view_residuals(self.result, self.poses)

    @cached_property
    def loop(self) -> tuple[LoopView, ...]:
        """Where the target is by camera and by robot, for results that have both."""
        if self.result.robot_poses is None or not self.result.transforms:
            return ()
        from calibrant.diagnose.loop import loop_views

        return loop_views(self.result)

    @cached_property
    def drawn_pairs(self) -> tuple[DrawnPair, ...]:
        """Pairs of pictures with epipolar lines, the worst first, of a stereo result."""
        from calibrant.calibrate.stereo.drawn import drawn_pairs

        return drawn_pairs(self.result)

    @cached_property
    def coverage(self) -> tuple[CameraCoverage, ...]:
        """What the views of each camera cover."""
        from calibrant.calibrate.review.coverage import covered

        return () if self.result.observations is None else covered(self.result, self.poses, self.residuals)

    @cached_property
    def influence(self) -> tuple[ViewInfluence, ...]:
        """What leaving each view out would move."""
        from calibrant.diagnose.influence import influence

        return influence(self.result)

    @cached_property
    def workspaces(self) -> dict[str, WorkspaceUncertainty]:
        """The uncertainty in the workspace that was asked for, by camera."""
        if self.result.options.get("workspace") is None:
            return {}
        from calibrant.diagnose.budget.workspace import asked_workspace

        return asked_workspace(self.result)

    @cached_property
    def other_bases(self) -> dict[str, Array]:
        """T_root_base of the robots but the first, by frame."""
        from calibrant.diagnose.loop import other_bases

        return other_bases(self.result)

    @cached_property
    def standing_cameras(self) -> dict[str, Array]:
        """T_root_camera of cameras that see only what stands still, by name."""
        from calibrant.diagnose.loop import standing_cameras

        return standing_cameras(self.result)


def look(at: CalibrationResult | Look) -> Look:
    """A look at a result; one that was taken already is kept."""
    return at if isinstance(at, Look) else Look(at)
