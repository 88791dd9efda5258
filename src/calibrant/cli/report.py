"""`calibrant report`: a result file shown again, or made into its HTML report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o
from calibrant.cli import pose_options as p


def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="The result file.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE.html", help="Write the HTML report here.", show_default=False),
    ] = None,
    workspace: p.Workspace = None,
    tolerance: p.Tolerance = None,
    target_sigma: p.TargetSigma = None,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:
    """Show what a result file holds, and write its HTML report.

    calibrant report camera.json --out camera.html
    calibrant report hand-eye.json --workspace 300mm:700mm,-200mm:200mm,0mm:100mm --tolerance 1mm

    The photos are shown where they still lie under the names they had, seen from the folder of this command.
    """
    from calibrant.cli import session
    from calibrant.data.result_file import read_result
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.diagnose.look import look
    from calibrant.tasks.options.workspace import WorkspaceOptions

    outputs = session.Outputs(report=out, quiet=quiet, force=force)
    outputs.check()
    outputs.spare([result])
    asked = WorkspaceOptions(workspace=workspace, tolerance=tolerance, target_sigma=target_sigma)
    found = asked.applied(read_result(result))
    seen = look(found)
    if not quiet:
        from rich.console import Console

        from calibrant.reports.terminal import summary

        Console().print(summary(seen))
    if out is not None:
        from calibrant.reports.html import write_report

        write_report(seen, out, force=force)
        if not quiet:
            typer.echo(f"\nWritten: {out}")
    if workspace is not None:
        from calibrant.diagnose.budget.workspace import is_workspace_check

        # Of the checks only these are new: a report of a refused result is a report.
        refuse_if_failed(replace(found, checks=tuple(c for c in found.checks if is_workspace_check(c))))
