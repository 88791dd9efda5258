"""The dynamic method live: where a camera beside the robot is, after every picture, and the way to where it is wanted.

The wrist camera, calibrated, sees a target from robot poses; the external camera sees the same target. Each picture
improves `DynamicCalibration`. A person may move the external camera meanwhile: a picture that contradicts what was
known begins a new place, and what was learnt of target, wrist and lens stays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.dynamic.track import DynamicCalibration
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cancel import checkpoint
from calibrant.data import CameraSource, Picture, Robot, TransformEstimate, View
from calibrant.detection.detection import Detection
from calibrant.diagnose.movement import Movement, guidance, to_wanted
from calibrant.errors import InputError
from calibrant.servoing.sight.eye import Model

WRIST, EXTERNAL = "wrist", "external"
LEAST_SPARE = 12
"""Numbers that tell a noise level to a fifth."""
LEAST_PX = 1e-3
POOLED = 20
"""Views that tell it: the last ones, under the light and at the distance of now."""
FEWEST = 6
"""Points of a view that `DynamicCalibration` takes."""


@dataclass(frozen=True, eq=False)
class Located:
    """After a picture: its name, and of which camera; why it was of no use, else empty; moved: whether it began a new
    place of the external camera; T_base_external with its covariance, once it is known; to_go: the way to the wanted
    place, along the camera's axes as it is, None where none is wanted; known: the whole estimate."""

    picture: str
    camera: str
    reason: str
    moved: bool
    T_base_external: TransformEstimate | None
    to_go: Movement | None
    known: DynamicCalibration

    @property
    def words(self) -> str:
        """One line: the place with 1 sigma of its worst direction, and what to do."""
        if self.reason:
            return f"{self.picture}: {self.reason}"
        if self.T_base_external is None:
            return f"{self.picture}: the external camera has not seen the target yet"
        place = ", ".join(f"{1e3 * v:.1f}" for v in self.T_base_external.matrix[:3, 3])
        text = f"{self.picture}: at [{place}] mm, known to {self.sigma_mm:.2g} mm and {self.sigma_deg:.2g} deg"
        text += "; the camera was moved" if self.moved else ""
        if self.to_go is not None:
            text += f"; {guidance(self.to_go) or 'there: no further than is certain'}"
        return text

    @property
    def sigma_mm(self) -> float:
        """1 sigma of the position's worst direction, mm; NaN before the camera is known."""
        return 1e3 * self._worst(slice(3, 6))

    @property
    def sigma_deg(self) -> float:
        """1 sigma of the turn's worst direction, degrees."""
        return float(np.rad2deg(self._worst(slice(0, 3))))

    def _worst(self, rows: slice) -> float:
        if self.T_base_external is None or self.T_base_external.covariance is None:
            return float("nan")
        return float(np.sqrt(max(np.linalg.eigvalsh(self.T_base_external.covariance[rows, rows])[-1], 0.0)))


def after_wrist(known: DynamicCalibration, picture: str, view: View | str, T_base_gripper: Array) -> Located:
    """After a picture of the wrist camera from a pose; view: or why there is none."""
    if isinstance(view, str):
        return _located(known, picture, WRIST, view)
    return _located(known.seen_by_wrist(view, T_base_gripper), picture, WRIST)


def after_external(known: DynamicCalibration, picture: str, view: View | str, wanted: Array | None = None) -> Located:
    """After a picture of the external camera; wanted: T_base_external (4, 4) that it is to be led to."""
    if isinstance(view, str):
        return _located(known, picture, EXTERNAL, view, wanted=wanted)
    known = with_own_noise(known, view)
    after, moved = known.seen_by_external(view), False
    if after.last is not None and after.last.view == view.id and after.last.surprising and not known.new_place:
        after, moved = known.external_moved().seen_by_external(view), True
    return _located(after, picture, EXTERNAL, moved=moved, wanted=wanted)


def with_own_noise(known: DynamicCalibration, view: View) -> DynamicCalibration:
    """The noise of the external camera's corners as its own views leave it, each at its own pose; that stated counts
    until they have enough points to tell: it is mostly another camera's, from another distance."""
    views = [*(s.view for s in known.sights if s.place is not None), view][-POOLED:]
    spare = sum(2 * len(v) - 6 for v in views)
    if spare < LEAST_SPARE:
        return known
    try:
        found = target_poses(known.external, views)
    except InputError:
        return known
    counts = np.array([len(v) for v in views])
    px = float(np.sqrt(np.sum(counts * found.rms_px**2) / spare))
    return replace(known, noise=replace(known.noise, external_px=max(px, LEAST_PX)))


def view_of(picture: Picture, found: Detection, model: Model, camera: str) -> View | str:
    """What a detector found, as a view; or why it is none."""
    if not found.found:
        return found.reason or "no target"
    if len(found.uv) < FEWEST:
        return f"{len(found.uv)} points of the target, {FEWEST} are needed"
    points = model.of(found.point_ids)
    return View(picture.name, points, found.uv, found.point_ids, camera=camera, sigma_px=found.sigma_px)


def located_live(
    robot: Robot,
    wrist: CameraSource,
    external: CameraSource,
    known: DynamicCalibration,
    find: Callable[[Picture], Detection],
    model: Model,
    *,
    wanted: Array | None = None,
) -> Iterator[Located]:
    """For ever: a picture of each camera, the wrist's only where the arm stands somewhere else than before.

    The caller moves the arm, or a person does, between the pictures; the target stands still.
    Raises: DeviceError when robot or camera do not answer; InputError for a camera whose pictures are of another size.
    """
    last: Array | None = None
    while True:
        checkpoint()
        T = robot.pose()
        if last is None or not np.allclose(T, last, atol=1e-4):
            last, picture = T, wrist.take()
            _check_size(picture, known.wrist.camera.image_size, wrist.name)
            found = after_wrist(known, picture.name, view_of(picture, find(picture), model, WRIST), T)
            known = found.known
            yield found
        picture = external.take()
        _check_size(picture, known.external.image_size, external.name)
        found = after_external(known, picture.name, view_of(picture, find(picture), model, EXTERNAL), wanted)
        known = found.known
        yield found


def _check_size(picture: Picture, size: tuple[int, int], name: str) -> None:
    if picture.size != size:
        raise InputError(
            f"camera {name} takes pictures of {picture.size[0]}x{picture.size[1]} px, and is calibrated for "
            f"{size[0]}x{size[1]} px"
        )


def _located(
    known: DynamicCalibration,
    picture: str,
    camera: str,
    reason: str = "",
    *,
    moved: bool = False,
    wanted: Array | None = None,
) -> Located:
    if known.new_place or known.solution is None:
        return Located(picture, camera, reason, moved, None, None, known)
    estimate = known.T_base_external
    to_go = None
    if wanted is not None and estimate.covariance is not None:
        to_go = to_wanted(estimate.matrix, estimate.covariance, wanted)
    return Located(picture, camera, reason, moved, estimate, to_go, known)
