"""Find a plain chessboard: candidates, links, grid at a low resolution; sub-pixel corners at the full one.

Several scales are tried, the one likeliest to work first: an image of about 640 pixels is quick and holds boards up to
30x20; finer ones find smaller squares, coarser ones blurred boards. The whole grid that an image shows is always grown
and compared with the one asked for, so that a wrong spec is not answered by a piece of the board.

Numbering (see `targets/chessboard.py`): columns run along x, rows along y, never mirrored, and the outermost square
behind corner 0 is dark. Where the board looks the same after a turn, x is chosen to run right or down.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Grey
from calibrant.detection.chessboard.candidates import MOST_CANDIDATES, find_corners
from calibrant.detection.chessboard.grid import Grid, grow_grids, turned
from calibrant.detection.chessboard.links import neighbours
from calibrant.detection.chessboard.partial import Placed, place
from calibrant.detection.chessboard.patterned import SHARE, SQUARES, squares_hold_patterns, uneven_share
from calibrant.detection.chessboard.snap import steps_at
from calibrant.detection.chessboard.strays import stray_corners
from calibrant.detection.detection import Detection
from calibrant.detection.subpixel.refined import WINDOWS_OF_BLUR, Refined
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement, refine
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.target import Target

FIRST_LONGEST_PX = 800
"""Longest side of the first scale tried: quick, and the squares of a 30x20 board that fills it still measure 20 px."""
LEAST_SHORTEST_PX = 100
"""Shortest side of the coarsest scale: a 3x3 board that fills it has squares of 25 px."""
FEW, FEWEST = 4, 200
"""Saddles looked at first, for each corner of the board and on top: a board is among the most pronounced things in a
picture unless it lies in the shade, and then all are looked at."""
WINDOW_PX = 6.0
"""Half width of the window of sub-pixel corners, where the squares leave room: at 2 grey levels of noise a corner is
known to 0.01 px; time grows with its square, and so does the pull of edges bent by the lens."""
LEAST_SEEN = 0.7
"""Of a board's corners; the others may be hidden by glare or a finger. With fewer, its extent is a guess."""
LEAST_COUNT = 24
"""Smaller boards must be seen whole: a few squares that alternate are found in any mosaic."""
MOST_NOISE = 0.5
"""What two crossing edges may leave unexplained, over their half contrast: more is another pattern, or glare."""
LEAST_LOOK = 12
"""Corners that a grid of another size needs to be called a board in a message: 4x3."""


@dataclass(frozen=True, eq=False)
class _Found:
    """A grid in the full image's pixels, and the factor of the scale it was found at."""

    grid: Grid
    factor: int


@dataclass(frozen=True)
class ChessboardDetector:
    """Detector of `Chessboard` targets. refinement: how corners are measured."""

    refinement: Refinement = DEFAULT

    def detect(self, grey: Grey, target: Target) -> Detection:
        """All corners of the board in a grey image (h, w), with their standard deviations.

        Raises: InputError when the target is not a chessboard.
        """
        if not isinstance(target, Chessboard):
            raise InputError(f"the chessboard detector was given a target of kind {target.kind!r}")
        found = self._found(grey, target)
        if not found.found or not squares_hold_patterns(grey, found, target):
            return found
        from calibrant.detection.tags.grid_seen import aprilgrid_seen

        tags = aprilgrid_seen(grey)
        return found if tags is None else _looks_like(tags, target)

    def _found(self, grey: Grey, target: Chessboard) -> Detection:
        seen: list[_Found] = []
        best: Detection | None = None
        for found in at_every_scale(grey, target):
            seen.append(found)
            if found.grid.goes_on or sorted(found.grid.shape) != sorted((target.rows, target.columns)):
                continue
            detection = _numbered(grey, found, target, self.refinement)
            if len(detection.uv) == len(target.points):
                return detection
            # A corner that one scale loses in blur or noise, another may show.
            if best is None or len(detection.uv) > len(best.uv):
                best = detection
        if best is not None:
            return best
        part = _part(grey, seen, target, self.refinement)
        return _not_found(grey, seen, target) if part is None else part


def at_every_scale(grey: Grey, target: Chessboard) -> Iterator[_Found]:
    """Grids found at each scale, from the pronounced saddles and from all, one after the other."""
    for factor in scales(grey.shape[1], grey.shape[0]):
        level = _level(grey, factor)
        for most in (FEW * target.rows * target.columns + FEWEST, MOST_CANDIDATES):
            yield from _grids(level, factor, most, target)


def scales(width: int, height: int) -> list[int]:
    """Whole factors by which to shrink the image, in the order to try them."""
    longest, shortest = max(width, height), min(width, height)
    first = max(1, -(-longest // FIRST_LONGEST_PX))
    # By halves, rounded up: small squares in blur and noise show at one scale and not at the next but one.
    finer = [-(-first // 2**k) for k in range(1, first.bit_length() + 1)]
    coarser = [f for f in (2 * first, 4 * first) if shortest // f >= LEAST_SHORTEST_PX]
    return list(dict.fromkeys([first, *finer, *coarser]))


def _level(grey: Grey, factor: int) -> Grey:
    h, w = grey.shape[0] // factor, grey.shape[1] // factor
    if factor == 1:
        return grey
    return np.asarray(cv2.resize(grey[: h * factor, : w * factor], (w, h), interpolation=cv2.INTER_AREA), np.uint8)


def _grids(level: Grey, factor: int, most: int, target: Chessboard) -> Iterator[_Found]:
    corners = find_corners(level, most=most)
    # Pixel i of the small image covers pixels factor * i ... factor * (i + 1) - 1 of the large one.
    shift = 0.5 * (factor - 1)
    for grid in grow_grids(corners, neighbours(corners), least=min(6, target.rows * target.columns // 2)):
        if grid.known.any():
            yield _Found(replace(grid, xy=factor * grid.xy + shift), factor)


def _numbered(grey: Grey, found: _Found, target: Chessboard, how: Refinement) -> Detection:
    grid = _oriented(found.grid, target)
    known = grid.known
    least = max(LEAST_SEEN * known.size, min(LEAST_COUNT, known.size))
    if known.sum() < least:
        return Detection.nothing(
            f"only {int(known.sum())} of {known.size} corners of the board can be seen; uncover it or light it evenly"
        )
    return measured(grey, Placed(grid, 0, 0), found.factor, target, least, how)


def measured(grey: Grey, placed: Placed, factor: int, target: Chessboard, least: float, how: Refinement) -> Detection:
    """The corners of a grid whose place on the board is known, where at least so many can be measured."""
    grid = placed.grid
    refined = _refined_grid(grey, grid, factor, how)
    good = refined.converged & (refined.noise < MOST_NOISE * refined.contrast)
    xy = np.full_like(grid.xy, np.nan)
    xy[grid.known] = np.where(good[:, None], refined.uv, np.nan)
    good &= ~stray_corners(xy)[grid.known]
    if good.sum() < least:
        return Detection.nothing("the board was seen but its corners are too blurred or too noisy to be measured")
    row, column = np.argwhere(grid.known)[good].T
    ids = (row + placed.row) * target.columns + column + placed.column
    notes = () if target.turns_unnoticed_deg is None else (_ambiguous(target),)
    covariance = None if refined.covariance_px is None else refined.covariance_px[good]
    return Detection(
        ids.astype(np.int64), refined.uv[good], refined.sigma_px[good], notes=notes,
        covariance_px=covariance, smeared=refined.smeared,
    )  # fmt: skip


def _part(grey: Grey, seen: list[_Found], target: Chessboard, how: Refinement) -> Detection | None:
    """The largest grid that is a part of the board, numbered where its place is known; None when there is none."""
    why: str | None = None
    for found in sorted(seen, key=lambda f: -int(f.grid.known.sum())):
        grid = found.grid
        asked = sorted((target.rows, target.columns))
        if sorted(grid.shape) == asked or max(grid.shape) > asked[1] or grid.known.sum() < LEAST_LOOK:
            continue
        here = replace(grid, xy=(grid.xy - 0.5 * (found.factor - 1)) / found.factor)
        places = place(_level(grey, found.factor), here, target)
        if isinstance(places, str):
            why = why or places
        elif places and grid.known.sum() < LEAST_COUNT:
            why = why or (
                f"only {int(grid.known.sum())} of {target.rows * target.columns} corners are in the image; a part of a "
                f"board counts from {LEAST_COUNT} on"
            )
        if isinstance(places, str) or not places or grid.known.sum() < LEAST_COUNT:
            continue
        placed = max(places, key=lambda p: _lower_right(p.grid))
        placed = replace(placed, grid=replace(placed.grid, xy=found.factor * placed.grid.xy + 0.5 * (found.factor - 1)))
        return measured(grey, placed, found.factor, target, LEAST_COUNT, how)
    return None if why is None else Detection.nothing(why)


def _refined_grid(grey: Grey, grid: Grid, factor: int, how: Refinement) -> Refined:
    xy = np.ascontiguousarray(grid.xy)
    at, steps = np.argwhere(grid.known), steps_at(xy, np.ascontiguousarray(grid.known))
    dark = grid.dark ^ (at.sum(axis=1) % 2 == 1)
    grey, start = np.ascontiguousarray(grey), grid.xy[grid.known]
    # A coarse scale knows a corner to about half of its pixels, and is what is left of a blurred picture.
    radius, blur = max(WINDOW_PX, 3.0 * factor), max(1.0, 0.5 * factor)
    refined = refine(grey, start, steps, dark, radius_px=radius, blur_px=blur)
    blur = float(np.median(refined.blur_px))
    if WINDOWS_OF_BLUR * blur > radius:
        radius = WINDOWS_OF_BLUR * blur
        refined = refine(grey, start, steps, dark, radius_px=radius, blur_px=blur)
    if how == DEFAULT:
        return refined
    # From where the first fit put them: other methods have no model of blur to find their way with.
    start = np.where(refined.converged[:, None], refined.uv, start)
    other = refine(grey, start, steps, dark, how=how, radius_px=radius, blur_px=blur)
    return replace(other, contrast=refined.contrast, noise=refined.noise, blur_px=refined.blur_px,
                   converged=refined.converged & other.converged)  # fmt: skip


def _oriented(grid: Grid, target: Chessboard) -> Grid:
    """The grid turned so that its rows and columns are the target's and the square behind corner 0 is dark.

    Of the turns that fit, the one whose x axis runs most to the lower right; on a board that has only one, that one.
    """
    turns = [grid]
    for _ in range(3):
        turns.append(turned(turns[-1]))
    fitting = [g for g in turns if g.shape == (target.rows, target.columns)]
    # The square behind corner 0 has the colour of the one before it. Boards of even counts have one colour at all four
    # corners, and a print in the other colour is as good.
    dark = [g for g in fitting if g.dark]
    return max(dark or fitting, key=_lower_right)


def _lower_right(grid: Grid) -> float:
    x_axis = np.nanmean(np.diff(grid.xy, axis=1), axis=(0, 1))
    # Slightly more right than down, so that a tie is decided.
    return float((x_axis[0] + 0.99 * x_axis[1]) / np.linalg.norm(x_axis))


def _ambiguous(target: Chessboard) -> str:
    return (
        f"a chessboard of {target.columns}x{target.rows} inner corners looks the same turned by "
        f"{target.turns_unnoticed_deg}°, so its orientation cannot be known: corners are numbered with x running right "
        "or down in the image. hand-eye tells by the robot's motion which way it is; elsewhere keep its turn about the "
        "viewing direction within ±45° of upright in all views, or use a board with one even and one odd count of "
        "corners."
    )


def _looks_like(tags: str, target: Chessboard) -> Detection:
    return Detection.nothing(f"the image looks like {tags}, you asked for {target.spec}", looks_like=tags, another=True)


def _not_found(grey: Grey, others: list[_Found], target: Chessboard) -> Detection:
    from calibrant.detection.tags.grid_seen import aprilgrid_seen  # not needed where the board is found

    asked = f"{target.columns}x{target.rows}"
    largest = _largest(f.grid for f in others)
    if largest is None:
        return Detection.nothing(f"no chessboard of {asked} inner corners was found")
    if (tags := aprilgrid_seen(grey)) is not None:  # whose small squares meet the tags in corners of a grid
        return _looks_like(tags, target)
    rows, columns = largest.shape
    if (rows > columns) != (target.rows > target.columns):
        rows, columns = columns, rows
    if (rows, columns) == (target.rows, target.columns):
        return Detection.nothing(
            f"{asked} corners were seen, but the pattern goes on beyond them: it is larger than {asked}, or a floor"
        )
    size = f"{columns}x{rows} inner corners"
    # Fewer corners each way may be a part of the board, whose others are hidden.
    another = columns > target.columns or rows > target.rows
    return Detection.nothing(f"the image looks like {size}, you asked for {asked}", looks_like=size, another=another)


def board_seen(grey: Grey) -> tuple[int, int] | None:
    """Inner corners (columns, rows), the longer side first, of a chessboard in a small grey image (h, w), if there is
    one: for who looks for something else."""
    grid = _grid_seen(grey)
    return None if grid is None else (max(grid.shape), min(grid.shape))


def plain_board_seen(grey: Grey) -> tuple[int, int] | None:
    """As `board_seen`, of a board that has nothing drawn in its squares; in a grey image of any size."""
    level = _level(grey, scales(grey.shape[1], grey.shape[0])[0])
    grid = _grid_seen(level)
    # Squares that go on to the picture's edge may be a floor.
    if grid is None or grid.goes_on or not _whole(grid, level.shape):
        return None
    if any(uneven_share(level, grid.xy, which, dark=grid.dark) > SHARE for which in SQUARES):
        return None
    return max(grid.shape), min(grid.shape)


def _whole(grid: Grid, shape: tuple[int, ...]) -> bool:
    """Whether the squares beyond the outermost corners of all sides are in a picture (h, w)."""
    xy = grid.xy
    beyond = [2 * a - b for a, b in ((xy[0], xy[1]), (xy[-1], xy[-2]), (xy[:, 0], xy[:, 1]), (xy[:, -1], xy[:, -2]))]
    outer = np.concatenate(beyond)
    outer = outer[np.isfinite(outer).all(axis=1)]
    return bool(np.all((outer > -0.5) & (outer < np.array(shape[::-1]) - 0.5)))


def _grid_seen(grey: Grey) -> Grid | None:
    corners = find_corners(grey)
    return _largest(grow_grids(corners, neighbours(corners), least=LEAST_LOOK // 2))


def _largest(grids: Iterable[Grid]) -> Grid | None:
    """The largest grid that is called a board."""
    seen = [g for g in grids if g.known.sum() >= LEAST_LOOK and g.known.mean() >= LEAST_SEEN]
    return max(seen, key=lambda g: g.area) if seen else None
