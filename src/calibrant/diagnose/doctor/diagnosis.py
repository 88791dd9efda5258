"""The whole diagnosis: how the poses are to be read, what is wrong with the data, and the data repaired."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.boards.turned import ViewsNumbered
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Observations, RobotPoses, View, ViewResult, verdict_of
from calibrant.data.details import Deviations
from calibrant.diagnose.conventions.hypotheses import Setup
from calibrant.diagnose.doctor.evidence.case import Case, case_of_poses, case_of_views
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Loop
from calibrant.diagnose.doctor.evidence.told import deviations, faults, loop_figures, rank
from calibrant.diagnose.doctor.faults.timing import times_of
from calibrant.diagnose.doctor.numbering import finding, numbering_of, sides_of
from calibrant.diagnose.doctor.pose_notation import PoseDecision, decide_poses
from calibrant.diagnose.doctor.search import Examination
from calibrant.diagnose.doctor.sized import examined_at_size
from calibrant.errors import InputError
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3

Asked = Setup | Literal["auto"]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The decision about the poses, the examination of the data read so, and all findings, worst first.

    numbering: of views of a board that looks the same turned, where the robot's motion asks for another one.
    """

    poses: PoseDecision
    examination: Examination
    findings: tuple[Finding, ...]
    numbering: ViewsNumbered | None = None

    @property
    def sound(self) -> bool:
        """True when nothing failed."""
        return all(f.status != "fail" for f in self.findings)

    @property
    def repaired(self) -> Case:
        """The data with every repair applied."""
        return self.examination.repaired

    def named(self, name: str) -> tuple[Finding, ...]:
        """The findings of that name."""
        return tuple(f for f in self.findings if f.name == name)

    @property
    def agreeing_loop(self) -> Loop | None:
        """The loop that decided how the poses are read: over the views that agree best."""
        read = self.poses.decision
        same = (a for a in read.alternatives if a.notation is read.notation and a.setup == read.setup)
        return next(map(Loop.of, same), None)

    def explained_by(self, cause: Finding) -> Diagnosis:
        """The diagnosis with one cause in the place of all that failed, which it explains, and of their repairs."""
        examination = self.examination
        left = tuple(f for f in self.findings if f.status == "ok")
        unrepaired = Examination((), examination.case, examination.case, examination.before, examination.before)
        return replace(self, findings=(cause, *left), examination=unrepaired)

    def numbered(self, observations: Observations) -> Observations:
        """The observations that were diagnosed, or came before them, numbered as the robot's motion says."""
        if self.numbering is None:
            return observations
        return self.numbering.observations(observations, self.examination.case.data.ids)


def diagnose_poses(
    complete: Sequence[PoseNotation],
    T_camera_target: Array,
    *,
    setup: Asked = "auto",
    direction_said: bool = False,
    free_scale: bool = False,
) -> Diagnosis:
    """Diagnose n robot poses and n target poses (n, 4, 4), metres, that belong together row by row.

    Args: complete, notations of the robot poses, the most believable first (formats.poses.notations); direction_said,
    that they are T_camera_target is known, so that nobody is asked; free_scale, the target's lengths are in an unknown
    unit.
    Raises: RefusedError naming degenerate motions, or two notations that fit equally well.
    """
    B = se3.check(T_camera_target, name="T_camera_target")
    rows = np.arange(len(B))
    poses = decide_poses(complete, B, rows, setup=setup, measured=not direction_said, free_scale=free_scale)
    times = times_of(complete[0])
    case = case_of_poses(poses.notation.poses, B, setup=poses.setup, times=times)
    case = replace(case, pose_units=poses.notation.units)
    if poses.inverted_targets:
        case = case.with_inverted_targets()
    return _diagnosis(poses, examined_at_size(case, poses.scale, free=free_scale))


def diagnose_views(
    complete: Sequence[PoseNotation],
    observations: Observations,
    camera: Camera,
    *,
    setup: Asked = "auto",
    camera_given: bool = False,
    free_scale: bool = False,
) -> Diagnosis:
    """Diagnose robot poses and the views taken at them.

    Args: complete, notations of the poses in the order of the pictures, their ids the pictures' names, also of those
    that show no target; observations, whose views carry these names as ids; camera, known or calibrated from the views;
    free_scale, the target's size is not known.
    Raises: InputError for a view without a pose; RefusedError as `diagnose_poses`.
    """
    ids = complete[0].ids
    filled = _with_gaps(observations, ids)
    any_case = case_of_views(complete[0].poses, filled, camera, setup="eye-in-hand", camera_given=camera_given)
    if any_case.data.doubles is not None:
        any_case = any_case.with_branches(sides_of(complete, any_case))
    numbered = numbering_of(any_case, complete)
    if numbered is not None:
        any_case = any_case.with_boards(numbered.rows.tolist(), numbered.F)
        observations, filled = (numbered.observations(o, ids) for o in (observations, filled))
    rows = any_case.index
    poses = decide_poses(complete, any_case.B, rows, setup=setup, free_scale=free_scale)
    case = replace(
        case_of_views(
            poses.notation.poses,
            filled,
            camera,
            setup=poses.setup,
            camera_given=camera_given,
            times=times_of(complete[0]),
        ),
        observations=observations,
        pose_units=poses.notation.units,
    )
    case = case.with_branches([case.setup.normal_form(case.data.T_base_gripper)])
    if numbered is not None:
        poses = replace(poses, findings=(*poses.findings, finding(numbered, ids)))
    found = examined_at_size(case, poses.scale, free=free_scale)
    return replace(_diagnosis(poses, found), numbering=numbered)


def _with_gaps(observations: Observations, ids: Sequence[str]) -> Observations:
    """A view for every pose, empty where the picture shows no target, so that orders of rows keep their meaning."""
    views = {v.id: v for v in observations.views}
    unknown = [name for name in views if name not in ids]
    if unknown:
        raise InputError(f"no robot pose for view {unknown[0]!r}; poses are called {', '.join(ids[:4])} …")
    nothing = np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    camera = next(iter(observations.image_sizes))
    every = tuple(replace(views[i], moment=i) if i in views else View(i, *nothing, camera=camera) for i in ids)
    return replace(observations, views=every)


def _diagnosis(poses: PoseDecision, examination: Examination) -> Diagnosis:
    # That no notation fits is judged again when everything is repaired: the examination has the last word.
    # And so is a unit of length that the robot's motion contradicts.
    again = {"no-reading-fits"} if examination.judged else set()
    again |= {f.name for f in examination.findings} & {"pose-units"}
    read = [f for f in poses.findings if f.name not in again]
    every = sorted((*read, *examination.findings), key=rank)
    return Diagnosis(poses, examination, tuple(every))


def as_result(diagnosis: Diagnosis) -> CalibrationResult:
    """The diagnosis as a result of kind "doctor": findings as checks, every view with what the doctor would do."""
    case = diagnosis.repaired
    checks = (
        Check("pose-reading", "ok", diagnosis.poses.decision.message, diagnosis.poses.decision.confidence),
        *(f.check for f in diagnosis.findings),
    )
    data = case.data
    sizes = [0] * len(data) if data.views is None else [len(v) for v in data.views]
    views = tuple(
        ViewResult(i, bool(use), size, reason=reason, T_camera_target=B if np.isfinite(B).all() else None)
        for i, use, size, reason, B in zip(data.ids, data.use, sizes, data.reasons, data.B)
    )
    examination = diagnosis.examination
    agreeing = diagnosis.agreeing_loop
    loops = {"loop_before": examination.before, "loop_after": examination.after, "loop_agreeing": agreeing}
    return CalibrationResult(
        kind="doctor",
        verdict=verdict_of(checks),
        checks=checks,
        views=views,
        figures=loop_figures(loops),
        decided={"setup": diagnosis.poses.setup, "pose_reading": diagnosis.poses.decision.notation.description},
        details=(faults(diagnosis.findings), *_deviations(examination)),
        robot_poses=RobotPoses(data.ids, data.T_base_gripper),
    )


def _deviations(examination: Examination) -> tuple[Deviations, ...]:
    """The loop of every view before and after the repairs; nothing where the motions determine none."""
    if examination.before is None:
        return ()
    before, after = _view_deviations(examination.case), _view_deviations(examination.repaired)
    return (deviations(before, after, examination.case.data.ids),)


def _view_deviations(case: Case) -> dict[str, tuple[float, float]]:
    """mm and deg of each view used from where the others put the target."""
    mm, deg = se3.mm_and_deg(case.robust.fit.deviation)
    return {name: (float(a), float(b)) for name, a, b in zip(case.ids, mm, deg)}
