"""A cell's fit with what its noise levels do not hold: errors that poses or views share, sizes, bent lenses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.accuracy import RobotAccuracy, accuracy_shares
from calibrant.calibrate.cell.certainty.geometry import GeometryErrors, geometry_errors
from calibrant.calibrate.cell.certainty.given_lens import LensDoubt, lens_doubt
from calibrant.calibrate.cell.certainty.lens import LensShift, along_with, lens_shift
from calibrant.calibrate.cell.certainty.moved import Moved, moved
from calibrant.calibrate.cell.certainty.neighbours import ODDS, NeighbourErrors, shared_errors
from calibrant.calibrate.cell.certainty.pose_errors import pose_errors
from calibrant.calibrate.cell.certainty.size import FreeSizes, size_shares
from calibrant.calibrate.cell.certainty.together import MomentErrors, moment_errors
from calibrant.calibrate.cell.certainty.views import lens_shares
from calibrant.calibrate.cell.problem.groups import lens_variable, robot_groups
from calibrant.calibrate.cell.problem.layout import poses_variable, variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.data.details import ArmError
from calibrant.optimize.noise import NoiseEstimate
from calibrant.optimize.solution import Solution


@dataclass(frozen=True, eq=False)
class ByPoses:
    """What the errors of the robots' poses come to, by robot: those that neighbours share, those of the robot's own
    geometry where nobody told its accuracy, pushes. told (s, s): the covariance of the others' geometry."""

    shared: Mapping[str, NeighbourErrors]
    geometries: Mapping[str, GeometryErrors]
    moves: Mapping[str, Moved]
    told: Array


@dataclass(frozen=True, eq=False)
class Certainty:
    """What was added to the covariance, by the robots' poses and by camera; moments: what all that was seen of
    handheld targets at once errs alike by."""

    poses: ByPoses
    lenses: Mapping[str, LensShift]
    doubts: Mapping[str, LensDoubt]
    moments: MomentErrors | None = None


def certain(
    cell: Cell,
    noise: NoiseEstimate,
    sizes: FreeSizes | None,
    accuracies: Mapping[str, RobotAccuracy],
    freed: Mapping[str, tuple[Cell, Solution]],
) -> tuple[NoiseEstimate, Certainty]:
    """The estimate with its whole covariance, and what was added to it.

    sizes: the fit that has the sizes of targets free that the robots' motion tells; accuracies: of robots, where told;
    freed: by camera whose lens was given as exact, the cell and its fit that have it free.
    """
    solution = noise.solution
    there = {v.name for v in solution.problem.variables}
    poses = _by_poses(cell, solution, accuracies)
    beside: Array = poses.told + sum(found.covariance for found in poses.shared.values())
    if sizes is not None:
        beside = beside + size_shares(solution, sizes)
    doubts = _lens_doubts(cell, noise, freed)
    doubted = sum((doubt.covariance for doubt in doubts.values()), start=np.zeros_like(beside))
    beside = beside + doubted
    lenses: dict[str, LensShift] = {}
    # A rig has no arm that errs smoothly: what its moments share is asked by itself, below.
    arm = 0.0 if cell.layout.rig else ODDS / (1 + ODDS)
    smooth = max((found.chance for found in poses.shared.values()), default=arm)
    for name, role in cell.roles.items():
        if lens_variable(name) in there and not role.exact:
            shared = lens_shares(cell, solution, name, sigma_px=cell.pixel_level(noise.levels, name).sigma)
            if shared is not None:
                beside = beside + along_with(solution, lens_variable(name), shared)
            shift = lens_shift(solution.with_beside(beside), lens_variable(name), role, smooth=smooth)
            if shift is not None:
                lenses[name] = shift
                beside = beside + shift.covariance
    moments: MomentErrors | None = None
    if cell.layout.by_hand:
        level = noise.levels[cell.pixel_group(cell.layout.by_hand[0][0])].sigma
        moments = moment_errors(cell, solution.with_beside(beside), sigma_px=level, doubts=doubted)
        beside = beside if moments is None else beside + moments.covariance
    # The lens is compared without it: what the photos have elsewhere is not the less so for an arm that may do it.
    beside = beside + sum(own.covariance for own in poses.geometries.values())
    return replace(noise, solution=solution.with_beside(beside)), Certainty(poses, lenses, doubts, moments)


def _lens_doubts(cell: Cell, noise: NoiseEstimate, freed: Mapping[str, tuple[Cell, Solution]]) -> dict[str, LensDoubt]:
    """What is said of the lenses that were given as exact, by camera."""
    hanging = [name for group in cell.layout.by_hand for name in group if name in freed]
    doubts: dict[str, LensDoubt] = {}
    for name, (other, with_lens) in freed.items():
        sigma_px, many = cell.pixel_level(noise.levels, name).sigma, len(hanging) if name in hanging else 0
        doubt = lens_doubt(other, noise.solution, with_lens, name, sigma_px=sigma_px, hanging=many)
        if doubt is not None:
            doubts[name] = doubt
    return doubts


def _by_poses(cell: Cell, solution: Solution, accuracies: Mapping[str, RobotAccuracy]) -> ByPoses:
    there = {v.name for v in solution.problem.variables}
    shared: dict[str, NeighbourErrors] = {}
    geometries: dict[str, GeometryErrors] = {}
    moves: dict[str, Moved] = {}
    told: Array = np.zeros_like(solution.shared_covariance)
    for robot in cell.layout.robots:
        if poses_variable(robot) not in there:
            continue
        errors = pose_errors(solution, poses_variable(robot), robot_groups(robot))
        if errors is None:
            continue
        if (found := shared_errors(errors)) is not None:
            shared[robot] = found
        if (push := moved(errors)) is not None:
            moves[robot] = push
        if robot in accuracies:
            told = told + accuracy_shares(errors, accuracies[robot])
        elif (own := geometry_errors(errors)) is not None:
            geometries[robot] = own
    return ByPoses(shared, geometries, moves, told)


def growth(cell: Cell, solution: Solution) -> float:
    """The cameras' sigma of position over that by the noise levels alone."""
    frames = [variable(f) for f in cell.layout.unknown if f[1] in cell.layout.cameras]
    alone = solution.with_beside(None)
    whole, noise = (sum(float(np.trace(s.covariance(f)[3:, 3:])) for f in frames) for s in (solution, alone))
    return float(np.sqrt(whole / noise)) if noise > 0 else 1.0


def arm_errors(cell: Cell, solution: Solution, geometries: Mapping[str, GeometryErrors]) -> dict[str, ArmError]:
    """What the robots' own geometry errs by, in millimetres, of those whose accuracy nobody told."""
    frames = [variable(f) for f in cell.layout.unknown if f[1] in cell.layout.cameras]
    alone = solution.plain
    out = {}
    for robot, found in geometries.items():
        could = replace(alone, beside=found.could_add)
        added = [np.diag(could.covariance(f)[3:, 3:] - alone.covariance(f)[3:, 3:]).max() for f in frames]
        moved_by = float(np.sqrt(max(0.0, *added)))
        out[robot] = ArmError(1e3 * found.metres, 1e3 * found.unseen, 1e3 * moved_by, found.assumed)
    return out


def untold(cell: Cell, solution: Solution, doubts: Mapping[str, LensDoubt]) -> tuple[str, float] | None:
    """The exact lens of which the pictures tell least for the places of cameras, and what it may move one of them by,
    metres; None where that is less than their sigma, and where doubts are in it."""
    frames = [variable(f) for f in cell.layout.unknown if f[1] in cell.layout.cameras]
    agree = {name: d for name, d in doubts.items() if not d.covariance.any()}
    if not frames or len(agree) < len(doubts):
        return None
    alone, found = solution.plain, []
    for name, doubt in agree.items():
        could = replace(alone, beside=doubt.could_add)
        for frame in frames:
            added, stated = (float(np.trace(C[3:, 3:])) for C in (
                could.covariance(frame) - alone.covariance(frame), solution.covariance(frame)))  # fmt: skip
            found += [(name, float(np.sqrt(added)))] if added > stated else []
    return max(found, key=lambda f: f[1], default=None)
