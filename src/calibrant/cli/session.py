"""What every calibrating command does around its calculation: progress, outputs, the verdict's exit status."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cli.progress import listener
from calibrant.errors import InputError, RefusedError
from calibrant.tasks import session as task_session
from calibrant.tasks.session import cache_folder as cache_folder
from calibrant.tasks.session import file_records as file_records
from calibrant.tasks.session import with_misses as with_misses

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
    """Progress on standard error."""
    with listener(silent=quiet).progress(title) as step:
        yield step


@contextmanager
def status(text: str, *, quiet: bool) -> Iterator[None]:
    """A line on standard error while something runs."""
    with listener(silent=quiet).status(text):
        yield


def load_solver(*, quiet: bool) -> None:
    """Load the kernels for photos."""
    task_session.load_solver(listener(silent=quiet))


def load_pose_solver(*, quiet: bool) -> None:
    """Load the kernels for poses alone."""
    task_session.load_pose_solver(listener(silent=quiet))


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
    """Find the target in every file, with progress."""
    return task_session.detect_boards(
        files, target, mirror_x=mirror_x, workers=workers, cache=cache, camera=camera, refinement=refinement,
        listener=listener(silent=quiet),
    )  # fmt: skip


def finish(result: CalibrationResult, outputs: Outputs) -> None:
    """Print the summary, write the files and say which. Raises: RefusedError for a result that failed its checks."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.diagnose.look import look

    refuse_if_failed(result)
    seen = look(result)
    if not outputs.quiet and not outputs.json:
        from rich.console import Console

        from calibrant.reports.terminal import summary

        Console().print(summary(seen))
    if outputs.out is not None:
        result.write(outputs.out, force=outputs.force)
    if outputs.opencv is not None:
        from calibrant.formats.cameras.opencv import write_intrinsics

        write_intrinsics(result.camera, outputs.opencv, rms_px=result.rms_px, force=outputs.force)
    if outputs.report is not None:
        from calibrant.reports.html import write_report

        write_report(seen, outputs.report, force=outputs.force)
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
