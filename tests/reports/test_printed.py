"""The report as a PDF: by Chromium or WeasyPrint, few pages, nothing cut; and opened from disk without a request."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from tests.made_results import make_intrinsics

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.reports import printed
from calibrant.reports.html import report_page, write_report

BROWSER = printed.browser()
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
MOST_PAGES = 8
MOST_BYTES = 8_000_000


@pytest.fixture(scope="module")
def fifty() -> CalibrationResult:
    found = make_intrinsics(50)
    files = tuple({"file": f"/photos/{i}.png", "sha256": "ab" * 32} for i in range(50))
    return replace(found, inputs=files)


def pages(pdf: bytes) -> int:
    return len(re.findall(rb"/Type\s*/Page\b", pdf))


@pytest.mark.long
@needs_browser
def test_fifty_views_print_on_few_pages(fifty: CalibrationResult, tmp_path: Path) -> None:
    made = write_report(fifty, tmp_path / "report.pdf").read_bytes()
    assert made.startswith(b"%PDF-")
    assert 2 <= pages(made) <= MOST_PAGES


WIDEST = """<script>
window.addEventListener("load", () => {
  const cut = [...document.querySelectorAll("table, pre, svg, canvas, img")].filter((e) => {
    const box = e.getBoundingClientRect();
    return box.width > 0 && (box.right > document.documentElement.clientWidth + 1 || e.scrollWidth > e.clientWidth + 1);
  });
  document.title = `CUT ${cut.length} OF ${document.querySelectorAll("table").length}`;
});
</script>"""
"""Of the page as it is printed: its print rules for the screen, in a window as wide as paper."""


@pytest.mark.long
@needs_browser
def test_on_paper_no_table_is_cut(fifty: CalibrationResult, tmp_path: Path) -> None:
    page = report_page(fifty).replace("@media print", "@media screen").replace("<style>", f"{WIDEST}<style>", 1)
    dom = opened(page, tmp_path, "--window-size=700,1000", "--dump-dom").stdout
    title = re.search(r"<title>(.*?)</title>", dom)
    assert title is not None
    assert re.fullmatch(r"CUT 0 OF [1-9]\d*", title.group(1))


@pytest.mark.long
@needs_browser
def test_opened_from_disk_it_asks_for_nothing_and_complains_of_nothing(
    fifty: CalibrationResult, tmp_path: Path
) -> None:
    page = report_page(fifty)
    assert len(page.encode()) < MOST_BYTES
    log = tmp_path / "net.json"
    done = opened(page, tmp_path, f"--log-net-log={log}", "--enable-logging=stderr", "--dump-dom")
    assert "CONSOLE" not in done.stderr
    asked = re.findall(r'"url":"(?:https?|file)[^"]*"', log.read_text(encoding="utf-8", errors="replace"))
    # What Chromium asks its maker for by itself is not the page's.
    assert [url for url in asked if not re.search(r"opened\.html|google|gvt1\.com", url)] == []


def opened(page: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    path = folder / "opened.html"
    path.write_text(page, encoding="utf-8")
    command = [
        *(str(BROWSER), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-extensions"),
        *(f"--user-data-dir={folder}/profile", *options, path.as_uri()),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_numbers_on_the_page_are_those_of_the_file(fifty: CalibrationResult) -> None:
    page = report_page(fifty)
    found = re.search(r'id="data">(.*?)</script>', page, re.S)
    assert found is not None
    views = {v["id"]: v for v in json.loads(found.group(1))["views"]}
    assert all(views[v.id]["rms"] == v.rms_px for v in fifty.views)


def test_without_a_printer_it_says_what_to_install(
    fifty: CalibrationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(printed, "browser", lambda: None)
    monkeypatch.setattr(printed, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'calibrant\[pdf\]'"):
        write_report(fifty, tmp_path / "report.pdf")
    assert list(tmp_path.iterdir()) == []


def test_without_scripts_everything_but_the_drawings_stays(fifty: CalibrationResult) -> None:
    page = report_page(fifty, still=True)
    assert "<script" not in page
    assert "<canvas" not in page
    assert "Error of each view" in page
    assert page.count("<tr>") > 50


def test_drawings_bring_their_colours_where_the_page_gives_none(fifty: CalibrationResult) -> None:
    page = printed._coloured(report_page(fifty, still=True))
    first = page[page.index("<svg") :]
    assert ".cell {  fill: #1f6fb2;" in first[: first.index("</style>")]
    assert "var(" not in first[: first.index("</style>")]


@pytest.mark.long
def test_weasyprint_prints_it_too(fifty: CalibrationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("weasyprint", reason="the extra pdf is not installed")
    monkeypatch.setattr(printed, "browser", lambda: None)
    made = write_report(fifty, tmp_path / "report.pdf").read_bytes()
    assert made.startswith(b"%PDF-")


def test_weasyprint_without_what_it_draws_with_is_a_refusal(
    fifty: CalibrationResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weasyprint.py").write_text("raise OSError('cannot load library libpango-1.0-0')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "weasyprint", raising=False)
    monkeypatch.setattr(printed, "browser", lambda: None)
    with pytest.raises(InputError, match=r"libpango-1\.0-0.*install Pango"):
        write_report(fifty, tmp_path / "report.pdf")
