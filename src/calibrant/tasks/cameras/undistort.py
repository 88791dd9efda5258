"""Undistort photos: choose the output camera, turn every photo; the pictures, their camera and the maps are written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome, result_document
from calibrant.tasks.pictures import check_maps, encoded, maps_bytes, picture_name, size_of

if TYPE_CHECKING:
    from rich.text import Text

    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult
    from calibrant.perceive.undistort import Undistortion

EXAMPLE = 'cb.undistort("photos/*.jpg", camera="camera.json", out="straight", alpha=0.0)'

CAMERA_FILE = "camera.json"


@dataclass(frozen=True, kw_only=True)
class OutputCameraOptions:
    """What is said of the output camera; nothing: the camera's size and its scale at the axis."""

    alpha: Annotated[float | None, Option("0..1")] = None
    """0: no pixel without a source; 1: every source pixel is shown; between: as OpenCV."""
    to: Annotated[Path | None, Option("FILE")] = None
    """Make pictures of this camera."""
    size: Annotated[str | None, Option("WxH")] = None
    """Size of the pictures, e.g. 1280x960."""
    focal: Annotated[str | None, Option("PX")] = None
    """Their focal length, e.g. 800px."""

    def camera(self, source: Camera) -> Camera:
        """The output camera. Raises: InputError for choices that contradict each other or cannot be read."""
        from calibrant.formats.cameras.read import read_camera
        from calibrant.perceive.output_cameras import axis_camera, focal_camera, optimal_camera

        size = None if self.size is None else size_of(self.size)
        if self.to is not None:
            if self.alpha is not None or size is not None or self.focal is not None:
                raise InputError("--to gives the whole camera; leave out --alpha, --size and --focal")
            return read_camera(self.to)
        if self.alpha is not None and self.focal is not None:
            raise InputError("--alpha chooses the focal length; leave out --alpha or --focal")
        if self.alpha is not None:
            return optimal_camera(source, self.alpha, image_size=size)
        focal = pixels(self.focal, option="--focal")
        if focal is not None:
            return focal_camera(source, focal, image_size=size)
        return axis_camera(source, image_size=size)

    @property
    def words(self) -> dict[str, object]:
        """What the result file keeps."""
        given = {"alpha": self.alpha, "to": self.to and str(self.to), "size": self.size, "focal": self.focal}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Request:
    """Undistort photos.

    calibrant undistort photos/*.jpg --camera camera.json --out straight --alpha 0

    Without --alpha, --to, --size or --focal the pictures keep the camera's size and its scale at the axis. 16 bits stay
    16 bits. Prints which part of the pictures has no source.
    """

    images: Annotated[tuple[str, ...], Option("IMAGES...", positional=True)] = ()
    """Photos, folders or patterns."""
    camera: Annotated[Path | None, Option("FILE", "-c")] = None
    """The camera that took them."""
    out: Annotated[Path | None, Option("DIR", "-o", output="folder")] = None
    """Write the pictures here, under their own names, with camera.json, the camera they then are of."""
    output: OutputCameraOptions = OutputCameraOptions()
    maps: Annotated[Path | None, Option("FILE", output="file")] = None
    """Write the maps for cv2.remap: .npz, or .yml or .yml.gz in OpenCV's format."""
    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""


def reads(request: Request) -> list[Path]:
    """The photos, and the camera's file."""
    return [*_photos(request), *([request.camera] if request.camera is not None else [])]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The output camera, and a picture of each photo that can be used.

    Raises: InputError for unusable arguments, or when no photo could be used.
    """
    if request.camera is None:
        raise InputError("which camera took the photos? Give its file: --camera camera.json")
    if request.out is None and (request.images or request.maps is None):
        raise InputError("where shall the pictures go? Give a folder: --out straight (or no photos and --maps FILE)")
    files = _photos(request)
    targets = _targets(files, request)
    camera = _source_camera(request.camera, files)
    output = request.output.camera(camera)

    from calibrant.perceive.undistort import undistortion

    with listener.status("Computing the map …"):
        turn = undistortion(camera, output)
    if not turn.valid.any():
        raise InputError("no pixel of the output has a source: the two cameras do not look the same way")
    reasons = _unusable(turn, targets, request, listener)
    if targets and len(reasons) == len(targets):
        raise InputError("none of the photos could be used: " + "; ".join(list(reasons.values())[:3]))
    result = _undistorted_result(turn, targets, reasons, request)
    return Outcome(
        result=result,
        documents=_written(result, turn, {f: t for f, t in targets.items() if f not in reasons}, request),
        summary=partial(_said, turn, tuple(reasons.values())),
    )


def _photos(request: Request) -> list[Path]:
    from calibrant.detection.images.files import expand

    return expand(list(request.images)) if request.out is not None else []


def _source_camera(path: Path, files: Sequence[Path]) -> Camera:
    """The camera in a file; one that holds no image size is for images like the first photo that can be read."""
    from calibrant.detection.images.images import load_image
    from calibrant.formats.cameras.read import read_camera

    try:
        return read_camera(path)
    except InputError:
        for file in files:
            try:
                height, width = load_image(file).shape[:2]
            except InputError:
                continue
            return read_camera(path, image_size=(width, height))
        raise


def _targets(files: Sequence[Path], request: Request) -> dict[Path, Path]:
    """The file that each photo becomes. Raises: InputError where two become one, or a name says no format."""
    check_maps(request.maps)
    if request.out is None:
        return {}
    targets = {file: request.out / picture_name(file) for file in files}
    doubled = [path for path, times in Counter(targets.values()).items() if times > 1]
    if doubled:
        sources = ", ".join(str(file) for file, path in targets.items() if path == doubled[0])
        raise InputError(f"two photos would become {doubled[0]}: {sources}; undistort them into two folders")
    read = {file.resolve() for file in (*files, *([request.camera] if request.camera is not None else []))}
    for path in [*targets.values(), request.out / CAMERA_FILE]:
        if path.resolve() in read:
            raise InputError(f"{path} is an input of this command and is left alone; give another folder")
    return targets


def _unusable(
    turn: Undistortion, targets: Mapping[Path, Path], request: Request, listener: Listener
) -> dict[Path, str]:
    """The reason of each photo that has to be left out: it cannot be read, is of another size, cannot be written."""
    import numpy as np

    reasons: dict[Path, str] = {}
    with listener.progress("Reading photos") as step:
        for done, (file, target) in enumerate(targets.items(), 1):
            checkpoint()
            try:
                image = _photo(file, request)
                turn.require(image)
                encoded(np.zeros((8, 8, *image.shape[2:]), image.dtype), target)
            except InputError as error:
                reasons[file] = str(error)
            step(done, len(targets), file.name)
    return reasons


def _photo(file: Path, request: Request) -> Any:
    from calibrant.detection.images.images import load_image

    image = load_image(file)
    return image[:, ::-1].copy() if request.mirror_x else image


def _written(
    result: CalibrationResult, turn: Undistortion, targets: Mapping[Path, Path], request: Request
) -> Iterator[Document]:
    """The maps, the pictures one at a time, and the camera that the pictures are of."""
    if request.maps is not None:
        yield Document(request.maps, partial(_map_bytes, turn, request.maps))
    for file, target in targets.items():
        yield Document(target, partial(_picture, turn, file, target, request))
    if request.out is not None:
        yield result_document(result, request.out / CAMERA_FILE)


def _picture(turn: Undistortion, file: Path, target: Path, request: Request) -> bytes:
    return encoded(turn.apply(_photo(file, request)), target)


def _map_bytes(turn: Undistortion, path: Path) -> bytes:
    """map_u and map_v (h, w), single precision, as cv2.remap takes them, and the output camera's matrix."""
    import numpy as np

    u, v = (m.astype(np.float32) for m in turn.finite_maps())
    if path.suffix.lower() == ".npz":
        return maps_bytes(
            path, {"map_u": u, "map_v": v, "K": turn.output.K, "image_size": np.array(turn.output.image_size)}
        )
    return maps_bytes(path, {"map_u": u, "map_v": v, "camera_matrix": turn.output.K})


def _undistorted_result(
    turn: Undistortion, targets: Mapping[Path, Path], reasons: Mapping[Path, str], request: Request
) -> CalibrationResult:
    """The output camera as a result file, with what was done to whom."""
    from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Measured, ViewResult
    from calibrant.data.details import PictureRegion
    from calibrant.data.verdicts import stamp

    views = tuple(ViewResult(str(f.name), f not in reasons, 0, reason=reasons.get(f)) for f in targets)
    records = session.file_records([*targets, *([request.camera] if request.camera else [])])
    return stamp(
        CalibrationResult(
            "undistorted",
            "ok",
            cameras={DEFAULT_CAMERA: turn.output},
            views=views,
            options={**request.output.words, **({"mirror_x": True} if request.mirror_x else {})},
            figures={"without_source": Measured(float(1 - turn.valid.mean()))},
            details=(PictureRegion(*map(int, turn.region)),),
            inputs=records,
        )
    )


def _said(turn: Undistortion, reasons: Sequence[str]) -> Text:
    """What a person is told: the output camera, and the photos left out."""
    from rich.text import Text

    return Text("\n".join([*summary_lines(turn), *(f"Left out: {reason}" for reason in reasons)]))


def summary_lines(turn: Undistortion) -> list[str]:
    """The output camera, its field of view, and which part of its picture has no source."""
    import numpy as np

    camera, (width, height) = turn.output, turn.output.image_size
    p = camera.parameters
    lines = [
        f"Output camera: {camera.model.name}, {width} x {height} px, fx {p['fx']:.2f}, fy {p['fy']:.2f}, "
        f"cx {p['cx']:.2f}, cy {p['cy']:.2f} px"
    ]
    middle = [[0, (height - 1) / 2], [width - 1, (height - 1) / 2], [(width - 1) / 2, 0], [(width - 1) / 2, height - 1]]
    left, right, top, bottom = camera.unproject(middle)
    across, down = (np.rad2deg(np.arccos(np.clip(a @ b, -1, 1))) for a, b in ((left, right), (top, bottom)))
    if np.isfinite(across + down):
        lines.append(f"Field of view: {across:.1f} x {down:.1f} deg")
    missing = 100 * (1 - turn.valid.mean())
    if missing == 0:
        return [*lines, "Every pixel has a source."]
    x, y, w, h = turn.region
    where = f"the largest rectangle that has is x {x} to {x + w - 1}, y {y} to {y + h - 1} ({w} x {h} px)"
    return [*lines, f"{missing:.2g} % of the picture has no source and is black; {where}."]
