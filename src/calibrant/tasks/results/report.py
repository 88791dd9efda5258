"""A result file shown again, or made into its report, with its accuracy in a workspace, and beside others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.errors import RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.workspace import WorkspaceOptions
from calibrant.tasks.outcome import Outcome, page_document

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult

EXAMPLE = 'cb.report("hand-eye.json", out="hand-eye.html")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Show what a result file holds, and write its report: HTML, or a PDF to print.

    calibrant report camera.json --out camera.html
    calibrant report monday.json friday.json --out both.pdf
    calibrant report hand-eye.json --workspace 300mm:700mm,-200mm:200mm,0mm:100mm --tolerance 1mm

    The photos are shown where they still lie under the names they had, seen from the folder of this command. With more
    files the report is the first one's, with what differs in each of the others.
    """

    result: Annotated[Path, Option("RESULT.json", positional=True)]
    """The result file."""
    others: Annotated[tuple[str, ...], Option("OTHERS...", positional=True)] = ()
    """Results, or cameras of any program, to compare it with."""
    out: Annotated[Path | None, Option("FILE.html", "-o", output="file")] = None
    """Write the report here: .html, or .pdf (by Chromium, or WeasyPrint)."""
    paths: bool = False
    """Name files with the folders of this machine."""
    work: WorkspaceOptions = WorkspaceOptions()


def reads(request: Request) -> list[Path]:
    """The result files; of a folder none, since its formats choose."""
    return [request.result, *(file for file in map(Path, request.others) if not file.is_dir())]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The result, with the workspace's accuracy among its checks. Raises: InputError for a file that is none.

    Of the checks only those of the workspace are new: a report of a refused result is a report.
    """
    from calibrant.data.result_file import read_result

    found = request.work.applied(read_result(request.result))
    compared = tuple(_compared(found, request.result, Path(other)) for other in request.others)
    how: dict[str, Any] = {"beside": compared, "paths": request.paths}
    pages = () if request.out is None else (page_document(found, request.out, **how),)
    told = None if not compared else lambda: (found, *compared)
    return Outcome(result=found, documents=pages, summary=told, refusal=_refusal(found, request.work))


def _compared(found: CalibrationResult, file: Path, other: Path) -> CalibrationResult:
    from calibrant.diagnose.compare.results import compare_results
    from calibrant.tasks.results.compare import names_of, read_both

    return compare_results(found, read_both((file, other))[1], names=names_of((file, other)))


def _refusal(result: CalibrationResult, work: WorkspaceOptions) -> RefusedError | None:
    """Of a workspace that fails its tolerance."""
    if work.workspace is None:
        return None
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.diagnose.budget.volume import is_workspace_check

    try:
        refuse_if_failed(replace(result, checks=tuple(c for c in result.checks if is_workspace_check(c))))
    except RefusedError as error:
        error.result = result
        return error
    return None
