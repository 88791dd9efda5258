"""A page with a target on it at true size: the board, a ruler to check the printer by, and the spec in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.detection.opencv import marker_cells
from calibrant.errors import InputError
from calibrant.targets.target import Artwork, Disc, MarkerArt, Polygon, Target

Point = tuple[float, float]

# Width and height, mm, upright.
PAGES: dict[str, tuple[float, float]] = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
_AUTO = ("a4", "a3", "a2", "a1", "a0")
MARGIN_MM = 5.0  # printers leave about this much blank; it is the least quiet zone too
FOOTER_MM = 22.0  # ruler and three lines of text
TEXT_MM = 3.0
RULER_MM = 100.0


@dataclass(frozen=True)
class Fill:
    """Polygons filled as one shape, so that cells side by side leave no hairline: rings in mm; grey 0 ink, 1 paper."""

    rings: tuple[tuple[Point, ...], ...]
    grey: float


@dataclass(frozen=True)
class DiscFill:
    """A filled disc, mm."""

    centre: Point
    radius: float
    grey: float


@dataclass(frozen=True)
class Label:
    """Text with its baseline's left end at `at`, mm."""

    at: Point
    text: str


@dataclass(frozen=True)
class Sheet:
    """A page of size (width, height) mm, origin top left, y down; items in the order they are drawn.

    target_origin: where the target's origin lies on it.
    """

    page: str
    size: Point
    items: tuple[Fill | DiscFill | Label, ...]
    target_origin: Point


def sheet_of(target: Target, *, page: str = "auto") -> Sheet:
    """The target's artwork on a page, in the middle, with ruler and text below.

    Args: page: auto (the smallest ISO page it fits on, else one of its own size), fit, or a name of PAGES.
    Raises: InputError for an unknown page or one that is too small, naming the smallest that is not.
    """
    art = target.artwork()
    x0, y0, x1, y1 = (1e3 * b for b in _inked(art))
    need = (x1 - x0 + 2 * MARGIN_MM, y1 - y0 + 2 * MARGIN_MM + FOOTER_MM)
    need = (max(need[0], RULER_MM + 4 * MARGIN_MM), need[1])
    name, size = _page(page.lower(), need)
    left = 0.5 * (size[0] - (x1 - x0))
    top = 0.5 * (size[1] - FOOTER_MM - (y1 - y0))
    origin = (left - x0, top - y0)
    items = [*_artwork(art, origin), *_footer(target, size, page=name)]
    return Sheet(name, size, tuple(items), origin)


def _inked(art: Artwork) -> tuple[float, float, float, float]:
    """The box that must be printed, metres: a white quiet zone is the paper's own and may reach its edge."""
    if art.background < 1.0:
        return art.bounds
    corners: list[Point] = []
    for shape in art.shapes:
        if isinstance(shape, Polygon):
            corners += shape.corners
        elif isinstance(shape, Disc):
            (x, y), r = shape.centre, shape.radius
            corners += [(x - r, y - r), (x + r, y + r)]
        else:
            (x, y), side = shape.top_left, shape.side
            corners += [(x, y), (x + side, y + side)]
    (x0, y0), (x1, y1) = np.min(corners, axis=0), np.max(corners, axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def _page(name: str, need: Point) -> tuple[str, Point]:
    fitting = [n for n in _AUTO if _turned(n, need) is not None]
    if name == "fit" or (name == "auto" and not fitting):
        return "fit", need
    if name == "auto":
        name = fitting[0]
    if name not in PAGES:
        raise InputError(f"unknown page {name!r}; known pages: auto, fit, {', '.join(PAGES)}")
    size = _turned(name, need)
    if size is None:
        advice = f"the smallest ISO page for it is {fitting[0]}" if fitting else "use --page fit"
        raise InputError(
            f"the board needs {need[0]:.0f} x {need[1]:.0f} mm with its margins, more than {name}; {advice}"
        )
    return name, size


def _turned(name: str, need: Point) -> Point | None:
    """The page upright or lying, whichever holds it first; None when neither does."""
    w, h = PAGES[name]
    return next((s for s in ((w, h), (h, w)) if need[0] <= s[0] and need[1] <= s[1]), None)


def _artwork(art: Artwork, origin: Point) -> list[Fill | DiscFill]:
    items: list[Fill | DiscFill] = []
    if art.background < 1.0:
        x0, y0, x1, y1 = art.bounds
        items.append(Fill((_placed(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), origin),), art.background))
    for shape in art.shapes:
        if isinstance(shape, Polygon):
            items.append(Fill((_placed(shape.corners, origin),), shape.grey))
        elif isinstance(shape, Disc):
            (centre,) = _placed((shape.centre,), origin)
            items.append(DiscFill(centre, 1e3 * shape.radius, shape.grey))
        else:
            items += _marker(shape, origin)
    return items


def _marker(marker: MarkerArt, origin: Point) -> list[Fill]:
    """The whole square in the border's grey, and the other cells upon it, each row's runs in one piece."""
    cells = np.rot90(marker_cells(marker.dictionary, marker.id), -marker.quarter_turns)
    border = 1.0 if marker.inverted else 0.0
    x, y = marker.top_left
    cell = marker.side / len(cells)
    rings = []
    for row, values in enumerate(cells):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
        for start, stop in edges.reshape(-1, 2):
            rings.append(_box(x + start * cell, y + row * cell, x + stop * cell, y + (row + 1) * cell))
    square = _placed(_box(x, y, x + marker.side, y + marker.side), origin)
    return [Fill((square,), border), Fill(tuple(_placed(ring, origin) for ring in rings), 1.0 - border)]


def _box(x0: float, y0: float, x1: float, y1: float) -> tuple[Point, ...]:
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def _placed(corners: tuple[Point, ...], origin: Point) -> tuple[Point, ...]:
    return tuple((origin[0] + 1e3 * x, origin[1] + 1e3 * y) for x, y in corners)


def _footer(target: Target, size: Point, *, page: str) -> list[Fill | Label]:
    """A ruler of 100 mm with a mark every 10 mm, the spec, and how to print."""
    left, line = 2 * MARGIN_MM, size[1] - MARGIN_MM - FOOTER_MM + 5.0
    width = 0.2
    marks = [_box(left - 0.5 * width, line - 0.5 * width, left + RULER_MM + 0.5 * width, line + 0.5 * width)]
    for i in range(int(RULER_MM / 10) + 1):
        x, height = left + 10.0 * i, (4.0 if i % 5 == 0 else 2.5)
        marks.append(_box(x - 0.5 * width, line - height, x + 0.5 * width, line))
    # Drawn one by one: strokes that cross would cancel in one shape under the even-odd rule.
    ruler = [Fill((mark,), 0.0) for mark in marks]
    texts = (
        f"{target.spec}",
        f"Print at 100 % (actual size, no fitting) on {page.upper() if page != 'fit' else 'this page size'}.",
        "Measure the ruler: it must be 100 mm. Else measure a square and give its real size in the spec.",
    )
    labels = [Label((left, line + 4.5 + 4.2 * i), text) for i, text in enumerate(texts)]
    return [*ruler, *labels]
