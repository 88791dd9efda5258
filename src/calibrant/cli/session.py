"""What every calibrating command does around its calculation: progress, outputs, the verdict's exit status."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.detection.subpixel.refinement import Refinement

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Outputs:
    """Where a command writes and how much it says."""

    out: Path | None = None
    report: Path | None = None
    json: bool = False
    quiet: bool = False
    force: bool = False
    opencv: Path | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """Every file that will be written."""
        return tuple(path for path in (self.out, self.opencv, self.report) if path is not None)

    def check(self) -> None:
        """Refuse outputs that cannot be written before any work is done. Raises: InputError naming the path."""
        seen: set[Path] = set()
        for path in self.paths:
            check_writable(path, force=self.force)
            if path.resolve() in seen:
                raise InputError(f"two outputs would be written to {path}; give each a name of its own")
            seen.add(path.resolve())

    def spare(self, inputs: Iterable[str | Path]) -> None:
        """Refuse to write over a file that is read, even with --force. Raises: InputError naming it."""
        read = {Path(file).resolve() for file in inputs}
        for path in self.paths:
            if path.resolve() in read:
                raise InputError(f"{path} is an input of this command and is left alone; give the output another name")


def check_writable(path: Path, *, force: bool) -> None:
    """Raises: InputError when a file cannot be written there, or exists and `force` is False."""
    if path.is_dir():
        raise InputError(f"cannot write {path}: it is a folder; give a file name")
    if path.exists() and not force:
        raise InputError(f"{path} exists already; give another name, or --force to replace it")
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: there is no folder {path.parent}; make it first")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"cannot write {path}: the folder {path.parent} is not writable")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all: beside its place first, then moved there. Raises: InputError."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        draft.write_bytes(data)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


@contextmanager
def progress(title: str, *, quiet: bool) -> Iterator[Progress]:
    """A progress bar on a terminal's standard error; nothing elsewhere."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total, name: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total, name: bar.update(task, completed=done, total=total, description=f"{title} {name}")


@contextmanager
def status(text: str, *, quiet: bool) -> Iterator[None]:
    """A line on a terminal's standard error while something runs."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(text):
        yield


_LOADING = "Loading the solver (the first run compiles it, which takes up to a minute) …"


def load_solver(*, quiet: bool) -> None:
    """Load the kernels for photos; the first run on a machine compiles them, which a person should know."""
    with status(_LOADING, quiet=quiet):
        from calibrant.calibrate.classical import planar_kernels
        from calibrant.calibrate.reprojection import kernels as reprojection_kernels
        from calibrant.optimize import linear_kernels

        _ = (planar_kernels, reprojection_kernels, linear_kernels)


def load_pose_solver(*, quiet: bool) -> None:
    """Load the kernels for poses alone, which are far fewer than those for photos."""
    with status(_LOADING, quiet=quiet):
        from calibrant.optimize import linear_kernels, pose_kernels

        _ = (linear_kernels, pose_kernels)


def file_records(files: Iterable[str | Path]) -> tuple[dict[str, str], ...]:
    """Name and SHA-256 of every input file, so that a result says what it was made from."""
    records = []
    for file in dict.fromkeys(str(f) for f in files):
        path = Path(file)
        if path.is_file():
            records.append({"file": file, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()})
    return tuple(records)


def detect_boards(
    files: Sequence[Path],
    target: str,
    *,
    mirror_x: bool,
    workers: str | None,
    quiet: bool,
    cache: str | None = None,
    camera: str = "camera",
    refinement: Refinement | None = None,
) -> Observations:
    """Find the target in every file, with progress. Args: cache: as `cache_folder` takes it."""
    from calibrant.detection import detect
    from calibrant.detection.subpixel.refinement import DEFAULT
    from calibrant.targets.point_folder import PointFolder
    from calibrant.targets.registry import parse_target
    from calibrant.tasks.inputs.own_points import read_beside

    wanted = parse_target(target)
    if isinstance(wanted, PointFolder):
        return read_beside(files, wanted, mirror_x=mirror_x, camera=camera)
    with progress("Finding boards", quiet=quiet) as step:
        return detect(
            files,
            target=wanted,
            mirror_x=mirror_x,
            workers=workers,
            camera=camera,
            cache=cache_folder(cache),
            refinement=refinement or DEFAULT,
            progress=step,
        )


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
    """The result with the images that showed no board among its views, each with the reason."""
    from calibrant.data import ViewResult

    if result.observations is None:
        return result
    known = {v.id for v in result.views}
    missed = tuple(
        ViewResult(m.id, False, 0, None, m.reason, m.camera) for m in result.observations.missed if m.id not in known
    )
    return replace(result, views=(*result.views, *missed))


def finish(result: CalibrationResult, outputs: Outputs) -> None:
    """Print the summary, write the files and say which. Raises: RefusedError for a result that failed its checks."""
    from calibrant.data.verdicts import refuse_if_failed

    refuse_if_failed(result)
    if not outputs.quiet and not outputs.json:
        from rich.console import Console

        from calibrant.reports.terminal import summary

        Console().print(summary(result))
    if outputs.out is not None:
        result.write(outputs.out, force=outputs.force)
    if outputs.opencv is not None:
        from calibrant.formats.cameras.opencv import write_intrinsics

        write_intrinsics(result.camera, outputs.opencv, rms_px=result.rms_px, force=outputs.force)
    if outputs.report is not None:
        from calibrant.reports.html import write_report

        write_report(result, outputs.report, force=outputs.force)
    if outputs.json:
        from calibrant.data.result_file import result_text

        sys.stdout.write(result_text(result) + "\n")
    elif not outputs.quiet and outputs.paths:
        sys.stdout.write(f"\nWritten: {', '.join(str(p) for p in outputs.paths)}\n")


@contextmanager
def explain_refusal(outputs: Outputs) -> Iterator[None]:
    """A refused calibration writes no result, but its report, when asked for: it shows why."""
    try:
        yield
    except RefusedError as error:
        from calibrant.data import CalibrationResult

        if not isinstance(error.result, CalibrationResult) or outputs.report is None:
            raise
        from calibrant.reports.html import write_report

        write_report(with_misses(error.result), outputs.report, force=outputs.force)
        raise RefusedError(f"{error}\ncalibrant: {outputs.report} shows the refused calibration") from error
