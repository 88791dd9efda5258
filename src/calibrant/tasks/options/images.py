"""Options that say what is seen: photos, the board they show, points found before, and how points are looked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.choices import PAIR_RULES
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels

if TYPE_CHECKING:
    from calibrant.detection.subpixel.refinement import Refinement


@dataclass(frozen=True, kw_only=True)
class PhotoOptions:
    """Photos given without a name, and the board in them."""

    images: Annotated[tuple[str, ...], Option("IMAGES...", positional=True)] = ()
    """Photos, folders or patterns."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""


@dataclass(frozen=True, kw_only=True)
class NamedPhotoOptions:
    """Photos given by --images, beside other data, and the board in them."""

    images: Annotated[tuple[str, ...], Option("IMAGES", "-i")] = ()
    """Photos, folders or patterns."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""


@dataclass(frozen=True, kw_only=True)
class PairPhotoOptions:
    """Photos of two cameras that are fixed to each other."""

    left: Annotated[tuple[str, ...], Option("IMAGES", "-l")] = ()
    """Images of the left one of two cameras, folders or patterns."""
    right: Annotated[tuple[str, ...], Option("IMAGES", "-r")] = ()
    """Images of the right one of two cameras."""
    pairs: Annotated[str, Option("RULE", choices=PAIR_RULES)] = "auto"
    """What belongs together: by name (left01 and right01, or equal names in two folders), by the time stamps in the
    names, by order; auto: the first of these that fits."""

    @property
    def asked(self) -> bool:
        """Whether any are given."""
        return bool(self.left or self.right)


@dataclass(frozen=True, kw_only=True)
class PointsOptions:
    """Points found before."""

    observations: Annotated[Path | None, Option("FILE")] = None
    """Points found before (calibrant detect --out), instead of photos."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Which photos are searched, and where the work is done."""

    mirror_x: bool = False
    """The camera delivers mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Images to leave out, by file name."""
    workers: Annotated[str | int | None, Option("N")] = None
    """Processes that detect, or a Dask scheduler's address: tcp://HOST:PORT."""
    cache: Annotated[str | None, Option("DIR")] = None
    """Keep what was detected in this folder (else in the user's cache folder); none: keep nothing."""


@dataclass(frozen=True, kw_only=True)
class PairSearchOptions:
    """Which images of a pair of cameras are searched, and where the work is done."""

    mirror_left: bool = False
    """The left camera delivers mirror images: flip them left to right."""
    mirror_right: bool = False
    """The right camera delivers mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Images to leave out, by file name, each with its partner."""
    workers: Annotated[str | int | None, Option("N")] = None
    """Processes that detect, or a Dask scheduler's address: tcp://HOST:PORT."""
    cache: Annotated[str | None, Option("DIR")] = None
    """Keep what was detected in this folder (else in the user's cache folder); none: keep nothing."""


@dataclass(frozen=True, kw_only=True)
class RigSearchOptions:
    """Which images of the cameras of a rig are searched, and where the work is done."""

    mirror: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Cameras that deliver mirror images: flip them left to right."""
    exclude: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Images to leave out, by file name (of videos by frame number), each with those of its moment."""
    workers: Annotated[str | int | None, Option("N")] = None
    """Processes that detect, or a Dask scheduler's address: tcp://HOST:PORT."""
    cache: Annotated[str | None, Option("DIR")] = None
    """Keep what was detected in this folder (else in the user's cache folder); none: keep nothing."""


@dataclass(frozen=True, kw_only=True)
class CornerOptions:
    """How corners are measured."""

    refine: Annotated[str, Option("saddle|foerstner|radon")] = "saddle"
    """How the corners of chessboards and ChArUco are measured."""
    window: Annotated[str | None, Option("PERCENT")] = None
    """Half width of the window around a corner, of the distance to the next one: 40%."""
    zero_zone: Annotated[str | None, Option("PX")] = None
    """Leave out the pixels around a corner up to this far: 1px, or along x and y, 1px,2px; none: leave out none."""

    def refinement(self) -> Refinement | None:
        """How corners are measured, None as usual. Raises: InputError for an unknown method, a bare number, or values
        out of range."""
        if (self.refine, self.window, self.zero_zone) == ("saddle", None, None):
            return None  # detection is loaded for photos alone
        from calibrant.detection.subpixel.refinement import Refinement

        return Refinement(self.refine.strip().lower(), _part(self.window), _zone(self.zero_zone))


_NO_ZONE = ("none", "0", "0px", "-1", "-1px")


def _zone(text: str | None) -> float | tuple[float, float]:
    """Half widths of the zone left out: none for 0 and, as OpenCV has it, for -1."""
    parts = [part.strip() for part in (text or "none").split(",")]
    halves = [0.0 if part in _NO_ZONE else pixels(part, option="--zero-zone") or 0.0 for part in parts]
    if len(halves) > 2:
        raise InputError(
            f"--zero-zone takes one length for both axes or two, along x and y, such as 1px,2px; got {text!r}"
        )
    return (halves[0], halves[1]) if len(halves) > 1 else halves[0]


def _part(window: str | None) -> float | None:
    """A part of one from per cent."""
    if window is None:
        return None
    try:
        if window.strip().endswith("%"):
            return float(window.strip().removesuffix("%").strip()) / 100.0
    except ValueError:
        pass
    raise InputError(f"--window takes a percentage of the distance to the next corner, such as 40%; got {window!r}")
