"""What is done with an outcome on a command line: shown, written whole or not at all, said where; its exit status."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.cli.command import Call
from calibrant.cli.outputs import beside_of
from calibrant.cli.words import console, say, say_json, tell
from calibrant.errors import CalibrantError, RefusedError
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.writing import write_documents

if TYPE_CHECKING:
    from rich.console import Console

    from calibrant.data import CalibrationResult
    from calibrant.diagnose.look import Look

_PICTURES = (".png", ".jpg", ".jpeg", ".jpe", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".exr", ".hdr")
NARROWEST = 72
"""Columns that the widest table of a summary needs to show its figures whole."""
_LISTED = 3
"""Pictures of one folder that are named; of more, their number."""


def finish(outcome: Outcome, call: Call) -> CalibrantError | None:
    """Write the documents, show the summary, say what was written. Returns: why the answer is no all the same: the
    outcome's own refusal, or warnings where --strict lets none pass. Raises: InputError.
    """
    outputs = call.outputs
    shown = outputs.report is not None or not outputs.silent
    # One look serves page and terminal: what both show is computed once.
    seen = _seen(outcome.result) if shown and outcome.result is not None else None
    written = write_documents(_documents(outcome, call, seen), force=outputs.force)
    if outputs.json:
        say_json(outcome.text() if outcome.printed is None else outcome.printed())
    elif not outputs.silent:
        _show(outcome, seen, verbose=outputs.verbose)
        if written:
            say(f"\nWritten: {', '.join(_listed(written))}\n")
        then = _then(outcome, call)
        if then is not None:
            say(f"To {then[0]}:\n  {then[1]}\n")
    told = [f"warning: {text}" for text in outcome.warnings]
    if outputs.quiet and outcome.result is not None:
        told += _warnings(outcome.result)
    for line in told:
        tell(f"calibrant: {line}")
    return outcome.refusal or _not_strict(outcome, call)


def explained(error: RefusedError, call: Call) -> RefusedError:
    """A refused calibration writes no result, but its report, when asked for: it shows why."""
    from calibrant.data import CalibrationResult
    from calibrant.tasks.inputs.session import with_misses

    report = call.outputs.report
    if report is None:
        return error
    refused = error.result if isinstance(error.result, CalibrationResult) else _bare(error, call)
    page = Document(report, partial(_page, _seen(with_misses(refused)), report))
    write_documents([page], force=call.outputs.force)
    told = RefusedError(f"{error}\ncalibrant: {report} shows the refused calibration")
    told.result = error.result
    return told


def _bare(error: RefusedError, call: Call) -> CalibrationResult:
    """What is known of a calibration that did not get as far as a result: why, and what it was to be made from."""
    from calibrant.data import CalibrationResult, Check
    from calibrant.data.verdicts import stamp
    from calibrant.reports.kinds.registry import KINDS
    from calibrant.tasks.inputs.session import file_records
    from calibrant.tasks.registry import reads_of

    words = call.command.name.split()
    kind = next((word for word in reversed(words) if word in KINDS), words[0])
    inputs = file_records(reads_of(call.command.task, call.request))
    return stamp(CalibrationResult(kind, "refused", checks=(Check("refused", "fail", str(error)),), inputs=inputs))


def _warnings(result: CalibrationResult) -> list[str]:
    """Every warning in a line."""
    return [f"warning: {c.name}: {' '.join(c.message.split())}" for c in result.checks if c.status == "warn"]


def _not_strict(outcome: Outcome, call: Call) -> RefusedError | None:
    """The refusal of a result that warns, where only one without any is wanted."""
    result = outcome.result
    if not call.outputs.strict or result is None or result.verdict == "ok":
        return None
    names = ", ".join(dict.fromkeys(c.name for c in result.checks if c.status != "ok"))
    error = RefusedError(f"not without warnings, which --strict asks for: {names or result.verdict}")
    error.result = result
    return error


def _documents(outcome: Outcome, call: Call, seen: Look | None) -> Iterator[Document]:
    """Every file of a command: the result, what stands beside it, what was asked for, and the report."""
    outputs = call.outputs
    if outputs.out is not None:
        yield Document(outputs.out, lambda: outcome.text().encode())
        for document in outcome.beside:
            yield replace(document, path=beside_of(outputs.out, document.path.name, force=outputs.force))
    yield from outcome.documents
    if outputs.report is not None:
        yield Document(outputs.report, partial(_page_bytes, outcome, seen, outputs.report, _then(outcome, call)))


def _seen(result: CalibrationResult) -> Look:
    from calibrant.diagnose.look import look

    return look(result)


def _then(outcome: Outcome, call: Call) -> tuple[str, str] | None:
    """What to do next in words, and the command, one line, however long: a terminal that folds it copies it whole."""
    if outcome.then is None:
        return None
    from calibrant.cli.next_command import next_command

    return outcome.then.words, next_command(outcome.then, call)


def _page_bytes(outcome: Outcome, seen: Look | None, path: Path, then: tuple[str, str] | None) -> bytes:
    """The task's own page, or the one that every result has."""
    from calibrant.reports.html import report_file

    own = outcome.page
    if own is not None:
        return report_file(lambda still: own(), path)
    return b"" if seen is None else _page(seen, path, then)


def _page(seen: Look, path: Path, then: tuple[str, str] | None = None) -> bytes:
    from calibrant.reports.html import report_file, report_page

    return report_file(lambda still: report_page(seen, then=then, still=still), path)


def _show(outcome: Outcome, seen: Look | None, *, verbose: bool) -> None:
    from rich.text import Text

    shown = seen if outcome.summary is None else outcome.summary()
    shown_on = _console()
    for part in shown if isinstance(shown, tuple) else (shown,):
        if _is_result(part):
            from calibrant.reports.terminal import summary

            shown_on.print(summary(part, verbose=verbose))
        elif part is not None:
            # Lines of text are as long as their words; what Rich lays out itself is laid into the terminal's width.
            shown_on.print(part, soft_wrap=isinstance(part, Text))
    if outcome.summary is not None and outcome.result is not None and outcome.result.notes:
        from calibrant.reports.terminal import notes

        shown_on.print(*notes(outcome.result))


def _is_result(part: object) -> bool:
    """Whether it is a result, or a look at one: told as every result is."""
    if isinstance(part, str):
        return False
    from calibrant.data import CalibrationResult
    from calibrant.diagnose.look import Look

    return isinstance(part, CalibrationResult | Look)


def _console() -> Console:
    """Standard output. A table that a narrow terminal cannot hold is folded by the terminal: no figure is cut."""
    shown = console()
    return shown if shown.width >= NARROWEST else console(width=NARROWEST)


def _listed(written: list[Path]) -> list[str]:
    """The files by name; of many pictures in one folder, how many, and what stands beside them."""
    folders: dict[Path, list[Path]] = {}
    for path in written:
        folders.setdefault(path.parent, []).append(path)
    many = {folder: paths for folder, paths in folders.items() if len(_pictures(paths)) > _LISTED}
    out = [str(path) for path in written if path.parent not in many]
    return [*out, *(f"{_counted(paths)} in {folder}" for folder, paths in many.items())]


def _counted(paths: list[Path]) -> str:
    """ "8 pictures and camera.json"."""
    pictures = _pictures(paths)
    return " and ".join([f"{len(pictures)} pictures", *(path.name for path in paths if path not in pictures)])


def _pictures(paths: list[Path]) -> list[Path]:
    return [path for path in paths if path.suffix.lower() in _PICTURES]
