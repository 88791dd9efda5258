"""Ways through a tree of frames, each of which has one parent (REP 105): up to a common one, and down from there."""

from __future__ import annotations

from collections.abc import Callable

Parent = Callable[[str], str | None]
"""A frame's parent, None at the top."""


def ancestors(frame: str, parent_of: Parent) -> list[str]:
    """The frame and all above it; in a tree that goes in a circle those before it closes.

    >>> ancestors("tool", {"tool": "wrist", "wrist": "base"}.get)
    ['tool', 'wrist', 'base']
    """
    path = [frame]
    while (above := parent_of(path[-1])) is not None and above not in path:
        path.append(above)
    return path


def way_between(a: str, b: str, parent_of: Parent) -> tuple[list[str], list[str]] | None:
    """From a to b: the frames below their common one, of a upwards and of b downwards; None where there is none.

    T_a_b = (T_common_a)^-1 T_common_b, each the product of T_parent_child along its frames.

    >>> way_between("camera", "tool", {"camera": "base", "tool": "wrist", "wrist": "base"}.get)
    (['camera'], ['wrist', 'tool'])
    """
    rise, fall = ancestors(a, parent_of), ancestors(b, parent_of)
    common = next((frame for frame in rise if frame in fall), None)
    if common is None:
        return None
    return rise[: rise.index(common)], fall[: fall.index(common)][::-1]
