"""The one engine of pages: a head that answers, blocks, each by its template; one file that fetches nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from calibrant.reports.parts.blocks import Block, Page
from calibrant.reports.parts.numbers import plain, sigma_text
from calibrant.reports.words import FEW, STATUS_WORDS

_PACKAGE = "calibrant.reports"
_MARKS = {"ok": "✓", "warn": "!", "fail": "✕", "refused": "✕"}
"""A shape beside each status, so that it does not hang on colour."""


def render(page: Page) -> str:
    """The page's HTML: it opens anywhere, offline, with everything it shows inside it."""
    return _environment().get_template("page.html.j2").render(page=page, style=asset("page.css"))


def render_answer(page: Page) -> str:
    """The head of a page alone, without scripts or a style of its own: a piece for a notebook."""
    return _environment().get_template("notebook.html.j2").render(page=page)


def render_patterns(pictures: Sequence[Mapping[str, str]], size: tuple[int, int]) -> str:
    """A page that shows pictures pixel by pixel, one a step. Args: words and url of each; size (width, height) px."""
    template = _environment().get_template("patterns.html.j2")
    return template.render(pictures=list(pictures), width=size[0], height=size[1])


def drawn(block: Block) -> Markup:
    """A block's HTML by its template, which has escaped what it was given."""
    return Markup(_environment().get_template(f"blocks/{block.template}.html.j2").render(block.values))


def asset(name: str) -> Markup:
    """A style sheet or script of this package: our own text, safe to embed as it stands."""
    return Markup(resources.files(_PACKAGE).joinpath("templates", name).read_text(encoding="utf-8"))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader(_PACKAGE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals.update(
        plain=plain, sigma_text=sigma_text, marks=_MARKS, status_words=STATUS_WORDS, few=FEW, drawn=drawn
    )
    return environment
