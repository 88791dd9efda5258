"""Options that commands share, and their parsing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.errors import InputError
from calibrant.tasks.options.words import pixels as pixels
from calibrant.tasks.options.words import split_names as _split_names

if TYPE_CHECKING:
    from calibrant.detection.subpixel.refinement import Refinement

Images = Annotated[
    list[str] | None,
    typer.Argument(metavar="IMAGES...", help="Photos, folders or patterns.", show_default=False),
]
ObservationsFile = Annotated[
    Path | None,
    typer.Option(
        "--observations", metavar="FILE", help="Points found before (calibrant detect --out), instead of photos.",
        show_default=False,
    ),
]  # fmt: skip
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE", help="Write the result file (JSON) here.", show_default=False),
]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE.html", help="Write an HTML report here.", show_default=False),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result (JSON) on standard output, nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Target = Annotated[
    str | None,
    typer.Option(
        "--target", "-t", metavar="SPEC", show_default=False,
        help="The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file.",
    ),
]  # fmt: skip
Exclude = Annotated[
    list[str] | None,
    typer.Option("--exclude", metavar="NAMES", help="Images to leave out, by file name.", show_default=False),
]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        "--fix", metavar="NAMES", show_default=False,
        help="Hold these: fx fy cx cy k1 k2 k3 p1 p2, aspect, tangential, focal, principal.",
    ),
]  # fmt: skip
Model = Annotated[
    str,
    typer.Option(
        "--model",
        metavar="NAME",
        help="Camera model: pinhole, pinhole_skew, brown, rational, thin_prism, tilted, inverse_brown, division, "
        "kannala_brandt, unified, extended_unified, double_sphere, orthographic, splined (or splined:16x12:120deg), "
        "or auto: chosen by held-out photos.",
    ),
]
MirrorX = Annotated[
    bool, typer.Option("--mirror-x", help="The camera delivers mirror images: flip them left to right.")
]
Workers = Annotated[
    str | None,
    typer.Option(
        "--workers", metavar="N", show_default=False,
        help="Processes that detect, or a Dask scheduler's address: tcp://HOST:PORT.",
    ),
]  # fmt: skip
Cache = Annotated[
    str | None,
    typer.Option(
        "--cache", metavar="DIR", show_default=False,
        help="Keep what was detected in this folder (else in the user's cache folder); none: keep nothing.",
    ),
]  # fmt: skip
Refine = Annotated[
    str,
    typer.Option(
        "--refine", metavar="saddle|foerstner|radon", help="How the corners of chessboards and ChArUco are measured."
    ),
]
Window = Annotated[
    str | None,
    typer.Option(
        "--window", metavar="PERCENT", show_default=False,
        help="Half width of the window around a corner, of the distance to the next one: 40%.",
    ),
]  # fmt: skip
ZeroZone = Annotated[
    str | None,
    typer.Option(
        "--zero-zone", metavar="PX", show_default=False,
        help="Leave out the pixels around a corner up to this far, e.g. 1px.",
    ),
]  # fmt: skip

Robot = Annotated[
    str | None,
    typer.Option(
        "--robot", metavar="FILE", show_default=False,
        help="The robot, where joint values are given: URDF, DH table (YAML), or a name such as ur5e.",
    ),
]  # fmt: skip
RobotLink = Annotated[
    str | None,
    typer.Option("--robot-link", metavar="NAME", help="URDF: the link that ends the chain.", show_default=False),
]
RobotBase = Annotated[
    str | None,
    typer.Option("--robot-base", metavar="NAME", help="URDF: the link that starts the chain.", show_default=False),
]
JointAngle = Annotated[str, typer.Option("--joint-angle", metavar="UNIT", help="auto (by the limits), deg or rad.")]
RobotFormat = Annotated[
    str | None,
    typer.Option(
        "--robot-format", metavar="MAKER", show_default=False,
        help="How poses are written: ur, franka, kuka, fanuc, abb, yaskawa, staubli, kawasaki.",
    ),
]  # fmt: skip


def refinement(method: str, window: str | None, zero_zone: str | None) -> Refinement:
    """How corners are measured. Raises: InputError for an unknown method, a bare number, or values out of range."""
    from calibrant.detection.subpixel.refinement import Refinement

    part = None
    if window is not None:
        number = window.strip().removesuffix("%").strip()
        try:
            part = float(number) / 100.0
        except ValueError:
            part = None
        if part is None or not window.strip().endswith("%"):
            raise InputError(
                f"--window takes a percentage of the distance to the next corner, such as 40%; got {window!r}"
            )
    zone = pixels(zero_zone, option="--zero-zone")
    return Refinement(method.strip().lower(), part, zone or 0.0)


def split_names(values: Sequence[str] | None) -> tuple[str, ...]:
    """Names given as separate values or separated by commas."""
    return _split_names(values or ())
