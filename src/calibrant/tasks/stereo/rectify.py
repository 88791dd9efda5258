"""Rectify pairs of pictures: the pictures, their cameras, the maps, Q, and how well matches share a row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels, split_names
from calibrant.tasks.outcome import Document, Outcome, result_document
from calibrant.tasks.pictures import check_maps, encoded, maps_bytes, picture_name, size_or_width
from calibrant.tasks.stereo.pairs import common_points, corners_of, paired

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, Check
    from calibrant.data.details import Triple
    from calibrant.perceive.stereo.rectification import Rectification

EXAMPLE = 'cb.rectify("stereo.json", left="left/*.png", right="right/*.png", out="rectified")'
RESULT_FILE = "rectified.json"
SIDES = ("left", "right")
EXCHANGED = 3.0
"""Times by which rows agree better with the sides exchanged, from which they are: right ones agree 10 times better."""
LARGE_ROW_PX = 0.5
"""Row error, RMS, from which a search along one row misses the best match by half a pixel and more."""


@dataclass(frozen=True, kw_only=True)
class RectifiedOptions:
    """What the rectified pictures are like."""

    cameras: Annotated[str | None, Option("LEFT,RIGHT")] = None
    """Names of two cameras of the result, where it has more than two."""
    alpha: Annotated[float, Option("0..1")] = 0.0
    """0: no pixel without a source; 1: every source pixel is shown."""
    size: Annotated[str | None, Option("WxH")] = None
    """Size of the rectified pictures, e.g. 1280x960, or their width alone, 1280; the left camera's without it."""
    focal: Annotated[str | None, Option("PX")] = None
    """Their focal length, e.g. 800px, in place of the one that alpha chooses."""
    projection: Annotated[str, Option("pinhole|cylinder", choices=("pinhole", "cylinder"))] = "pinhole"
    """cylinder: about the baseline, for lenses that see farther across the rows than a pinhole can show."""
    principal: Annotated[str, Option("equal|own", choices=("equal", "own"))] = "equal"
    """Principal points of both pictures in one column, so that disparity 0 is infinitely far; or each picture's own."""

    def pair(self, result: CalibrationResult) -> Rectification:
        """The rectification of two cameras of a result. Raises: InputError as the parts do."""
        from calibrant.perceive.stereo.eyes import eyes_of
        from calibrant.perceive.stereo.rectification import rectification

        names = None if self.cameras is None else split_names([self.cameras])
        if names is not None and len(names) != 2:
            raise InputError(f"--cameras takes the names of two cameras, left,right; got {self.cameras!r}")
        eyes = eyes_of(result, names)
        return rectification(
            eyes,
            alpha=self.alpha,
            image_size=None if self.size is None else size_or_width(self.size, eyes.cameras[0].image_size),
            projection=self.projection,  # type: ignore[arg-type]
            principal=self.principal,  # type: ignore[arg-type]
            focal_px=pixels(self.focal, option="--focal"),
        )

    @property
    def words(self) -> dict[str, Any]:
        """What the result file keeps."""
        given = {"cameras": self.cameras, "size": self.size, "focal": self.focal}
        said = {"alpha": self.alpha, "projection": self.projection, "principal": self.principal}
        return {**said, **{name: value for name, value in given.items() if value is not None}}


@dataclass(frozen=True, kw_only=True)
class Request:
    """Rectify pairs of pictures, so that what both show lies on one row.

    calibrant rectify stereo.json --left left/*.png --right right/*.png --out rectified --rows rows
    calibrant rectify stereo.json --maps maps.npz --alpha 1

    From a result with two cameras or more (calibrant stereo, calibrant rig), or OpenCV's stereo.yml. Prints what the
    board's corners are off from a common row. Cameras above each other get common columns.
    """

    result: Annotated[Path, Option("RESULT", positional=True)]
    """The calibration of both cameras: a result file, or stereo.yml as OpenCV has it."""
    left: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Pictures of the left (first, upper) camera: files, folders or patterns."""
    right: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Those of the right one, in the same order."""
    out: Annotated[Path | None, Option("DIR", "-o", output="folder")] = None
    """Write the rectified pictures here, in left and right, with rectified.json, the cameras they are of."""
    rectified: RectifiedOptions = RectifiedOptions()
    maps: Annotated[Path | None, Option("FILE", output="file")] = None
    """Write maps, cameras and Q, for cv2.remap and cv2.reprojectImageTo3D: .npz, or .yml or .yml.gz as OpenCV reads."""
    rows: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Draw every pair with its rows here, before and after."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """A board in these pictures, on which row errors are measured; without it, on the calibration's own corners."""


def reads(request: Request) -> list[Path]:
    """The result file and the pictures."""
    left, right = _files(request)
    return [request.result, *left, *right]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The maps, and two pictures of each pair.

    Raises: InputError for unusable arguments; RefusedError where the sides are exchanged.
    """
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.cameras.read import read_pair

    check_maps(request.maps)
    pairs, how = paired(*_files(request))
    if not pairs and request.maps is None:
        raise InputError("what shall be rectified? Give --left and --right pictures, or --maps FILE")
    if pairs and request.out is None and request.rows is None:
        raise InputError("where shall the pictures go? Give a folder: --out rectified, or --rows DIR")
    result = read_pair(request.result)
    pair = request.rectified.pair(result)
    corners = _corners(request, result, pair, pairs, listener)
    if pairs:
        with listener.status("Computing the maps …"):
            _ = pair.maps
        _require_sizes(pair, pairs)
    done = rectified_result(pair, corners, request, how)
    refuse_if_failed(done)
    return Outcome(result=done, documents=_written(done, pair, pairs, request))


def _files(request: Request) -> tuple[list[Path], list[Path]]:
    from calibrant.detection.images.files import expand

    left, right = (expand(list(side)) if side else [] for side in (request.left, request.right))
    return left, right


def _require_sizes(pair: Rectification, pairs: Sequence[tuple[Path, Path]]) -> None:
    """Raises: InputError naming the picture and its side, of another size than its camera's."""
    for files in pairs:
        for i, (file, side) in enumerate(zip(files, SIDES)):
            try:
                pair.maps[i].require(_photo(file))
            except InputError as error:
                raise InputError(f"{file}, a {side} picture (camera {pair.eyes.names[i]}): {error}") from None


def _photo(file: Path) -> Any:
    from calibrant.detection.images.images import load_image

    return load_image(file)


def _corners(
    request: Request,
    result: CalibrationResult,
    pair: Rectification,
    pairs: Sequence[tuple[Path, Path]],
    listener: Listener,
) -> list[Array]:
    """Pixels (2, n, 2) of corners that both cameras see, by pair."""
    if request.target is None:
        return [uv for uv, _ in corners_of(result, pair.eyes.names).values()]
    if not pairs:
        raise InputError("--target names a board in pictures: give --left and --right")
    sides = []
    for files in zip(*pairs, strict=True):
        found = session.detect_boards(
            list(files), request.target, mirror_x=False, workers=None, cache=None, listener=listener
        )
        sides.append({v.file or v.id: v for v in found.views})
    both = []
    for left, right in pairs:
        a, b = (
            next((v for f, v in side.items() if Path(f).name == p.name), None) for side, p in zip(sides, (left, right))
        )
        if a is not None and b is not None:
            uv, _ = common_points(a, b)
            both.append(uv)
    if not both:
        raise InputError(f"no pair shows {request.target} in both pictures")
    return both


def rectified_result(pair: Rectification, corners: Sequence[Array], request: Request, how: str) -> CalibrationResult:
    """The rectified cameras as a result, with its checks. how: the pictures were paired."""
    from calibrant.data import CalibrationResult, Measured, as_transform, verdict_of
    from calibrant.data.details import RectifiedPair
    from calibrant.data.verdicts import stamp

    names, flat = pair.eyes.names, pair.views[0].projection == "pinhole"
    checks = (_rows_check(pair, corners), _sides_check(pair, corners))
    a, b = pair.views
    detail = RectifiedPair(
        a.projection,
        ("x", "y")[pair.along],
        a.f,
        ((a.cx, a.cy), (b.cx, b.cy)),
        a.image_size,
        pair.baseline,
        (_rows_of(pair.R_rectified_camera[0]), _rows_of(pair.R_rectified_camera[1])),
    )
    row = {} if not corners else {"row_error": Measured(_rms(pair, corners), unit="px")}
    return stamp(
        CalibrationResult(
            "rectified",
            verdict_of(checks),
            checks,
            cameras=dict(zip(names, pair.cameras)) if flat else {},
            transforms=(as_transform(names[0], names[1], pair.T_left_right),) if flat else (),
            figures={**row, "baseline": Measured(abs(pair.baseline), unit="m")},
            options=request.rectified.words,
            decided={"pairs": how} if how else {},
            details=(detail,),
            inputs=session.file_records(reads(request)),
        )
    )


def _rows_of(R: Array) -> tuple[Triple, Triple, Triple]:
    a, b, c = ((float(x), float(y), float(z)) for x, y, z in R)
    return a, b, c


def _rms(pair: Rectification, corners: Sequence[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.concatenate([pair.row_errors(uv) for uv in corners]) ** 2)))


def _rows_check(pair: Rectification, corners: Sequence[Array]) -> Check:
    from calibrant.data import Check

    line = ("row", "column")[pair.along]
    if not corners:
        return Check(
            "rows", "ok", f"no corners at hand to measure {line} errors on; --target names a board in the pictures"
        )
    rms = _rms(pair, corners)
    raw = np.concatenate([uv[0] - uv[1] for uv in corners])[:, 1 - pair.along]
    text = (
        f"{sum(uv.shape[1] for uv in corners)} corners of {len(corners)} pairs share a {line} to {rms:.3g} px RMS; "
        f"{np.sqrt(np.mean(raw**2)):.3g} px before"
    )
    if rms < LARGE_ROW_PX:
        return Check("rows", "ok", text, rms)
    return Check("rows", "warn", f"{text}: matches are missed; did a camera move since it was calibrated?", rms)


def _sides_check(pair: Rectification, corners: Sequence[Array]) -> Check:
    """Whether left is left: by the baseline's sign, and by the rows where corners are at hand."""
    from calibrant.data import Check

    left, right = pair.eyes.names
    beside, other = (("to the right of", "left"), ("below", "above"))[pair.along]
    if corners and pair.eyes.cameras[0].image_size == pair.eyes.cameras[1].image_size:
        exchanged = _rms(pair, [uv[::-1] for uv in corners])
        rms = _rms(pair, corners)
        if rms > LARGE_ROW_PX and exchanged * EXCHANGED < rms:
            text = (
                f"the sides are exchanged: as given the pictures share rows to {rms:.3g} px, the other way round to "
                f"{exchanged:.3g} px; exchange --left and --right"
            )
            return Check("sides", "fail", text, exchanged)
    if pair.baseline < 0:
        text = (
            f"{left} stands {beside} {right}, so that disparities are negative; --cameras {right},{left} with the "
            f"pictures exchanged makes {right} the {other} one"
        )
        return Check("sides", "warn", text, pair.baseline)
    return Check("sides", "ok", f"{right} stands {beside} {left}, {1e3 * pair.baseline:.2f} mm away", pair.baseline)


def _written(
    done: CalibrationResult, pair: Rectification, pairs: Sequence[tuple[Path, Path]], request: Request
) -> Iterator[Document]:
    if request.maps is not None:
        yield Document(request.maps, partial(_maps, pair, request.maps))
    if request.out is not None:
        yield result_document(done, request.out / RESULT_FILE)
    for files in pairs:
        checkpoint()
        for i, (file, side) in enumerate(zip(files, SIDES)):
            if request.out is not None:
                target = request.out / side / picture_name(file)
                yield Document(target, partial(_picture, pair, i, file, target))
        if request.rows is not None:
            path = request.rows / f"{files[0].stem}-rows.png"
            yield Document(path, partial(_rows_picture, pair, files, path))


def _maps(pair: Rectification, path: Path) -> bytes:
    return maps_bytes(path, _arrays(pair))


def _picture(pair: Rectification, i: int, file: Path, target: Path) -> bytes:
    return encoded(pair.maps[i].apply(_photo(file)), target)


def _rows_picture(pair: Rectification, files: tuple[Path, Path], path: Path) -> bytes:
    from calibrant.perceive.stereo.drawing import drawn_rows

    return encoded(drawn_rows(pair, [_photo(f) for f in files]), path)


def _arrays(pair: Rectification) -> Mapping[str, Array]:
    """Maps, turns, cameras and Q by name, as a maps file has them."""
    out: dict[str, Array] = {}
    for i, side in enumerate(SIDES):
        u, v = pair.maps[i].finite_maps()
        out |= {f"{side}_map_u": u.astype(np.float32), f"{side}_map_v": v.astype(np.float32)}
        out[f"R_{side}"] = pair.R_rectified_camera[i]
        view = pair.views[i]
        out[f"K_{side}"] = np.array([[view.f, 0, view.cx], [0, view.f, view.cy], [0, 0, 1]])
    if pair.views[0].projection == "pinhole":
        out["Q"] = pair.Q
    out["baseline"] = np.array([[pair.baseline]])
    return out
