"""Find a board in photos, and say where it was not found and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    """The points of every photo. Raises: InputError; DetectionError when no photo shows the board."""
    from calibrant.reports.detections import table

    source = _source(request, listener)
    if request.stages is not None and request.photos.target is not None:
        _expect_markers(request.photos.target)
    files = source.files()
    found = source.read(files)
    result = _observations_result(found, source.inputs(files), mirror_x=request.search.mirror_x)
    return Outcome(result=result, documents=_documents(found, request), summary=partial(table, found))


def _source(request: Request, listener: Listener) -> Source:
    return Source.of(request.photos, request.search, listener, corners=request.corners)


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
        yield from _stages(found, request, request.stages)


def _stages(found: Observations, request: Request, folder: Path) -> Iterator[Document]:
    """Five pictures of each photo that could be read."""
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.tags.stages import NAMES, stages
    from calibrant.errors import InputError
    from calibrant.targets.registry import parse_target

    target = parse_target(request.photos.target or "")
    views = {v.id: v for v in found.views}
    files = {v.id: v.file or v.id for v in found.views} | {m.id: m.file or m.id for m in found.missed}
    names = picture_names(files)
    for name, file in files.items():
        try:
            grey = load_grey(file)
        except InputError:
            continue  # the table says why it cannot be read
        if request.search.mirror_x:
            grey = grey[:, ::-1].copy()
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
