"""Two calibrations beside each other: in pixels over the image, in parameters, in millimetres and degrees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult

EXAMPLE = 'cb.compare("monday.json", "friday.json")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Compare two calibrations: results, or cameras of any program.

    calibrant compare monday.json friday.json
    calibrant compare camera.json other.yml --report difference.html
    calibrant compare rig.json camchain.yaml --camera left:cam0

    Cameras of other models are compared by what they see. What the uncertainties of both do not explain is a warning;
    --strict makes it exit status 1.
    """

    first: Annotated[Path, Option("A", positional=True)]
    """A result, or a file of cameras of any other program."""
    second: Annotated[Path, Option("B", positional=True)]
    """What it is compared with; differences are B less A."""
    camera: Annotated[tuple[str, ...], Option("NAME[:NAME]...")] = ()
    """The cameras to compare, of files of several: left, or left:cam0 where B calls it another name."""


def reads(request: Request) -> list[Path]:
    """Both files; of a folder none, since its formats choose."""
    return [file for file in (request.first, request.second) if not file.is_dir()]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The comparison. Raises: InputError for files that cannot be read or have nothing in common."""
    from calibrant.diagnose.compare.results import compare_results

    files = (request.first, request.second)
    pairs = [_pair(words) for words in request.camera] or None
    return Outcome(result=compare_results(*read_both(files), names=names_of(files), cameras=pairs))


def read_both(files: tuple[Path, Path]) -> tuple[CalibrationResult, CalibrationResult]:
    """Results of calibrant, or what other programs' files hold; a file that holds no image size is for the other's.

    Raises: InputError naming the file.
    """
    from calibrant.formats.exchange.read import read_any

    try:
        first = read_any(files[0])
    except InputError as error:
        second = read_any(files[1])
        return _of_size(files[0], second, error), second
    try:
        return first, read_any(files[1])
    except InputError as error:
        return first, _of_size(files[1], first, error)


def _of_size(path: Path, other: CalibrationResult, error: InputError) -> CalibrationResult:
    """The file, of images as large as the other's. Raises: the error, where these are of several sizes, or none."""
    from calibrant.formats.exchange.exchange_format import ReadOptions
    from calibrant.formats.exchange.read import read_any

    sizes = {camera.image_size for camera in other.cameras.values()}
    if "image size" not in str(error) or len(sizes) != 1:
        raise error
    return read_any(path, ReadOptions(image_size=sizes.pop()))


def names_of(files: tuple[Path, Path]) -> tuple[str, str]:
    """What two files are called: their names, with the folder's where these are the same."""
    first, second = files
    if first.name != second.name:
        return first.name, second.name
    a, b = (f"{file.resolve().parent.name}/{file.name}" for file in files)
    return (a, b) if a != b else (f"{a} (1)", f"{b} (2)")


def _pair(words: str) -> tuple[str, str]:
    first, colon, second = words.partition(":")
    if not first or (colon and not second):
        raise InputError(f"--camera takes NAME or FIRST:SECOND, got {words!r}")
    return first, second or first
