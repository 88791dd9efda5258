"""Teach a wanted pose: what the camera sees from there, by its own pictures or, beforehand, from stereo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, Check, View
    from calibrant.servoing.sight.features import Features
    from calibrant.servoing.sight.mounting import Mounting

EXAMPLE = 'cb.servo_teach("hand-eye.json", images="wanted/*.png", target="charuco:7x5:30mm:22mm:DICT_4X4_50")'
MOVED = 5.0
"""Sigmas by which pictures of one place may scatter: what they share, light and haze, is a few; a motion is tens."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Teach the pose that `servo run` leads the arm to: what the camera sees from there.

    calibrant servo teach hand-eye.json --images wanted/*.png --target marker:100mm:DICT_5X5_50:7 --out target.json
    calibrant servo teach hand-eye.json --rig rig.json --left l.png --right r.png --stand-off 250mm \\
        --target marker:100mm:DICT_5X5_50:7 --out target.json

    From one picture or several of the camera at the wanted place, or beforehand from a stereo pair, with the camera
    facing what the pair sees from a distance. Says how certain the pose is that the features tell, and how wrong the
    calibration may be before servoing fails.
    """

    result: Annotated[Path, Option("RESULT.json", positional=True)]
    """The camera that will lead the arm: a hand-eye result, on the gripper or beside the robot."""
    target: Annotated[str, Option("SPEC", "-t")]
    """What bears the features: a board, a marker or a bundle of markers."""
    images: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos by the camera from the wanted place; several are averaged."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera, where the result has several."""
    rig: Annotated[Path | None, Option("RIG.json")] = None
    """A pair of cameras that see the target, instead: the features' places come from both."""
    left: Annotated[Path | None, Option("PHOTO")] = None
    """The pair's first photo."""
    right: Annotated[Path | None, Option("PHOTO")] = None
    """The pair's second photo, of the same moment."""
    stand_off: Annotated[str | None, Option("LENGTH")] = None
    """With --rig: the distance from which the camera is to face the target, such as 250mm."""
    turn: Annotated[str, Option("ANGLE")] = "0deg"
    """With --rig: turned about its line of sight by this much against the target's first row."""


def reads(request: Request) -> list[str | Path]:
    """The result, the photos, the rig."""
    from calibrant.detection.images.files import expand

    named = [f for f in (request.rig, request.left, request.right) if f is not None]
    return [request.result, *(expand(list(request.images)) if request.images else []), *named]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The target file. Raises: InputError; RefusedError where the features tell no pose."""
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.result_file import read_result
    from calibrant.data.verdicts import refuse_if_failed, stamp
    from calibrant.servoing.sight.features import remaining
    from calibrant.servoing.sight.mounting import Mounting
    from calibrant.servoing.teach import record_of

    known = read_result(request.result)
    name = camera_name(known, request.name)
    camera, mounting = known.cameras[name], Mounting.of(known, name)
    session.load_solver(listener)
    features, pictures, checks = (
        _by_stereo(request, known, name, listener)
        if request.rig is not None
        else _by_own(request, known, name, listener)
    )
    told = remaining(features, features, _every())
    record = record_of(
        features, target=request.target, setup=mounting.setup, image_size=camera.image_size, pictures=pictures,
        source="picture" if request.rig is None else "stereo",
    )  # fmt: skip
    margin, stable = margin_check(features, known, name, mounting)
    checks = (*checks, stable)
    figures = {
        "features": Measured(len(features)),
        "wanted position": Measured(0.0, told.sigma_mm / 2**0.5, "mm"),
        "wanted turn": Measured(0.0, told.sigma_deg / 2**0.5, "deg"),
        "distance": Measured(1e3 * features.middle_depth, unit="mm"),
        **margin,
    }
    result = stamp(
        CalibrationResult(
            "servo-target", verdict_of(checks), checks, cameras={name: camera},
            transforms=tuple(t for t in known.transforms if t.child == name and t.parent in ("gripper", "base")),
            sigma_px=known.sigma_px, figures=figures, details=(record,),
            inputs=session.file_records(reads(request)), options={"target": request.target},
        )
    )  # fmt: skip
    refuse_if_failed(result)
    return Outcome(result=result)


def camera_name(known: CalibrationResult, asked: str | None) -> str:
    """The camera that leads. Raises: InputError listing the names."""
    names = list(known.cameras)
    if asked is not None and asked not in names:
        raise InputError(f"--name {asked}: the calibration has {', '.join(names) or 'no camera'}")
    if asked is None and len(names) != 1:
        raise InputError(f"the calibration has {len(names)} cameras ({', '.join(names)}); choose one with --name")
    return asked or names[0]


def margin_check(features: Features, known: CalibrationResult, name: str, mounting: Mounting) -> tuple[dict, Check]:
    """The margin of the loop as figures, and in words."""
    import numpy as np

    from calibrant.data import Measured
    from calibrant.servoing.result import stability_check
    from calibrant.servoing.stability import margin_of

    margin = margin_of(features, known.cameras[name], mounting, np.eye(4))
    figures = {
        "margin": Measured(round(margin.at_sigma, 4)),
        "focal length, low": Measured(round(margin.focal_low, 3)),
        "focal length, high": Measured(round(margin.focal_high, 3)),
        "mounting, turn": Measured(round(margin.hand_eye_deg, 1), unit="deg"),
    }
    return figures, stability_check(margin)


def _every() -> Array:
    import numpy as np

    return np.eye(6)


def _by_own(
    request: Request, known: CalibrationResult, name: str, listener: Listener
) -> tuple[Features, int, tuple[Check, ...]]:
    """From the camera's own photos."""
    from calibrant.data import Check
    from calibrant.servoing.teach import taught_in

    if not request.images:
        raise InputError("nothing to teach by: give photos from the wanted place (--images), or a stereo pair (--rig)")
    views = _seen(request, list(request.images), name, listener)
    features, scatter = taught_in(known.cameras[name], views, sigma_px=known.sigma_px or 0.2)
    words = f"{len(views)} picture{'s' if len(views) > 1 else ''} of {len(features)} features"
    if len(views) > 1:
        words += f", which scatter by {scatter:.2g} of their sigma"
    if scatter >= MOVED:
        moved = Check("features", "warn", f"{words}: did camera or target move meanwhile?", scatter)
        return features, len(views), (moved,)
    return features, len(views), (Check("features", "ok", words, scatter),)


def _seen(request: Request, images: list[str], camera: str, listener: Listener) -> tuple[View, ...]:
    from calibrant.detection.images.files import expand

    found = session.detect_boards(
        expand(images), request.target, mirror_x=False, workers=None, camera=camera, listener=listener
    )
    if not found.views:
        raise InputError(f"no photo of camera {camera} shows the target; the first: {found.missed[0].reason}")
    return found.views


def _by_stereo(
    request: Request, known: CalibrationResult, name: str, listener: Listener
) -> tuple[Features, int, tuple[Check, ...]]:
    """From a pair's photos and a distance."""
    import numpy as np

    from calibrant.data import Check
    from calibrant.data.result_file import read_result
    from calibrant.geometry import se3
    from calibrant.servoing.teach import by_stereo, facing, placed, seen_from
    from calibrant.targets.lengths import parse_length

    if request.rig is None or request.left is None or request.right is None or request.stand_off is None:
        raise InputError("teaching from stereo takes --rig, --left, --right and --stand-off, such as 250mm")
    if request.images:
        raise InputError("--images and --rig are two ways to teach: give one of them")
    rig = read_result(request.rig)
    if len(rig.cameras) != 2 or not rig.transforms:
        raise InputError(f"{request.rig}: expected the result of two cameras (calibrant stereo or rig)")
    first, second = rig.cameras
    other_place = next((t for t in rig.transforms if {t.parent, t.child} == {first, second}), None)
    if other_place is None:
        raise InputError(f"{request.rig} does not say where {second} is to {first}")
    T = other_place.matrix if other_place.parent == first else se3.inverse(other_place.matrix)
    (left,) = _seen(request, [str(request.left)], first, listener)
    (right,) = _seen(request, [str(request.right)], second, listener)
    _, one, two = np.intersect1d(left.point_ids, right.point_ids, return_indices=True)
    if len(one) < 4:
        raise InputError(f"{len(one)} features are in both photos; 4 are needed")
    points, C = by_stereo(rig.cameras[first], rig.cameras[second], T, left.uv[one], right.uv[two], rig.sigma_px or 0.2)
    distance = parse_length(request.stand_off, what="--stand-off")
    T_left_target = placed(left.points[one], points)
    in_target = se3.apply(se3.inverse(T_left_target), points)
    turn = np.deg2rad(degrees(request.turn, option="--turn"))
    R = T_left_target[:3, :3]
    features = seen_from(
        known.cameras[name], left.point_ids[one], in_target, facing(in_target, distance, turn=turn), R.T @ C @ R
    )
    sigma = 1e3 * float(np.sqrt(np.median(np.trace(C, axis1=1, axis2=2))))
    words = f"{len(one)} features measured by {first} and {second}, each to {sigma:.2g} mm (1 sigma)"
    return features, 2, (Check("features", "ok", words, sigma),)


def degrees(text: str, *, option: str) -> float:
    """An angle with its unit: 30deg. Raises: InputError."""
    try:
        value = float(text.strip().removesuffix("deg"))
    except ValueError:
        value = float("nan")
    if not text.strip().endswith("deg") or not abs(value) < float("inf"):
        raise InputError(f"{option} takes an angle with its unit, such as 30deg; got {text!r}")
    return value
