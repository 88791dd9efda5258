"""Pages as PDF: by Chromium where there is one, which runs the page's scripts first; else by WeasyPrint."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from calibrant.errors import InputError
from calibrant.reading.files import open_file

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_SECONDS = 120
"""A page of 200 views takes 5; a browser that hangs must not hang us."""


def browser() -> str | None:
    """The Chromium on this machine, None where there is none."""
    return next((found for found in map(shutil.which, BROWSERS) if found), None)


def pdf(page: Callable[[bool], str]) -> bytes:
    """The PDF, A4, of a page. Args: page: its HTML; asked with True, drawn without scripts.

    Raises: InputError where there is neither Chromium nor WeasyPrint, or the browser fails.
    """
    found = browser()
    if found is not None:
        return _by_browser(found, page(False))
    if find_spec("weasyprint") is None:
        raise InputError(
            "a PDF needs Chromium on this machine, or WeasyPrint: pip install 'calibrant[pdf]'; or write the report as "
            ".html and print it from a browser"
        )
    return _by_weasyprint(page(True))


def _by_browser(program: str, html: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="calibrant-") as folder:
        source, target = Path(folder) / "report.html", Path(folder) / "report.pdf"
        source.write_text(html, encoding="utf-8")
        command = [
            *(program, "--headless", "--disable-gpu", "--no-first-run", "--disable-extensions", "--disable-quic"),
            # The page fetches nothing, and shall not: no name is looked up.
            *("--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND"),
            *(f"--user-data-dir={folder}/profile", "--no-pdf-header-footer", f"--print-to-pdf={target}"),
            # As root, as in containers, Chromium runs without its sandbox or not at all; the page is our own.
            *(["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []),
            source.as_uri(),
        ]
        try:
            subprocess.run(command, capture_output=True, check=True, timeout=_SECONDS)
            with open_file(target) as stream:
                return stream.read()
        except (OSError, subprocess.SubprocessError, InputError) as error:
            raise InputError(
                f"{program} made no PDF of the report ({type(error).__name__}); write it as .html and print it"
            ) from error


def _by_weasyprint(html: str) -> bytes:
    try:
        from weasyprint import HTML
        from weasyprint.urls import URLFetcher
    except OSError as error:
        raise InputError(
            f"WeasyPrint does not find what it draws with ({str(error)[:80]}): install Pango (Debian: libpango-1.0-0 "
            "libpangoft2-1.0-0), or Chromium; or write the report as .html and print it from a browser"
        ) from error

    # Nothing but what the page holds is fetched.
    made: bytes = HTML(string=_coloured(html), url_fetcher=URLFetcher(allowed_protocols=("data",))).write_pdf()
    return made


def _coloured(html: str) -> str:
    """The page with the colours of its drawings in each of them: WeasyPrint gives a drawing no style of the page."""
    style = re.search(r"<style>(.*?)</style>", html, re.DOTALL)
    css = "" if style is None else re.sub(r"/\*.*?\*/", "", style.group(1), flags=re.DOTALL)
    # The colours of light paper stand first, those of print and of dark screens below.
    colours = dict(re.findall(r"--([\w-]+):\s*([^;}]+)", css[: css.find("}")]))
    rules = "".join(
        f"{selector.strip()} {{ {_resolved(body, colours)} }}\n"
        for selector, body in re.findall(r"([^{}]+)\{([^{}]*)\}", css.partition("@page")[0])
        if re.search(r"\b(fill|stroke)\b", body)
    )
    return re.sub(r"(<svg\b[^>]*>)", lambda found: f"{found.group(1)}<style>{rules}</style>", html)


def _resolved(body: str, colours: dict[str, str]) -> str:
    return re.sub(r"var\(--([\w-]+)\)", lambda found: colours.get(found.group(1), "#000").strip(), body)
