"""`calibrant report`: a result file shown again, or made into its HTML report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o


def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="The result file.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE.html", help="Write the HTML report here.", show_default=False),
    ] = None,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:
    """Show what a result file holds, and write its HTML report.

    calibrant report camera.json --out camera.html

    The photos are shown where they still lie under the names they had, seen from the folder of this command.
    """
    from calibrant.cli import session
    from calibrant.data.result_file import read_result

    outputs = session.Outputs(report=out, quiet=quiet, force=force)
    outputs.check()
    outputs.spare([result])
    found = read_result(result)
    if not quiet:
        from rich.console import Console

        from calibrant.report.terminal import summary

        Console().print(summary(found))
    if out is None:
        return

    from calibrant.report.html import write_report

    write_report(found, out, force=force)
    if not quiet:
        typer.echo(f"\nWritten: {out}")
