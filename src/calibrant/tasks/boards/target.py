"""A target to print at true size with its spec in a file beside it, or tags at unknown places measured from photos."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.boards.measured_tags import TagPhotos, measured_tags
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import PAGES
from calibrant.tasks.options.images import SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from rich.text import Text

    from calibrant.reports.sheet import Sheet
    from calibrant.targets.target import Target

EXAMPLE = 'cb.target("charuco:5x7:40mm:20mm:DICT_6X6_250", out="board.pdf")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Write a target as printable artwork at true size, with a ruler, and its spec as YAML beside it.

    calibrant target charuco:5x7:40mm:20mm:DICT_6X6_250 --out board.pdf

    Tags that were put up somewhere are measured from photos of one camera: where they stand to each other becomes a
    file that is a target: calibrant target marker:50mm:DICT_APRILTAG_36h11:3,4,7 --from-photos photos/*.jpg --camera
    camera.json --out bundle.yaml
    """

    spec: Annotated[str, Option("SPEC", positional=True)]
    """The target, e.g. charuco:5x7:40mm:20mm:DICT_6X6_250."""
    out: Annotated[Path, Option("FILE", "-o", output="file")]
    """The file to write: .pdf, .svg or .png; of tags in photos: .yaml."""
    page: Annotated[str, Option("NAME", choices=PAGES)] = "auto"
    """auto, fit, a4, a3, a2, a1, a0, letter or tabloid."""
    from_photos: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos of tags at unknown places, two or more in each; SPEC has the ids of all: marker:50mm:DICTIONARY:3,4,7."""
    camera: Annotated[Path | None, Option("FILE")] = None
    """The camera that took the photos (any format)."""
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[Path]:
    """The photos and the camera, where there are some."""
    photos = _photos(request)
    return [] if photos is None else [*photos.files(), photos.camera]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The artwork and its YAML, or the YAML of tags in photos.

    Raises: InputError for an impossible spec, page or file; RefusedError where photos do not tie the tags.
    """
    photos = _photos(request)
    return _artwork(request) if photos is None else measured_tags(photos, listener)


def _photos(request: Request) -> TagPhotos | None:
    """What is measured, None for artwork. Raises: InputError for options of one without the other."""
    if not request.from_photos:
        if request.camera is not None:
            raise InputError("--camera goes with --from-photos IMAGES: it is the camera that took them")
        return None
    if request.camera is None:
        raise InputError("--from-photos needs the camera: --camera FILE, such as what calibrant intrinsics wrote")
    return TagPhotos(request.spec, request.from_photos, request.camera, request.out, request.search)


def _artwork(request: Request) -> Outcome:
    from calibrant.reports.artwork import writer_for
    from calibrant.reports.sheet import sheet_of
    from calibrant.targets.registry import parse_target

    board = parse_target(request.spec)
    write = writer_for(request.out)
    sheet = sheet_of(board, page=request.page)
    spec_file = request.out.with_suffix(".yaml")
    documents = (
        Document(request.out, partial(write, sheet)),
        Document(spec_file, _spec_text(request.out.name, board.spec, sheet).encode()),
    )
    summary = partial(_said, request.out, spec_file, board.spec, sheet)
    return Outcome(documents=documents, summary=summary, warnings=tuple(_doubts(board, sheet, request.page)))


def _doubts(board: Target, sheet: Sheet, page: str) -> list[str]:
    """What a person should know before printing it."""
    out = []
    turn = getattr(board, "turns_unnoticed_deg", None)
    if turn is not None:
        cure = (
            "one even and one odd count of inner corners tell its ends apart"
            if board.kind == "chessboard"
            else ":bigdot, or an asymmetric grid with an odd number of rows, tells its ends apart"
        )
        out.append(f"{board.spec} looks the same turned by {turn} degrees, so that photos do not tell its ends: {cure}")
    if page == "auto" and sheet.page != "a4":
        size = "a page of its own size" if sheet.page == "fit" else sheet.page.upper()
        out.append(f"{board.spec} does not fit on A4: this is {size}; smaller or fewer squares do")
    return out


def _spec_text(name: str, spec: str, sheet: Sheet) -> str:
    width, height = sheet.size
    lines = [
        f"# {name}: {width:g} x {height:g} mm, to be printed at 100 %; its ruler must then measure 100 mm.",
        "# After measuring a square of the print, put its real size here.",
        f"target: {spec}",
    ]
    return "\n".join(lines) + "\n"


def _said(out: Path, spec_file: Path, spec: str, sheet: Sheet) -> Text:
    from rich.text import Text

    width, height = sheet.size
    return Text(
        f"{out}: {spec} on {'its own page size' if sheet.page == 'fit' else sheet.page.upper()}, "
        f"{width:g} x {height:g} mm\n{spec_file}: its spec, for --target\n"
        "Print at 100 % (actual size): scaling to fit the page changes the squares. Measure the ruler: 100 mm."
    )
