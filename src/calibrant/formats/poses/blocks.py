"""Poses in blocks of lines under a label, as programs log them: `EE pose:`, four rows, `Cam pose:`, four rows.

A label is the last line without numbers alone above the block. Blocks of one kind are poses; of two kinds, in turn, the
robot's and the target's, told apart by their words.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calibrant.errors import InputError
from calibrant.formats.poses.rows import PoseTable
from calibrant.formats.poses.text import read_text_table

_NUMBERS = re.compile(r"[\s\[\](),;]*+(?:[-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?+[\s\[\](),;]*+)+")
_SEPARATORS = re.compile(r"[\s\[\](),;]+")
_ROBOT = re.compile(r"(?<![a-z])(?:robot|gripper|flange|tool0?|tcp|eef?|effector|end|hand|wrist|arm|base)(?![a-z])")
_TARGET = re.compile(
    r"(?<![a-z])(?:cam|camera|target|board|marker|tag|object|pattern|chessboard|charuco|aruco|sensor|eye)(?![a-z])"
)
_SHAPES = {(4, 4): 16, (3, 4): 12, (1, 6): 6, (1, 7): 7, (1, 12): 12, (1, 16): 16}
_FEWEST = 2
"""Blocks from which a text is taken for a log of poses."""


@dataclass(frozen=True)
class _Block:
    label: str
    line: int
    rows: tuple[tuple[str, ...], ...]

    @property
    def kind(self) -> str:
        """The label without what counts the blocks."""
        return " ".join(re.sub(r"[^a-z]+", " ", self.label.lower()).split())


def read_blocks(text: str, source: str) -> tuple[PoseTable, PoseTable | None] | None:
    """The poses under labels, and the target's where there are two kinds; None for any other text.

    Raises: InputError for two kinds whose words do not say which is the robot's, or of which one is missing.
    """
    blocks = _blocks(text)
    if len(blocks) < _FEWEST or any((len(b.rows), len(b.rows[0])) not in _SHAPES for b in blocks):
        return None
    if any(len({len(row) for row in b.rows}) > 1 or len(b.rows) != len(blocks[0].rows) for b in blocks):
        return None
    kinds = list(dict.fromkeys(b.kind for b in blocks))
    if len(kinds) == 1:
        return _table(blocks, source), None
    if len(kinds) > 2:
        return None
    first, second = ([b for b in blocks if b.kind == kind] for kind in kinds)
    roles = [_role(kind) for kind in kinds]
    if roles == ["target", "robot"]:
        first, second = second, first
    elif roles != ["robot", "target"]:
        raise InputError(
            f"{source}: blocks of two kinds, {first[0].label!r} and {second[0].label!r}; which are the robot's poses "
            "and which the target's? Label them robot and target"
        )
    if len(first) != len(second) or [b.kind for b in blocks] != kinds * len(first):
        raise InputError(
            f"{source}: {len(first)} blocks {first[0].label!r} and {len(second)} {second[0].label!r} that do not stand "
            "in turn; expected one of each a moment"
        )
    return _table(first, source), _table(second, source)


def _blocks(text: str) -> list[_Block]:
    out: list[_Block] = []
    label, at = "", 0
    rows: list[tuple[str, ...]] = []
    for number, line in enumerate([*text.splitlines(), "end"], start=1):
        if line.strip() and _NUMBERS.fullmatch(line):
            at = at if rows else number
            rows.append(tuple(cell for cell in _SEPARATORS.split(line) if cell))
            continue
        if rows:
            if not label:
                return []
            out.append(_Block(label, at, tuple(rows)))
            rows, label = [], ""
        if line.strip(" \t[](),;"):
            label = line.strip()[:80]
    return out


def _role(kind: str) -> str | None:
    robot, target = bool(_ROBOT.search(kind)), bool(_TARGET.search(kind))
    return None if robot == target else "robot" if robot else "target"


def _table(blocks: Sequence[_Block], source: str) -> PoseTable:
    table = read_text_table("\n".join(" ".join(cell for row in b.rows for cell in row) for b in blocks), source)
    return replace(table, places=tuple(f"{source}:{b.line}" for b in blocks))
