"""Which image of the left camera was taken at once with which of the right one: moments of two lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calibrant.tasks.inputs.image_moments import Rule, matched_images


@dataclass(frozen=True)
class ImagePairs:
    """Pairs of positions (left, right), those without a partner on each side, the rule, and what was done in words."""

    rule: Rule
    pairs: tuple[tuple[int, int], ...]
    alone_left: tuple[int, ...]
    alone_right: tuple[int, ...]
    words: str


def paired_images(left: Sequence[Path], right: Sequence[Path], *, rule: str = "auto") -> ImagePairs:
    """Pair the images of two cameras as `matched_images` does. Raises: InputError as there."""
    found = matched_images({"left": left, "right": right}, rule=rule)
    pairs = sorted((i, j) for i, j in found.rows if i is not None and j is not None)
    alone_left, alone_right = (tuple(sorted(side)) for side in found.alone)
    return ImagePairs(found.rule, tuple(pairs), alone_left, alone_right, found.words)
