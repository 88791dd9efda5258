"""calibrant target SPEC --out board.pdf: a target to print at true size, and its spec in a file beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import session


def target(
    spec: Annotated[
        str, typer.Argument(help="The target, e.g. charuco:5x7:40mm:20mm:DICT_6X6_250.", show_default=False)
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The file to write: .pdf, .svg or .png.", show_default=False)
    ],
    page: Annotated[str, typer.Option("--page", help="auto, fit, a4, a3, a2, a1, a0, letter or tabloid.")] = "auto",
    force: o.Force = False,
    quiet: o.Quiet = False,
    debug: o.Debug = False,
) -> None:
    """Write a target as printable artwork at true size, with a ruler, and its spec as YAML beside it."""
    text = run(spec, out=out, page=page, force=force)
    if not quiet:
        typer.echo(text)


def run(spec: str, *, out: Path, page: str = "auto", force: bool = False) -> str:
    """Write the artwork and its YAML; returns what to tell the user.

    Raises: InputError for an impossible spec, page or file; nothing is written then.
    """
    from calibrant.reports.artwork import writer_for
    from calibrant.reports.sheet import sheet_of
    from calibrant.targets.registry import parse_target

    board = parse_target(spec)
    write = writer_for(out)
    sheet = sheet_of(board, page=page)
    spec_file = out.with_suffix(".yaml")
    for path in (out, spec_file):
        session.check_writable(path, force=force)
    width, height = sheet.size
    lines = [
        f"# {out.name}: {width:g} x {height:g} mm, to be printed at 100 %; its ruler must then measure 100 mm.",
        "# After measuring a square of the print, put its real size here.",
        f"target: {board.spec}",
    ]
    session.write_bytes(out, write(sheet))
    session.write_bytes(spec_file, ("\n".join(lines) + "\n").encode())
    return (
        f"{out}: {board.spec} on {'its own page size' if sheet.page == 'fit' else sheet.page.upper()}, "
        f"{width:g} x {height:g} mm\n{spec_file}: its spec, for --target\n"
        "Print at 100 % (actual size): scaling to fit the page changes the squares. Measure the ruler: 100 mm."
    )
