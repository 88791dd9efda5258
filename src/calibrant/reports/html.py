"""The report of a result: one HTML file that opens anywhere, offline, with everything it shows inside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from calibrant.data import CalibrationResult
from calibrant.data.result_file import write_bytes
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
    paths: bool = False,
    force: bool = False,
) -> Path:
    """Write the report of a result as one HTML file without links to anything outside it, or as a PDF.

    Args: result, or a look at it that has served another; images, files by view id, where they are no longer at the
    place the observations name; paths, whether files are named with their folders; force, whether an existing file may
    be replaced. Pictures that cannot be read are left out and the page says so.
    Raises: InputError when the path exists and `force` is False, or cannot be written, or nothing here makes a PDF;
    nothing is left half-written.

        >>> import calibrant as cb
        >>> cb.write_report(cb.read("camera.json"), "camera.html")  # doctest: +SKIP
    """
    page = partial(report_page, result, images=images, paths=paths)
    return write_bytes(report_file(lambda still: page(still=still), Path(path)), path, force=force)


def report_page(
    result: CalibrationResult | Look,
    *,
    images: Mapping[str, str | Path] | None = None,
    then: tuple[str, str] | None = None,
    first: Sequence[Block] = (),
    beside: Sequence[CalibrationResult] = (),
    paths: bool = False,
    still: bool = False,
) -> str:
    """The report's HTML, for whoever writes it or shows it.

    Args: as `write_report`; then, what to do next in words, and the command that does it; first, what stands before
    what the result says: pictures that a result file does not hold; beside, comparisons with others; still, drawn
    without scripts.
    """
    expect(result, (CalibrationResult, Look), "the result", "a CalibrationResult, such as cb.read('camera.json')")
    seen = look(result)
    files = {view: Path(file) for view, file in (images or {}).items()}
    if not paths:
        seen, files = _without_folders(seen, files)
    parts = sections(seen, images=files, beside=beside, still=still)
    after = () if then is None else (Block("command", {"words": then[0], "command": then[1]}),)
    page = result_head(seen.result, (*after, *first, *parts.blocks))
    if still:
        return render(page)
    drawn = [asset("result.js"), asset("scene.js"), asset("pairs.js")] if parts.data is not None else []
    return render(replace(page, data=parts.data, scripts=[*drawn, asset("copy.js")]))


def report_file(page: Callable[[bool], str], path: Path) -> bytes:
    """A page as its file's ending asks: a PDF, else HTML. Args: page, its HTML; asked with True, without scripts.

    Raises: InputError where a PDF is asked for and nothing here makes one.
    """
    if path.suffix.lower() != ".pdf":
        return page(False).encode()
    from calibrant.reports.printed import pdf

    return pdf(page)


def _without_folders(seen: Look, files: dict[str, Path]) -> tuple[Look, dict[str, Path]]:
    """A look at the result without the folders of its files, with all that was computed of it already."""
    from calibrant.reports.nameless import cleaner, without_folders

    bare, cleaned = without_folders(seen.result), cleaner(seen.result)
    if bare is seen.result:
        return seen, files
    same = [v.id for v in bare.views] == [v.id for v in seen.result.views]
    return (seen.at(bare) if same else look(bare)), {cleaned(view): file for view, file in files.items()}


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
