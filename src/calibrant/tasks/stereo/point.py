"""Where a pointer points at: two pictures by uncalibrated cameras, the corners of a plane, the pointer's axis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, Check
    from calibrant.perceive.pointing.axis import FoundAxis
    from calibrant.perceive.pointing.spot import Sight, Spot

EXAMPLE = (
    'cb.point(left_corners=["102,340", "160,120", "560,352", "505,122"], left_axis=["300,60", "322,140"], '
    'right_corners=["80,330", "150,110", "540,360", "500,130"], right_axis=["210,80", "262,160"])'
)
SIDES = ("left", "right")
LEAST_FIT = 0.01
"""Chance below which corners that fit worse are doubted: once in a hundred good sets."""
SURE_CROSSING = 10.0
"""Sigmas of the crossing angle from which its inverse is normal to 1 %, and with it the spot's region."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find the spot of a working plane that a pointer points at, with two cameras that need no calibration.

    calibrant point --left left.png --right right.png --target chessboard:9x6:25mm --overlay spot.png
    calibrant point --left-corners 102,340 160,120 560,352 505,122 --left-axis 300,60 322,140 \\
        --right-corners 80,330 150,110 540,360 500,130 --right-axis 210,80 262,160 --plane 600mmx400mm

    Four corners of the plane or more, seen by both cameras in the same order, or a board that lies on it; the pointer's
    axis by two points a picture, or found there. Without --plane the corners are (0,0), (0,1), (1,0), (1,1). Lenses are
    taken as free of distortion: undistort pictures of wide ones first.
    """

    left: Annotated[Path | None, Option("IMAGE")] = None
    """The left camera's picture, where something is to be found in it or drawn."""
    right: Annotated[Path | None, Option("IMAGE")] = None
    """The right camera's."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """A board that lies on the plane, in place of corners: chessboard:9x6:25mm, or a file."""
    left_corners: Annotated[tuple[str, ...], Option("U,V")] = ()
    """Corners of the plane in the left picture, pixels."""
    right_corners: Annotated[tuple[str, ...], Option("U,V")] = ()
    """The same corners in the right picture, in the same order."""
    plane: Annotated[tuple[str, ...], Option("WxH|X,Y")] = ()
    """Size of the plane, 600mmx400mm, for corners (0,0), (0,H), (W,0), (W,H); or every corner: 0mm,0mm 0mm,400mm ..."""
    left_axis: Annotated[tuple[str, ...], Option("U,V")] = ()
    """Two points of the pointer's axis in the left picture; without them it is found: the longest elongated part."""
    right_axis: Annotated[tuple[str, ...], Option("U,V")] = ()
    """Two points of it in the right picture."""
    hue: Annotated[str | None, Option("DEG..DEG")] = None
    """Hues of the pointer that is looked for: 90..150deg is green, 345..15deg red."""
    sigma_px: Annotated[str, Option("LENGTH")] = "0.5px"
    """Noise of a corner and of a point of the axis, per axis."""
    overlay: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw corners, axis and spot over both pictures."""


def reads(request: Request) -> list[Path]:
    """The pictures."""
    return [picture for picture in (request.left, request.right) if picture is not None]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The spot. Raises: InputError for arguments that cannot be used; RefusedError where the lines do not meet."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.perceive.pointing.spot import Sight, pointing_spot

    noise = pixels(request.sigma_px, option="--sigma-px") or 0.0
    if request.overlay is not None and None in (request.left, request.right):
        raise InputError("--overlay draws over two pictures: give --left and --right")
    plane, corners, unit = _plane(request, listener)
    axes = {side: _axis(request, side) for side in SIDES}
    sights = [Sight(seen, a if isinstance(a, np.ndarray) else a.points) for seen, a in zip(corners, axes.values())]
    spot = pointing_spot(*sights, plane=plane, sigma_px=noise)
    looked_for = {side: a for side, a in axes.items() if not isinstance(a, np.ndarray)}
    checks = (*_checks(spot, plane, noise), *_pointer_check(looked_for, request.hue))
    result = _result(request, spot, unit, noise, checks)
    refuse_if_failed(result)
    drawn = () if request.overlay is None else (Document(request.overlay, partial(_picture, request, sights, spot)),)
    return Outcome(result=result, documents=drawn)


def _plane(request: Request, listener: Listener) -> tuple[Array, list[Array], str]:
    """The plane's points, where each camera sees them, and their unit."""
    from calibrant.perceive.pointing.spot import UNIT_PLANE

    if request.target is not None:
        if request.left_corners or request.right_corners or request.plane:
            raise InputError("--target gives the plane and its corners: leave out --plane and the corners")
        return _board(request, listener)
    corners = [
        _pixels(words, option=f"--{side}-corners")
        for side, words in zip(SIDES, (request.left_corners, request.right_corners))
    ]
    plane, unit = _plane_of(request.plane)
    plane = np.array(UNIT_PLANE) if plane is None else plane
    for side, seen in zip(SIDES, corners):
        if len(seen) != len(plane):
            raise InputError(
                f"--{side}-corners has {len(seen)} points, the plane {len(plane)}; expected each of its corners once"
            )
    return plane, corners, unit


def _board(request: Request, listener: Listener) -> tuple[Array, list[Array], str]:
    """The board's points that both pictures show."""
    pictures = [_needed(request, side, "a board in it") for side in SIDES]
    views = []
    for picture in pictures:
        found = session.detect_boards(
            [picture], request.target or "", mirror_x=False, workers=None, cache="none", listener=listener
        )
        if not found.views:
            raise InputError(f"{picture}: {found.missed[0].reason if found.missed else 'no board found'}")
        views.append(found.views[0])
    left, right = views
    _, a, b = np.intersect1d(left.point_ids, right.point_ids, return_indices=True)
    if len(a) < 4:
        raise InputError(f"both pictures show {len(a)} points of the board alike; expected four or more")
    if np.ptp(left.points[a, 2]) > 0:
        raise InputError("the points of the board do not lie in a plane; use a flat board")
    return left.points[a, :2], [left.uv[a], right.uv[b]], "m"


def _plane_of(words: Sequence[str]) -> tuple[Array | None, str]:
    """The plane's corners in metres, from its size or one by one; None where nothing is said."""
    from calibrant.targets.lengths import parse_coordinate, parse_length

    if not words:
        return None, ""
    if len(words) == 1:
        sides = words[0].lower().split("x")
        if len(sides) != 2:
            raise InputError(f"--plane takes a size such as 600mmx400mm, or four corners or more, got {words[0]!r}")
        w, h = (parse_length(side, what="--plane") for side in sides)
        return np.array([[0, 0], [0, h], [w, 0], [w, h]]), "m"
    parts = [word.split(",") for word in words]
    if any(len(part) != 2 for part in parts):
        raise InputError(f"--plane takes corners as X,Y with units, such as 0mm,400mm; got {' '.join(words)}")
    return np.array([[parse_coordinate(c, what="--plane") for c in part] for part in parts]), "m"


def _axis(request: Request, side: str) -> Array | FoundAxis:
    """Two points of the pointer's axis as given, or what was found in the picture."""
    from calibrant.detection.images.images import load_image
    from calibrant.perceive.pointing.axis import find_axis

    given = request.left_axis if side == "left" else request.right_axis
    if given:
        axis = _pixels(given, option=f"--{side}-axis")
        if len(axis) != 2:
            raise InputError(f"--{side}-axis takes two points of the pointer's axis, got {len(axis)}")
        return axis
    picture = _needed(request, side, f"the pointer in it (or give --{side}-axis U,V U,V)")
    try:
        return find_axis(_eight_bits(load_image(picture)), hues_deg=_hues(request.hue))
    except InputError as error:
        raise InputError(f"{picture}: {error}") from None


def _needed(request: Request, side: str, what: str) -> Path:
    picture = request.left if side == "left" else request.right
    if picture is None:
        raise InputError(f"give the {side} camera's picture, --{side} IMAGE, with {what}")
    return picture


def _eight_bits(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Colours (h, w, 3) or grey (h, w), 8 bits."""
    from calibrant.detection.images.images import to_grey8

    return image[..., :3].copy() if image.ndim == 3 and image.dtype == np.uint8 else to_grey8(image)


def _pixels(words: Sequence[str], *, option: str) -> Array:
    try:
        points = np.array([[float(c) for c in word.removesuffix("px").split(",")] for word in words])
    except ValueError:
        points = np.zeros(0)
    if words and (points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all()):
        raise InputError(f"{option} takes pixels as U,V, such as 320.5,240; got {' '.join(words)}")
    return points.reshape(-1, 2)


def _hues(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    first, dots, last = text.strip().removesuffix("deg").partition("..")
    try:
        hues = float(first.removesuffix("deg")), float(last)
    except ValueError:
        hues = (-1.0, -1.0)
    if not dots or not all(0 <= h <= 360 for h in hues):
        raise InputError(f"--hue takes two angles of the colour circle, such as 90..150deg for green; got {text!r}")
    return hues


def _result(request: Request, spot: Spot, unit: str, noise: float, checks: tuple[Check, ...]) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.details import PointedSpot
    from calibrant.data.verdicts import stamp

    C = spot.covariance
    found = {n: Measured(float(v), float(s), unit) for n, v, s in zip("xy", spot.xy, spot.sigma)}
    seen = {side: (float(u), float(v)) for side, (u, v) in zip(SIDES, spot.uv)}
    given = {"sigma_px": noise, "target": request.target, "plane": list(request.plane) or None, "hue": request.hue}
    return stamp(
        CalibrationResult(
            "pointing",
            verdict_of(checks),
            checks,
            rms_px=spot.rms_px,
            figures={**found, "radius_95": Measured(spot.radius_95, unit=unit)},
            details=(PointedSpot(unit, (float(C[0, 0]), float(C[0, 1]), float(C[1, 1])), seen),),
            options={name: value for name, value in given.items() if value is not None},
            inputs=session.file_records(reads(request)),
        )
    )


def _checks(spot: Spot, plane: Array, noise: float) -> tuple[Check, ...]:
    return _corners_check(spot, len(plane), noise), _crossing_check(spot), _inside_check(spot, plane)


def _pointer_check(found: Mapping[str, FoundAxis], hue: str | None) -> tuple[Check, ...]:
    """Whether what was taken for the pointer is one: any edge of a table or a screen is elongated, too."""
    from calibrant.data import Check

    if not found:
        return ()
    seen = "; ".join(f"in the {side} picture {axis.words}" for side, axis in found.items())
    if hue is not None:
        return (Check("pointer", "ok", f"of the hues {hue}, {seen}"),)
    options = " and ".join(f"--{side}-axis" for side in found)
    message = (
        f"nothing says that what was found is the pointer: {seen}. If it is something else, the spot is wrong by more "
        f"than its sigma: look at it (--overlay), and give the pointer's --hue, or {options}"
    )
    return (Check("pointer", "warn", message),)


def _corners_check(spot: Spot, count: int, noise: float) -> Check:
    from calibrant.data import Check

    if spot.fits is None or spot.rms_px is None:
        return Check("corners", "ok", f"{count} corners, which always fit: a wrong one would not show")
    text = f"{count} corners fit the plane to {spot.rms_px:.3g} px RMS, with {noise:g} px of noise stated (--sigma-px)"
    if spot.fits >= LEAST_FIT:
        return Check("corners", "ok", text, spot.rms_px)
    text += (
        ": noise alone does not do that; a wrong corner, a lens with distortion (undistort the pictures first), a "
        "plane that is not flat, or more noise than stated"
    )
    return Check("corners", "warn", text, spot.rms_px)


def _crossing_check(spot: Spot) -> Check:
    from calibrant.data import Check

    angle, sigma = spot.crossing_deg, spot.sigma_crossing_deg
    text = f"the two lines of sight cross at {angle:.3g} deg, known to {sigma:.2g} deg (1 sigma)"
    if angle < SURE_CROSSING * sigma:
        text += ": the spot's region is longer on one side than stated; move the cameras apart across the pointer"
        return Check("crossing", "warn", text, angle)
    return Check("crossing", "ok", text, angle)


def _inside_check(spot: Spot, plane: Array) -> Check:
    """Whether the spot lies among the corners: beyond them the plane is extrapolated."""
    from calibrant.data import Check

    low, high = plane.min(axis=0), plane.max(axis=0)
    if np.all(spot.xy >= low) and np.all(spot.xy <= high):
        return Check("inside", "ok", "the spot lies between the corners")
    beyond = float(np.max(np.maximum(low - spot.xy, spot.xy - high) / (high - low)))
    text = f"the spot lies outside of the corners, by {beyond:.2g} of the plane's size: there the plane is extrapolated"
    return Check("inside", "warn", text, beyond)


def _picture(request: Request, sights: Sequence[Sight], spot: Spot) -> bytes:
    """Both pictures beside each other, with corners, axes and the spot."""
    from calibrant.detection.images.images import load_image
    from calibrant.opencv import cv2
    from calibrant.perceive.pointing.drawing import drawn

    images = [_eight_bits(load_image(_needed(request, side, "what is drawn"))) for side in SIDES]
    suffix = request.overlay.suffix if request.overlay is not None else ".png"
    if not suffix or not cv2.haveImageWriter(f"a{suffix}"):
        raise InputError(f"--overlay {request.overlay}: expected the name of a picture, such as spot.png")
    return bytes(cv2.imencode(suffix, drawn(images, sights, spot))[1])
