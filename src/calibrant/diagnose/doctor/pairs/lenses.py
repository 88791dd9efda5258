"""Pictures that are not what their camera sees: mirrored, exchanged between the cameras, or of another camera."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from calibrant.arrays import Array
from calibrant.calibrate.cell.moments.pairs import PAIRED, PairPoses, agreed_place, apart
from calibrant.calibrate.cell.moments.reflected import BEHIND, reflections
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import Measured, Missed, Observations, View
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, nested_test
from calibrant.diagnose.doctor.pairs.case import Lens, PairCase, poses_of
from calibrant.diagnose.doctor.pairs.finding import PairFinding, judged, listed, sure
from calibrant.errors import InputError

OTHER = 0.03
"""Of the focal length: less is focus, or what a lens model lacks."""
MOST_ZOOM = 3.0
_TOLERANCE = 1e-5
FAR = 1e12
"""Squares, px^2, where a lens does not reach."""


def mirrored(case: PairCase) -> PairFinding | None:
    """Do far more pairs agree where one camera's pictures are mirrored, or seen from behind the board?"""
    if not case.wrong.any():
        return None
    fits, best = int((~case.wrong).sum()), None
    for k, other in enumerate(reflections(case.found.T_b, case.found.C_b, case.found.L_b, case.middle)):
        tried = replace(case.found, T_b=other.T, C_b=other.C, L_b=other.L)
        place = agreed_place(tried)
        wrong = apart(tried, place)
        found = judged(case, tried, place, wrong, ~wrong, 4)
        if found.fits > max(fits + 1, len(case) / 2, 0 if best is None else best[1].fits):
            best = other.how, found, place, k % 2
    if best is None or best[1].p > CONVINCING or best[1].loop.mm > PAIRED * case.loop.mm:
        return None
    how, found, place, axis = best
    agree = (
        f"{found.fits} of {len(case)} pairs agree then, to {found.loop.text} instead of {case.loop.text} as given "
        f"({fits} agree)"
    )
    if how == BEHIND:
        message = f"one camera sees the board from behind: {agree}"
        cure = "give the back as a board of its own, fixed to the front (calibrant rig --board, --rigid)"
        return PairFinding("board-behind", "fail", message, sure(found.p), case.loop, found.loop, proposal=cure)
    # Both eyes through one mirror look the same, but for the side that the right one stands at.
    side = 1 if place[0, 3] > 0 else 0
    who, option = (case.left, case.right)[side], ("left", "right")[side]
    message = f"{who} delivers mirror images, if {case.right} stands at the right of {case.left}: {agree}"
    return PairFinding(
        "camera-mirrored",
        "fail",
        message,
        sure(found.p),
        case.loop,
        found.loop,
        proposal=f"flip them: --mirror-{option}",
        repair=partial(unmirrored, name=who, middle=case.middle, axis=axis),
    )


def unmirrored(observations: Observations, *, name: str, middle: Array, axis: int) -> Observations:
    """The views of a camera as its pictures show them left to right: pixels flipped, corners numbered on the board as
    it is."""
    width = observations.image_sizes[name][0]
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    every = np.concatenate([v.points for v in observations.views])
    ids = np.concatenate([v.point_ids for v in observations.views])

    def flipped(v: View) -> View:
        points = middle + sign * (v.points - middle)
        at = np.array([int(np.argmin(np.sum((every - p) ** 2, axis=1))) for p in points])
        uv = np.column_stack([width - 1 - v.uv[:, 0], v.uv[:, 1]])
        C = None if v.covariance_px is None else v.covariance_px * [[1.0, -1.0], [-1.0, 1.0]]
        return replace(v, uv=uv, points=every[at], point_ids=ids[at], covariance_px=C)

    return replace(observations, views=tuple(flipped(v) if v.camera == name else v for v in observations.views))


def exchanged(case: PairCase) -> PairFinding | None:
    """Pairs whose left picture is the right camera's and the other way round."""
    rows = np.flatnonzero(case.wrong)
    if not len(rows) or len(rows) > len(case) / 2:
        return None
    left, right = ([side[k] for k in rows] for side in case.seen)
    target = case.observations.target
    other = poses_of((right, left), case.lenses, target)
    good = np.flatnonzero(~case.wrong)
    tried = _joined(case.found.take(good, good), other)
    wrong = apart(tried, case.place)
    back = ~wrong[len(good) :]
    if not back.any():
        return None
    changed = np.zeros(len(tried), dtype=bool)
    changed[len(good) :] = back
    found = judged(case, tried, case.place, wrong, changed, 2 * len(case))
    if found.p > CONVINCING:
        return None
    names = [case.names(k) for k in rows[back].tolist()]
    count = f"{len(names)} of {len(case)} pairs have" if len(names) > 1 else f"1 of {len(case)} pairs has"
    said = listed([f"{a} is by {case.right} and {b} by {case.left}" for a, b in names])
    message = (
        f"{count} the two cameras exchanged: {said}"
        f". The other way round they agree with the others, to {found.loop.text} instead of {case.loop.text}"
    )
    moments = {case.seen[0][k].moment for k in rows[back].tolist()}
    return PairFinding(
        "cameras-exchanged",
        "fail",
        message,
        sure(found.p),
        case.loop,
        found.loop,
        tuple(a for a, _ in names),
        proposal="exchange these pictures: --apply does, or exchange their names",
        repair=partial(exchange, case=case, moments=moments),
    )


def exchange(observations: Observations, *, case: PairCase, moments: set[str] | None) -> Observations:
    """The views of these moments, all without any, with the cameras exchanged."""
    other = {case.left: case.right, case.right: case.left}
    out = [
        replace(v, camera=other[v.camera]) if moments is None or v.moment in moments else v for v in observations.views
    ]
    return replace(observations, views=tuple(_named_apart(out)))


def _named_apart(views: list[View]) -> list[View]:
    """Ids that a camera has twice, told apart."""
    seen: set[tuple[str, str]] = set()
    out = []
    for v in views:
        while (v.camera, v.id) in seen:
            v = replace(v, id=f"{v.id} ({v.camera})")
        seen.add((v.camera, v.id))
        out.append(v)
    return out


def _joined(a: PairPoses, b: PairPoses) -> PairPoses:
    return PairPoses(
        np.concatenate([a.T_a, b.T_a]),
        np.concatenate([a.T_b, b.T_b]),
        np.concatenate([a.C_a, b.C_a]),
        np.concatenate([a.C_b, b.C_b]),
        np.concatenate([a.L_a, b.L_a]),
        np.concatenate([a.L_b, b.L_b]),
        np.concatenate([a.freedom, b.freedom]),
        a.names_a + b.names_a,
        a.names_b + b.names_b,
    )


def of_another_camera(case: PairCase) -> PairFinding | None:
    """The view whose own focal length is most surely another than its camera's, by more than `OTHER`."""
    best: tuple[float, View, Measured, str] | None = None
    for name, views, lens in zip((case.left, case.right), case.seen, case.lenses):
        for v in views:
            ratio, sigma, p = _own_focal(lens, v, hypotheses=2 * len(case))
            if p <= CONVINCING and abs(ratio - 1) > max(OTHER, 5 * sigma) and (best is None or p < best[0]):
                best = p, v, Measured(ratio, sigma), name
    if best is None:
        return None
    p, view, measured, name = best
    message = (
        f"{view.id} is by another camera than the other pictures of {name}, or another zoom: its own focal length is "
        f"{measured.value:.3f} ± {measured.sigma:.3f} times theirs"
    )
    return PairFinding(
        "picture-of-another-camera",
        "fail",
        message,
        sure(p),
        case.loop,
        None,
        (view.id,),
        measured,
        proposal=f"leave it out: --exclude {view.id}",
        repair=partial(without, camera=name, view=view.id, reason=message),
    )


def without(observations: Observations, *, camera: str, view: str, reason: str) -> Observations:
    """The views without one."""
    views = tuple(v for v in observations.views if (v.camera, v.id) != (camera, view))
    return replace(observations, views=views, missed=(*observations.missed, Missed(view, reason, camera)))


def _own_focal(lens: Lens, view: View, *, hypotheses: int) -> tuple[float, float, float]:
    """Focal length of a view over its camera's, 1 sigma, and the chance of so much better a fit by it."""

    def squares(log_ratio: float) -> float:
        zoomed = scaled(lens.camera, float(np.exp(log_ratio)))
        try:
            T = target_poses(zoomed, [view]).T_camera_target[0]
        except InputError:  # the lens bends its rays back before these points
            return FAR
        r = view.residuals(zoomed, T)
        return float(np.sum(r * r)) if np.isfinite(r).all() else FAR

    # Most views have their camera's: the parabola through three of them says so.
    at_zero, step = squares(0.0), float(np.log1p(OTHER))
    less, more = squares(-step), squares(step)
    if at_zero < min(less, more):
        return 1.0, 0.0, 1.0
    reach = float(np.log(MOST_ZOOM))
    found = minimize_scalar(squares, bounds=(-reach, reach), method="bounded", options={"xatol": _TOLERANCE})
    best, x = float(found.fun), float(found.x)
    freedom = max(2 * len(view) - 7, 1)
    h = 1e-2
    bend = max((squares(x + h) + squares(x - h) - 2 * best) / h**2, 1e-12)
    sigma = float(np.sqrt(2 * best / freedom / bend))
    p = nested_test(at_zero, best, 1, freedom, hypotheses=hypotheses)
    return float(np.exp(x)), float(np.exp(x)) * sigma, p


def scaled(camera: Camera, ratio: float) -> Camera:
    """The camera with its focal lengths times a ratio."""
    values = camera.values.copy()
    for name in ("fx", "fy"):
        values[camera.model.index(name)] *= ratio
    return Camera(camera.model, camera.image_size, values)
