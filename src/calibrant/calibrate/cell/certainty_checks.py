"""What a finished cell is asked about its certainty: each question with what was added to sigma."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from calibrant.calibrate.cell.certainty.checks import (
    LIKELY,
    geometry_check,
    given_lens_check,
    lens_shift_check,
    shared_errors_check,
    untold_lens_check,
)
from calibrant.calibrate.cell.certainty.moved_check import moved_check
from calibrant.calibrate.cell.certainty.whole import Certainty, arm_errors, growth, untold
from calibrant.calibrate.cell.checks import moments_check
from calibrant.calibrate.cell.fitted import fitted_cameras
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.data import Check
from calibrant.data.details import ArmErrors
from calibrant.optimize.solution import Solution


def named(check: Check, label: str) -> Check:
    """The check with a label in its name and before its words; as it is for none."""
    if not label:
        return check
    return replace(check, name=f"{check.name}-{label.replace(' ', '-')}", message=f"{label}: {check.message}")


def certainty_checks(cell: Cell, solution: Solution, certainty: Certainty) -> Iterable[Check]:
    """Errors that poses, views and moments share, pushes, and lenses that robot and photos have elsewhere."""
    cameras = fitted_cameras(cell, solution)
    for robot, shared in certainty.poses.shared.items():
        name = robot if len(cell.layout.robots) > 1 else ""
        yield from (named(c, name) for c in shared_errors_check(shared, growth(cell, solution)))
    if certainty.moments is not None:
        yield moments_check(certainty.moments.times)
    for robot, own in arm_errors(cell, solution, certainty.poses.geometries).items():
        name = robot if len(cell.layout.robots) > 1 else ""
        seen = certainty.poses.geometries[robot].chance >= LIKELY
        yield named(geometry_check(own, seen=seen, identified=robot in cell.free), name)
    for robot, push in certainty.poses.moves.items():
        name = robot if len(cell.layout.robots) > 1 else ""
        yield named(moved_check(cell, solution, robot, push), name)
    for camera, shift in certainty.lenses.items():
        name = camera if len(cell.roles) > 1 else ""
        yield from (named(c, name) for c in lens_shift_check(cameras[camera], shift, rig=cell.layout.rig))
    for camera, doubt in certainty.doubts.items():
        name = camera if len(cell.roles) > 1 else ""
        yield from (named(c, name) for c in given_lens_check(cameras[camera], doubt, rig=cell.layout.rig))
    if cell.layout.rig and (found := untold(cell, solution, certainty.doubts)) is not None:
        yield untold_lens_check(found[0], certainty.doubts[found[0]], found[1])


def arm_errors_record(cell: Cell, solution: Solution, certainty: Certainty) -> tuple[ArmErrors, ...]:
    """The record of what the robots' own geometry errs by; nothing where their accuracy was told."""
    found = arm_errors(cell, solution, certainty.poses.geometries)
    return (ArmErrors(found),) if found else ()
