"""Find a board in photos, and say where it was not found and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import DetectionError, InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.picture_names import picture_names
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import CornerOptions, PhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.data import CalibrationResult, Observations, View

EXAMPLE = 'cb.detect("photos/*.jpg", target="chessboard:9x6:25mm")'


MOST_NAMED = 3
"""Photos lost at one stage that are named; of more, their number."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find a board in photos, point by point.

    calibrant detect photos/*.jpg --target chessboard:9x6:25mm --out observations.json --overlays seen

    Prints how many points each photo shows, or why none. The file goes to --observations of other commands.
    """

    photos: PhotoOptions = PhotoOptions()
    search: SearchOptions = SearchOptions()
    corners: CornerOptions = CornerOptions()
    overlays: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Draw what was found over each photo, into this folder."""
    stages: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Draw how the markers of each photo were looked for, found or not, into this folder: 1-grey, 2-threshold, 3-quads,
    4-decoded, 5-corners."""


def reads(request: Request) -> list[Path]:
    """The photos."""
    source = _source(request, SILENT)
    return source.inputs(source.files())


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The points of every photo. Raises: InputError; DetectionError when no photo shows the board.

    With stages asked for, that error is the outcome's refusal: the pictures show where the board was lost.
    """
    from calibrant.reports.detections import table

    source = _source(request, listener)
    if request.stages is not None and request.photos.target is not None:
        _expect_markers(request.photos.target)
    files = source.files()
    try:
        found = source.read(files)
    except DetectionError as error:
        if request.stages is None or source.observations is not None:
            raise
        return _nothing_found(error, files, request, request.stages)
    result = _observations_result(found, source.inputs(files), mirror_x=request.search.mirror_x)
    return Outcome(result=result, documents=_documents(found, request), summary=partial(table, found))


def _source(request: Request, listener: Listener) -> Source:
    return Source.of(request.photos, request.search, listener, corners=request.corners)


def _nothing_found(error: DetectionError, files: list[Path], request: Request, folder: Path) -> Outcome:
    """The stages of every photo, and at which of them the board was lost."""
    from calibrant.data.file_names import distinct_names
    from calibrant.detection.tags.stages import lost_at
    from calibrant.targets.registry import parse_target

    target = parse_target(request.photos.target or "")
    names = distinct_names(files)
    lost: dict[str, list[str]] = {}
    for file in files:
        grey = _grey(file, request)
        if grey is not None:
            lost.setdefault(lost_at(grey, target), []).append(names[file])
    said = "; ".join(f"{_listed(photos)} lost at stage {where}" for where, photos in lost.items())
    refusal = DetectionError(f"{error}. {folder} shows the search: {said}")
    return Outcome(documents=_stages({names[f]: str(f) for f in files}, {}, request, folder), refusal=refusal)


def _listed(photos: list[str]) -> str:
    more = f" and {len(photos) - MOST_NAMED} more" if len(photos) > MOST_NAMED else ""
    return f"{', '.join(photos[:MOST_NAMED])}{more}"


def _observations_result(found: Observations, inputs: list[Path], *, mirror_x: bool) -> CalibrationResult:
    """The content of an observations file."""
    from calibrant.data import CalibrationResult, ViewResult
    from calibrant.data.verdicts import stamp

    views = tuple(ViewResult(v.id, True, len(v), camera=v.camera) for v in found.views)
    options = {"mirror_x": True} if mirror_x else {}
    records = session.file_records(inputs)
    result = CalibrationResult("observations", "ok", views=views, options=options, inputs=records, observations=found)
    return stamp(session.with_misses(result))


def _expect_markers(spec: str) -> None:
    """Raises: InputError for a board without markers, before anything is looked at."""
    from calibrant.detection.tags.stages import with_markers
    from calibrant.targets.registry import parse_target

    with_markers(parse_target(spec))


def _documents(found: Observations, request: Request) -> Iterator[Document]:
    yield from _pictures(found, request)
    if request.stages is not None:
        files = {v.id: v.file or v.id for v in found.views} | {m.id: m.file or m.id for m in found.missed}
        yield from _stages(files, {v.id: v for v in found.views}, request, request.stages)


def _grey(file: str | Path, request: Request) -> NDArray[np.uint8] | None:
    """The photo as it is searched; None for one that cannot be read, of which table or message say why."""
    from calibrant.detection.images.images import load_grey

    try:
        grey = load_grey(file)
    except InputError:
        return None
    return grey[:, ::-1].copy() if request.search.mirror_x else grey


def _stages(files: Mapping[str, str], views: Mapping[str, View], request: Request, folder: Path) -> Iterator[Document]:
    """Five pictures of each photo that could be read. Args: files, views: by the photo's name."""
    from calibrant.detection.tags.stages import NAMES, stages
    from calibrant.targets.registry import parse_target

    target = parse_target(request.photos.target or "")
    names = picture_names(files)
    for name, file in files.items():
        grey = _grey(file, request)
        if grey is None:
            continue
        start = names[name].removesuffix("-seen.png")
        for stage, picture in zip(NAMES, stages(grey, target, views.get(name)), strict=True):
            yield Document(folder / f"{start}-stage-{stage}.png", partial(_png, picture))


def _png(picture: NDArray[np.uint8]) -> bytes:
    from calibrant.opencv import cv2

    return bytes(cv2.imencode(".png", picture)[1])


def _pictures(found: Observations, request: Request) -> Iterator[Document]:
    """A picture of each view."""
    folder = request.overlays
    if folder is not None:
        names = picture_names(v.id for v in found.views)
        for view in found.views:
            yield Document(folder / names[view.id], partial(_drawn, view, mirror_x=request.search.mirror_x))


def _drawn(view: View, *, mirror_x: bool) -> bytes:
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.images.overlay import draw
    from calibrant.opencv import cv2

    image = load_grey(view.file or view.id)
    return bytes(cv2.imencode(".png", draw(image[:, ::-1] if mirror_x else image, view))[1])
