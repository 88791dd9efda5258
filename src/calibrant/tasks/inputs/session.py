"""What many tasks do around their calculation: boards found, kernels loaded, inputs recorded, misses listed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cancel import checkpoint
from calibrant.errors import InputError
from calibrant.reading.files import open_file
from calibrant.tasks.listener import SILENT, Listener

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from calibrant.data import CalibrationResult, Check, Observations
    from calibrant.detection.subpixel.refinement import Refinement
    from calibrant.targets.target import Target

_LOADING = "Loading the solver (the first run compiles it: half a minute, two on a busy machine) …"
_FIRST_RUN = (
    "Compiling for this machine: the first run takes half a minute longer than later ones, two on a busy machine …"
)
POSE_SOLVER = (
    "calibrant.optimize.linear_kernels",
    "calibrant.optimize.pose_kernels",
    "calibrant.calibrate.centres.kernels",
)
"""Modules of the kernels for poses alone."""
SOLVER = (
    "calibrant.calibrate.reprojection.kernels",
    "calibrant.calibrate.classical.planar_kernels",
    *POSE_SOLVER,
    "calibrant.cameras.kernels.brown_rows",
)
"""Modules of the kernels for photos, and of the camera model that is asked for most."""
_LISTED = 8
"""Images that a check names."""


def load_solver(listener: Listener = SILENT) -> None:
    """Load the kernels for photos; the first run on a machine compiles them, which a person should know."""
    checkpoint()
    with listener.status(_LOADING):
        for module in SOLVER:
            import_module(module)


def load_pose_solver(listener: Listener = SILENT) -> None:
    """Load the kernels for poses alone, which are far fewer than those for photos."""
    checkpoint()
    with listener.status(_LOADING):
        for module in POSE_SOLVER:
            import_module(module)


def file_records(files: Iterable[str | Path]) -> tuple[dict[str, str], ...]:
    """Name and SHA-256 of every input file, of frames their recording's: a result says what it was made from."""
    records = []
    for file in dict.fromkeys(str(f) for given in files for f in _behind(Path(given))):
        path = Path(file)
        if path.is_file():
            with open_file(path) as stream:
                records.append({"file": file, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()})
    return tuple(records)


def _behind(file: Path) -> list[Path]:
    """The files that a name stands for: a frame for its recording, a bag for the files it consists of."""
    from calibrant.formats.bags.kinds import files_of, is_bag

    if not file.exists():
        from calibrant.detection.images.files import frame_of

        frame = frame_of(file)
        file = file if frame is None else frame[0]
    return files_of(file) if is_bag(file) else [file]


def detect_boards(
    files: Sequence[Path],
    target: str | Target,
    *,
    mirror_x: bool,
    workers: int | str | Executor | None,
    cache: str | None = None,
    camera: str = "camera",
    refinement: Refinement | None = None,
    listener: Listener = SILENT,
    beside: Sequence[str] = (),
) -> Observations:
    """Find the target in every file, with progress. Args: cache: as `cache_folder` takes it; beside: as `detect`."""
    from calibrant.compiled_beside import compiled_beside
    from calibrant.detection import detect
    from calibrant.detection.subpixel.refinement import DEFAULT
    from calibrant.targets.point_folder import PointFolder
    from calibrant.targets.registry import parse_target
    from calibrant.tasks.inputs.own_points import read_beside

    wanted = parse_target(target) if isinstance(target, str) else target
    if isinstance(wanted, PointFolder):
        return read_beside(files, wanted, mirror_x=mirror_x, camera=camera)
    with compiled_beside(*SOLVER, first=lambda: listener.note(_FIRST_RUN)) as other:
        with listener.progress("Finding boards") as step:
            found = detect(
                files,
                target=wanted,
                mirror_x=mirror_x,
                workers=workers,
                camera=camera,
                cache=cache_folder(cache),
                refinement=refinement or DEFAULT,
                progress=step,
                beside=beside,
            )
        if other.runs:
            with listener.status(_LOADING):
                other.wait()
    return found


def cache_folder(given: str | None) -> Path | None:
    """The folder that keeps detections: the one given, none for that word, else the user's own if it can be used."""
    from calibrant.detection.cache import Cache, default_folder

    if given is not None:
        return None if given == "none" else Path(given)
    try:
        return Cache.at(default_folder()).folder
    except InputError:
        # A user without a home of their own (a service, a container) has nothing kept, and needs nothing done.
        return None


def with_misses(result: CalibrationResult) -> CalibrationResult:
    """The result with the images that showed no board among its views, each with the reason; those of another size
    than their camera's are warned of."""
    from calibrant.data import ViewResult, verdict_of

    if result.observations is None:
        return result
    known = {v.id for v in result.views}
    missed = tuple(
        ViewResult(m.id, False, 0, None, m.reason, m.camera) for m in result.observations.missed if m.id not in known
    )
    checks = (*result.checks, *_size_checks(result.observations))
    verdict = verdict_of(checks) if len(checks) > len(result.checks) else result.verdict
    return replace(result, views=(*result.views, *missed), checks=checks, verdict=verdict)


def _size_checks(found: Observations) -> Iterator[Check]:
    """By camera, whether images were left out for their size: half of a set may be, and the rest calibrate well."""
    from calibrant.data import Check
    from calibrant.data.observations import ONE_SIZE

    for camera, (width, height) in found.image_sizes.items():
        other = [m.id for m in found.missed if m.camera == camera and m.reason.endswith(ONE_SIZE)]
        if not other:
            continue
        count = len(found.of_camera(camera).views) + sum(m.camera == camera for m in found.missed)
        names = ", ".join(other[:_LISTED]) + (f" … ({len(other)})" if len(other) > _LISTED else "")
        several = len(found.image_sizes) > 1
        message = (
            f"{len(other)} of {count} images{f' of {camera}' if several else ''} are not {width}x{height} px and are "
            f"left out: {names}. Was the camera's resolution changed, or are they another camera's? Calibrate them "
            "apart, or leave them out (--exclude)"
        )
        yield Check(f"image-sizes-{camera}" if several else "image-sizes", "warn", message, float(len(other)))
