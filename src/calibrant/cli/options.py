"""Options that commands share, and their parsing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from calibrant.errors import InputError

Out = Annotated[Path | None, typer.Option("--out", "-o", help="Write the result file (JSON) here.", show_default=False)]
Report = Annotated[Path | None, typer.Option("--report", help="Write an HTML report here.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print the result (JSON) on standard output, nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing output files.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
Target = Annotated[
    str, typer.Option("--target", "-t", help="The board, e.g. chessboard:9x6:25mm (inner corners).", show_default=False)
]
Exclude = Annotated[
    list[str] | None, typer.Option("--exclude", help="Images to leave out, by file name.", show_default=False)
]
Fix = Annotated[
    list[str] | None,
    typer.Option("--fix", help="Hold: fx fy cx cy k1 k2 k3 aspect tangential focal principal.", show_default=False),
]
Model = Annotated[str, typer.Option("--model", help="Camera model: brown or pinhole.")]
MirrorX = Annotated[bool, typer.Option("--mirror-x", help="The camera delivers mirror images: flip them left to right.")]
Workers = Annotated[int | None, typer.Option("--workers", help="Processes that detect.", min=1, show_default=False)]


def split_names(values: Sequence[str] | None) -> tuple[str, ...]:
    """Names given as separate values or separated by commas."""
    return tuple(n for value in values or () for n in value.replace(",", " ").split())


def pixels(text: str | None, *, option: str) -> float | None:
    """A length in pixels with its unit: 1.0px. Raises: InputError for a bare number or another unit."""
    if text is None:
        return None
    number = text.strip().removesuffix("px").strip()
    try:
        value = float(number)
    except ValueError:
        value = -1.0
    if not text.strip().endswith("px") or not value > 0:
        raise InputError(f"{option} takes a length in pixels with its unit, such as 1.0px; got {text!r}")
    return value


def exclude_names(files: Sequence[Path], names: Sequence[str]) -> list[Path]:
    """Files without those named (with or without extension). Raises: InputError for a name that is not there."""
    unknown = [n for n in names if not any(n in (f.name, f.stem, str(f)) for f in files)]
    if unknown:
        listed = ", ".join(f.name for f in files[:6])
        raise InputError(f"--exclude {unknown[0]}: no image of that name; there are {listed}{' …' if len(files) > 6 else ''}")
    return [f for f in files if not any(n in (f.name, f.stem, str(f)) for n in names)]
