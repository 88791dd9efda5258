"""What `calibrant undistort` does: choose the output camera, turn every photo, write them, the camera and the maps."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrant.cli import options, session
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult
    from calibrant.perceive.undistort import Undistortion

CAMERA_FILE = "camera.json"
JPEG_QUALITY = 98
"""Beyond it files grow and no grey level changes by more than the picture's noise."""
_MAP_KINDS = (".npz", ".yml", ".yaml", ".yml.gz")


@dataclass(frozen=True)
class OutputChoice:
    """What is said of the output camera: alpha, another camera's file, a size, a focal length; nothing: the axis'."""

    alpha: float | None = None
    to: Path | None = None
    size: str | None = None
    focal: str | None = None

    def camera(self, source: Camera) -> Camera:
        """The output camera. Raises: InputError for choices that contradict each other or cannot be read."""
        from calibrant.formats.cameras.read import read_camera
        from calibrant.perceive.output_cameras import axis_camera, focal_camera, optimal_camera

        size = None if self.size is None else _size(self.size)
        if self.to is not None:
            if self.alpha is not None or size is not None or self.focal is not None:
                raise InputError("--to gives the whole camera; leave out --alpha, --size and --focal")
            return read_camera(self.to)
        if self.alpha is not None and self.focal is not None:
            raise InputError("--alpha chooses the focal length; leave out --alpha or --focal")
        if self.alpha is not None:
            return optimal_camera(source, self.alpha, image_size=size)
        focal = options.pixels(self.focal, option="--focal")
        if focal is not None:
            return focal_camera(source, focal, image_size=size)
        return axis_camera(source, image_size=size)

    @property
    def words(self) -> dict[str, object]:
        """What the result file keeps."""
        given = {"alpha": self.alpha, "to": self.to and str(self.to), "size": self.size, "focal": self.focal}
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True)
class Request:
    """The command's arguments."""

    images: tuple[str, ...]
    camera: Path | None
    out: Path | None
    output: OutputChoice
    maps: Path | None = None
    mirror_x: bool = False
    json: bool = False
    quiet: bool = False
    force: bool = False


def run(request: Request) -> None:
    """Undistort the photos. Raises: InputError for unusable arguments, or when no photo could be used."""
    if request.camera is None:
        raise InputError("which camera took the photos? Give its file: --camera camera.json")
    if request.out is None and (request.images or request.maps is None):
        raise InputError("where shall the pictures go? Give a folder: --out straight (or no photos and --maps FILE)")
    from calibrant.detection.images.images import expand

    files = expand(list(request.images)) if request.out is not None else []
    targets = _targets(files, request)
    camera = _source_camera(request.camera, files)
    output = request.output.camera(camera)

    from calibrant.perceive.undistort import undistortion

    with session.status("Computing the map …", quiet=request.quiet or request.json):
        turn = undistortion(camera, output)
    if not turn.valid.any():
        raise InputError("no pixel of the output has a source: the two cameras do not look the same way")
    if request.maps is not None:
        session.write_bytes(request.maps, _map_bytes(turn, request.maps))
    reasons = _turn_all(turn, targets, request)
    used = [file for file in targets if file not in reasons]
    if targets and not used:
        raise InputError("none of the photos could be used: " + "; ".join(list(reasons.values())[:3]))
    result = _result(turn, targets, reasons, request)
    if request.out is not None:
        result.write(request.out / CAMERA_FILE, force=request.force)
    _say(result, turn, targets, reasons, request)


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)\s*[xX]\s*(\d+)(?:\s*px)?", text.strip())
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    # cv2.remap counts pixels in 16 bits.
    if not all(1 <= n < 2**15 for n in size):
        raise InputError(f"--size takes WIDTHxHEIGHT in pixels, each 1 to 32767, such as 1280x960; got {text!r}")
    return size


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
    """The file that each photo becomes. Raises: InputError where two become one, or something is in the way."""
    if request.maps is not None:
        if not request.maps.name.lower().endswith(_MAP_KINDS):
            raise InputError(f"--maps {request.maps}: the name says the format; expected {', '.join(_MAP_KINDS)}")
        session.check_writable(request.maps, force=request.force)
    if request.out is None:
        return {}
    if request.out.exists() and not request.out.is_dir():
        raise InputError(f"--out {request.out} is a file; give a folder")
    if not request.out.exists() and not request.out.absolute().parent.is_dir():
        raise InputError(f"--out {request.out}: there is no folder {request.out.parent}; make it first")
    targets = {file: request.out / _name(file) for file in files}
    doubled = [path for path, times in Counter(targets.values()).items() if times > 1]
    if doubled:
        sources = ", ".join(str(file) for file, path in targets.items() if path == doubled[0])
        raise InputError(f"two photos would become {doubled[0]}: {sources}; undistort them into two folders")
    read = {file.resolve() for file in [*files, *([request.camera] if request.camera else [])]}
    for path in [*targets.values(), request.out / CAMERA_FILE]:
        if path.resolve() in read:
            raise InputError(f"{path} is an input of this command and is left alone; give another folder")
        if path.exists() and not request.force:
            raise InputError(f"{path} exists already; give another folder, or --force to replace it")
    return targets


def _name(file: Path) -> str:
    """Name of the picture: the photo's; of a video's frame, both names; PNG where OpenCV does not write the format."""
    import cv2

    from calibrant.detection.images.video import frame_of

    if frame_of(file) is not None:
        return f"{file.parent.stem}_{file.name}.png"
    return file.name if cv2.haveImageWriter(file.name) else f"{file.stem}.png"


def _turn_all(turn: Undistortion, targets: dict[Path, Path], request: Request) -> dict[Path, str]:
    """Turn and write every photo; the reason for each that was left out."""
    from calibrant.detection.images.images import load_image

    reasons: dict[Path, str] = {}
    if request.out is not None:
        request.out.mkdir(exist_ok=True)
    with session.progress("Undistorting", quiet=request.quiet or request.json) as step:
        for done, (file, target) in enumerate(targets.items(), 1):
            try:
                image = load_image(file)
                image = image[:, ::-1].copy() if request.mirror_x else image
                session.write_bytes(target, _encoded(turn.apply(image), target))
            except InputError as error:
                reasons[file] = str(error)
            step(done, len(targets), file.name)
    return reasons


def _encoded(image: Any, target: Path) -> bytes:
    import cv2

    jpeg = target.suffix.lower() in (".jpg", ".jpeg", ".jpe")
    try:
        ok, data = cv2.imencode(target.suffix, image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if jpeg else [])
    except cv2.error as error:
        raise InputError(f"cannot write {target} in its format: {error.err}") from None
    if not ok:
        raise InputError(f"cannot write {target}: OpenCV does not write such an image as {target.suffix}")
    return bytes(data)


def _map_bytes(turn: Undistortion, path: Path) -> bytes:
    """map_u and map_v (h, w), single precision, as cv2.remap takes them: NumPy's archive, or OpenCV's YAML."""
    import gzip
    import io

    import cv2
    import numpy as np

    u, v = (m.astype(np.float32) for m in turn.finite_maps())
    if path.suffix.lower() == ".npz":
        buffer = io.BytesIO()
        np.savez_compressed(buffer, map_u=u, map_v=v, K=turn.output.K, image_size=np.array(turn.output.image_size))
        return buffer.getvalue()
    storage = cv2.FileStorage("maps.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in (("map_u", u), ("map_v", v), ("camera_matrix", turn.output.K)):
        storage.write(name, value)
    text = storage.releaseAndGetString().encode()
    return gzip.compress(text) if path.suffix.lower() == ".gz" else text


def _result(
    turn: Undistortion, targets: dict[Path, Path], reasons: dict[Path, str], request: Request
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


def _say(
    result: CalibrationResult,
    turn: Undistortion,
    targets: dict[Path, Path],
    reasons: dict[Path, str],
    request: Request,
) -> None:
    """Print the summary, or the result as JSON."""
    import typer

    if request.json:
        from calibrant.data.result_file import result_text

        typer.echo(result_text(result))
        return
    if request.quiet:
        return
    for line in summary_lines(turn):
        typer.echo(line)
    for reason in reasons.values():
        typer.echo(f"Left out: {reason}")
    written = [f"{len(targets) - len(reasons)} pictures and {CAMERA_FILE} in {request.out}"] if request.out else []
    written += [str(request.maps)] if request.maps else []
    typer.echo(f"\nWritten: {', '.join(written)}")


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
