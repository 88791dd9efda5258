"""How two pictures see each other: the fundamental matrix, the relative pose of their cameras, the lines drawn."""

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
from calibrant.tasks.pictures import encoded

if TYPE_CHECKING:
    from calibrant.arrays import Array, Mask
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check
    from calibrant.data.details_stereo import Matrix
    from calibrant.perceive.stereo.epipolar import RelativePose
    from calibrant.perceive.stereo.lines import Line

EXAMPLE = 'cb.epipolar(left="left.png", right="right.png", camera=["left.json", "right.json"], drawing="lines.png")'
POINT_COLUMNS = (
    *("u_left", "v_left", "u_right", "v_right", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"),
    "sigma_z_calibration",
)
FEW = 0.5
"""Part of the matches that fit, below which the geometry rests on the fewer ones."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find the epipolar geometry of two pictures from what both show.

    calibrant epipolar --left left.png --right right.png --drawing lines.png
    calibrant epipolar --left left.png --right right.png --camera left.json right.json --baseline 120mm

    Without cameras the fundamental matrix of the pictures as they are. With cameras the relative pose with its
    uncertainty: pictures tell no length, so that its place is in baselines, or in metres with --baseline. With --stereo
    the lines are those of a calibration, and the matches say whether it still holds.
    """

    left: Annotated[Path, Option("IMAGE")]
    """One picture."""
    right: Annotated[Path, Option("IMAGE")]
    """The other, of the same scene from another place."""
    camera: Annotated[tuple[str, ...], Option("FILES", "-c")] = ()
    """The cameras of left and right, or one file for both (any format)."""
    stereo: Annotated[Path | None, Option("RESULT")] = None
    """A calibration of both cameras (calibrant stereo, calibrant rig), or stereo.yml as OpenCV has it."""
    matches: Annotated[Path | None, Option("FILE.csv")] = None
    """Matches of your own: columns u_left, v_left, u_right, v_right; without it features are matched."""
    sigma_px: Annotated[str, Option("LENGTH")] = "0.5px"
    """Noise of a right match, per axis: what is farther than three of it from its line is wrong."""
    baseline: Annotated[str | None, Option("LENGTH")] = None
    """Distance of the cameras, 120mm, where it is known."""
    drawing: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw matches and lines over both pictures."""
    points: Annotated[Path | None, Option("FILE.csv", output="file")] = None
    """With --stereo: the points that the matches on their lines are of, left camera's frame, metres, with 1 sigma."""


def reads(request: Request) -> list[Path]:
    """Pictures, cameras, matches, the calibration."""
    more = [request.stereo, request.matches]
    return [request.left, request.right, *map(Path, request.camera), *(p for p in more if p is not None)]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The geometry. Raises: InputError for unusable arguments; RefusedError where the matches tell none."""
    from calibrant.detection.images.images import load_image
    from calibrant.perceive.stereo.epipolar import fundamental_from_matches, relative_pose

    if request.camera and request.stereo is not None:
        raise InputError("--stereo holds the cameras: leave out --camera")
    if request.baseline is not None and not request.camera:
        raise InputError("--baseline gives a relative pose its length: give --camera too")
    if request.points is not None and request.stereo is None:
        raise InputError("--points are measured by a calibration of both cameras: give --stereo")
    sigma = pixels(request.sigma_px, option="--sigma-px") or 0.0
    images = [load_image(file) for file in (request.left, request.right)]
    sizes = [(image.shape[1], image.shape[0]) for image in images]
    with listener.status("Matching …"):
        uv = _matches(request, images)
    if request.stereo is not None:
        result, lines, fitting = _calibrated(request, uv, sizes, sigma)
    elif request.camera:
        cameras = _cameras(request, sizes)
        pose = relative_pose(cameras, *uv, sigma_px=sigma)
        result, lines, fitting = _posed(request, cameras, pose, uv)
    else:
        from calibrant.perceive.stereo.lines import line_of_matrix

        found = fundamental_from_matches(*uv, sigma_px=sigma)
        lines = (line_of_matrix(found.F, sizes[1]), line_of_matrix(found.F.T, sizes[0]))
        fitting = found.fitting
        result = _result(request, uv, fitting, found.rms_px, F=found.F)
    documents = []
    if request.drawing is not None:
        documents.append(Document(request.drawing, partial(_drawn, images, uv[:, fitting], lines, request.drawing)))
    if request.points is not None:
        documents.append(Document(request.points, _points_csv(request, uv[:, fitting], sigma)))
    return Outcome(result=result, documents=documents)


def _points_csv(request: Request, uv: Array, sigma: float) -> bytes:
    """Pixels and points of the matches, a row each; those whose rays do not meet before the cameras are left out."""
    from calibrant.formats.cameras.read import read_pair
    from calibrant.perceive.stereo.eyes import eyes_of
    from calibrant.perceive.stereo.points import points_from_matches

    found = points_from_matches(eyes_of(read_pair(request.stereo)), uv, sigma_px=sigma)  # type: ignore[arg-type]
    sigmas = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    by_calibration = np.sqrt(found.calibration[:, 2, 2])
    table = np.column_stack([uv[0], uv[1], found.points, sigmas, by_calibration])[found.found]
    lines = [",".join(POINT_COLUMNS), *(",".join(f"{v:.9g}" for v in row) for row in table)]
    return ("\n".join(lines) + "\n").encode()


def _matches(request: Request, images: list[Any]) -> Array:
    """Pixels (2, n, 2)."""
    from calibrant.detection.images.images import to_grey8
    from calibrant.perceive.stereo.sparse import sparse_matches
    from calibrant.tasks.inputs.columns import read_columns

    if request.matches is not None:
        table = read_columns(request.matches, ("u_left", "v_left", "u_right", "v_right")).values
        return np.stack([table[:, :2], table[:, 2:]])
    greys = [to_grey8(image).astype(np.float64) for image in images]
    whole = [np.ones(g.shape, dtype=np.bool_) for g in greys]
    found = sparse_matches(greys[0], greys[1], valid=(whole[0], whole[1]))
    return np.stack([found.left, found.right])


def _cameras(request: Request, sizes: list[tuple[int, int]]) -> tuple[Camera, Camera]:
    from calibrant.formats.cameras.read import read_camera

    files = list(request.camera)
    if len(files) > 2:
        raise InputError(f"--camera takes the files of two cameras, or one for both, got {len(files)}")
    a, b = (read_camera(Path(file), image_size=size) for file, size in zip((files[0], files[-1]), sizes))
    return a, b


def _calibrated(
    request: Request, uv: Array, sizes: list[tuple[int, int]], sigma: float
) -> tuple[CalibrationResult, tuple[Line, Line], Mask]:
    """The lines of a calibration, and how far matches are from them."""
    from calibrant.formats.cameras.read import read_pair
    from calibrant.geometry import projective, se3
    from calibrant.perceive.stereo.epipolar import FAR, sampson_px
    from calibrant.perceive.stereo.eyes import eyes_of
    from calibrant.perceive.stereo.lines import line_of_cameras

    eyes = eyes_of(read_pair(request.stereo))  # type: ignore[arg-type]
    for name, camera, size in zip(eyes.names, eyes.cameras, sizes):
        if camera.image_size != size:
            w, h = camera.image_size
            raise InputError(f"the picture of {name} is {size[0]}x{size[1]} px, the camera is for {w}x{h} px")
    T = eyes.T_first_camera[1]
    off = sampson_px(eyes.cameras, T, uv[0], uv[1])
    fitting = np.asarray(np.abs(off) <= FAR * sigma)
    back = se3.inverse(T)
    lines = (line_of_cameras(eyes.cameras, back), line_of_cameras(eyes.cameras[::-1], T))
    rms = float(np.sqrt(np.mean(off[fitting] ** 2))) if fitting.any() else float("nan")
    E = projective.essential_from_transform(back)
    return _result(request, uv, fitting, rms, E=E / np.linalg.norm(E)), lines, fitting


def _posed(
    request: Request, cameras: tuple[Camera, Camera], pose: RelativePose, uv: Array
) -> tuple[CalibrationResult, tuple[Line, Line], Mask]:
    from calibrant.data import as_transform
    from calibrant.geometry import se3
    from calibrant.perceive.stereo.lines import line_of_cameras
    from calibrant.targets.lengths import parse_length

    length = 1.0 if request.baseline is None else parse_length(request.baseline, what="--baseline")
    T, scale = pose.T_a_b.copy(), np.diag([1.0] * 3 + [length] * 3)
    T[:3, 3] *= length
    place = as_transform("left", "right", T, scale @ pose.covariance @ scale)
    lines = (line_of_cameras(cameras, se3.inverse(T)), line_of_cameras(cameras[::-1], T))
    E = pose.E / np.linalg.norm(pose.E)
    made = _result(request, uv, pose.fitting, pose.sigma_px, E=E, cameras=cameras, transforms=(place,))
    return made, lines, pose.fitting


def _result(
    request: Request,
    uv: Array,
    fitting: Mask,
    rms: float,
    *,
    F: Array | None = None,
    E: Array | None = None,
    cameras: tuple[Camera, ...] = (),
    transforms: tuple[Any, ...] = (),
) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Measured, verdict_of
    from calibrant.data.details import EpipolarMatrices
    from calibrant.data.verdicts import refuse_if_failed, stamp

    checks = (_matches_check(request, fitting, rms),)
    given = {
        "sigma_px": request.sigma_px,
        "baseline": request.baseline,
        "stereo": request.stereo and str(request.stereo),
    }
    made = stamp(
        CalibrationResult(
            "epipolar",
            verdict_of(checks),
            checks,
            cameras=dict(zip(("left", "right"), cameras)),
            transforms=transforms,
            figures={
                "matches": Measured(float(uv.shape[1])),
                "fitting": Measured(float(fitting.sum())),
                "rms": Measured(rms, unit="px"),
            },
            details=(EpipolarMatrices(_matrix(F), _matrix(E)),),
            options={name: value for name, value in given.items() if value is not None},
            inputs=session.file_records(reads(request)),
        )
    )
    refuse_if_failed(made)
    return made


def _matrix(M: Array | None) -> Matrix | None:
    if M is None:
        return None
    a, b, c = ((float(x), float(y), float(z)) for x, y, z in M)
    return a, b, c


def _matches_check(request: Request, fitting: Mask, rms: float) -> Check:
    from calibrant.data import Check

    share = float(fitting.mean()) if len(fitting) else 0.0
    text = f"{int(fitting.sum())} of {len(fitting)} matches lie on their lines, to {rms:.3g} px RMS"
    if share >= FEW:
        return Check("matches", "ok", text, share)
    if request.stereo is not None:
        text += ": did a camera move since the calibration, or are the sides exchanged?"
        return Check("matches", "warn" if share > FEW / 2 else "fail", text, share)
    return Check("matches", "warn", f"{text}: most are wrong, or noisier than --sigma-px says", share)


def _drawn(images: list[Any], uv: Array, lines: tuple[Line, Line], path: Path) -> bytes:
    from calibrant.perceive.stereo.lines import drawn_lines

    return encoded(drawn_lines(images, uv, lines), path)
