"""A page that shows a projector's patterns full-screen, pixel by pixel, one a step."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence

from calibrant.reports.page import render_patterns


def pattern_page(pictures: Sequence[tuple[str, bytes]], size: tuple[int, int]) -> str:
    """The page's HTML, with everything inside. Args: (words, PNG) of each pattern; size (width, height) px."""
    shown = [{"words": words, "url": f"data:image/png;base64,{b64encode(data).decode()}"} for words, data in pictures]
    return render_patterns(shown, size)
