"""The report of a result: one HTML file that opens anywhere, offline, with everything it shows inside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from calibrant.data import CalibrationResult
from calibrant.data.result_file import write_text
from calibrant.diagnose.look import Look, look
from calibrant.expected import expect
from calibrant.reports.kinds.registry import kind_of
from calibrant.reports.page import asset, render
from calibrant.reports.parts.blocks import Block, Page
from calibrant.reports.sections import sections
from calibrant.reports.words import title, verdict_sentence, verdict_word


def write_report(
    result: CalibrationResult | Look,
    path: str | Path,
    *,
    images: Mapping[str, str | Path] | None = None,
    force: bool = False,
) -> Path:
    """Write the report of a result as one HTML file without links to anything outside it.

    Args: result, or a look at it that has served another; images, files by view id, where they are no longer at the
    place the observations name; force, whether an existing file may be replaced. Pictures that cannot be read are left
    out and the page says so.
    Raises: InputError when the path exists and `force` is False, or cannot be written; nothing is left half-written.

        >>> import calibrant as cb
        >>> cb.write_report(cb.read("camera.json"), "camera.html")  # doctest: +SKIP
    """
    return write_text(report_page(result, images=images), path, force=force)


def report_page(
    result: CalibrationResult | Look,
    *,
    images: Mapping[str, str | Path] | None = None,
    then: tuple[str, str] | None = None,
    first: Sequence[Block] = (),
) -> str:
    """The report's HTML, for whoever writes it or shows it.

    Args: as `write_report`; then, what to do next in words, and the command that does it; first, what stands before
    what the result says: pictures that a result file does not hold.
    """
    expect(result, (CalibrationResult, Look), "the result", "a CalibrationResult, such as cb.read('camera.json')")
    seen = look(result)
    parts = sections(seen, images={view: Path(file) for view, file in (images or {}).items()})
    after = () if then is None else (Block("command", {"words": then[0], "command": then[1]}),)
    page = result_head(seen.result, (*after, *first, *parts.blocks))
    drawn = [asset("result.js"), asset("scene.js"), asset("pairs.js")] if parts.data is not None else []
    return render(replace(page, data=parts.data, scripts=[*drawn, asset("copy.js")]))


def result_head(result: CalibrationResult, blocks: Sequence[Block] = ()) -> Page:
    """A page of a result with its head: title, verdict, reason, the figures that count."""
    return Page(
        title(result),
        result.verdict,
        verdict_word(result),
        verdict_sentence(result),
        kind_of(result).headline(result),
        blocks,
        result.version,
        result.created,
    )
