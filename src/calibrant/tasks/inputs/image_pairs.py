"""Which image of one camera was taken at once with which of another: by name, by time stamp, else by order."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from calibrant.errors import InputError

RULES = ("auto", "name", "order", "time")
_TOKENS = re.compile(r"\d+|[^\W\d_]+")
_STAMP = re.compile(r"\d{9,}(?:[.]\d+)?|\d+[.]\d+")
"""Seconds since 1970 have ten digits, nanoseconds nineteen; a shorter number is a time where it has a fraction."""
_LISTED = 4
MOST_ALONE = 0.5
"""Names pair images when they do so for half of the shorter list: of names that meet by chance few do."""

Rule = Literal["name", "order", "time"]
Name = Callable[[int], Hashable]


@dataclass(frozen=True)
class ImagePairs:
    """Pairs of positions (left, right), those without a partner on each side, the rule, and what was done in words."""

    rule: Rule
    pairs: tuple[tuple[int, int], ...]
    alone_left: tuple[int, ...]
    alone_right: tuple[int, ...]
    words: str


def paired_images(left: Sequence[Path], right: Sequence[Path], *, rule: str = "auto") -> ImagePairs:
    """Pair the images of two cameras.

    name: equal names in two folders, or names that differ by what all of a side have in common (left01, right01);
    time: the number in the name is a time, and the nearest within half a period belong together; order: as they are
    listed. auto: by name where names meet, by time where they hold one, else by order.
    Raises: InputError for an unknown rule, names that do not meet, lists of unequal length without names that do.
    """
    if rule not in RULES:
        raise InputError(f"--pairs {rule}: choose {', '.join(RULES)}")
    if rule in ("auto", "name"):
        found = _by_name(left, right)
        if found is not None:
            return found
    if rule in ("auto", "time"):
        found = _by_time(left, right)
        if found is not None:
            return found
    if rule in ("name", "time"):
        what = "names meet" if rule == "name" else "names hold time stamps that meet"
        raise InputError(
            f"--pairs {rule}: no {what}: {_first(left)} and {_first(right)}; rename them, or --pairs order"
        )
    return _by_order(left, right)


def _by_name(left: Sequence[Path], right: Sequence[Path]) -> ImagePairs | None:
    """By the first way to read names under which they are unique and half of them meet."""
    stems = [[p.stem for p in side] for side in (left, right)]
    for keys in (stems, _without_side(*stems)):
        if keys is None:
            continue
        a, b = ({key: i for i, key in enumerate(side)} for side in keys)
        shared = [key for key in a if key in b]
        unique = len(a) == len(left) and len(b) == len(right)
        if unique and shared and len(shared) >= MOST_ALONE * min(len(a), len(b)):
            return _found("name", [(a[key], b[key]) for key in shared], left, right)
    return None


def _without_side(left: Sequence[str], right: Sequence[str]) -> list[list[Hashable]] | None:
    """The names without the words and numbers that are the same in all of a side and others in the other; None where
    nothing is: then nothing in them says the side."""
    tokens = [[tuple(_TOKENS.findall(stem)) for stem in side] for side in (left, right)]
    if len({len(t) for side in tokens for t in side}) != 1:
        return None
    columns = range(len(tokens[0][0]))
    words = [[{t[c] for t in side} for c in columns] for side in tokens]
    side = {c for c in columns if len(words[0][c]) == len(words[1][c]) == 1 and words[0][c] != words[1][c]}
    if not side:
        return None
    return [[tuple(_value(t[c]) for c in columns if c not in side) for t in each] for each in tokens]


def _value(token: str) -> int | str:
    return int(token) if token.isdigit() else token


def _by_time(left: Sequence[Path], right: Sequence[Path]) -> ImagePairs | None:
    times = [[_stamp(p.stem) for p in side] for side in (left, right)]
    a, b = ([t for t in side if t is not None] for side in times)
    if len(a) < len(left) or len(b) < len(right) or len(set(a)) < len(a) or len(set(b)) < len(b):
        return None
    steps = [step for side in (a, b) for step in _steps(side)]
    half = 0.5 * min(_median(_steps(side)) for side in (a, b) if len(side) > 1) if steps else float("inf")
    pairs = []
    for i, t in enumerate(a):
        j = min(range(len(b)), key=lambda k: abs(b[k] - t))
        back = min(range(len(a)), key=lambda k: abs(a[k] - b[j]))
        if back == i and abs(b[j] - t) < half:
            pairs.append((i, j))
    return _found("time", pairs, left, right) if pairs else None


def _stamp(stem: str) -> float | None:
    found = _STAMP.findall(stem)
    return float(found[-1]) if found else None


def _steps(times: Sequence[float]) -> list[float]:
    ordered = sorted(times)
    return [b - a for a, b in pairwise(ordered)]


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def _by_order(left: Sequence[Path], right: Sequence[Path]) -> ImagePairs:
    if len(left) != len(right):
        raise InputError(
            f"{len(left)} images of the left camera ({_first(left)}) and {len(right)} of the right one "
            f"({_first(right)}): their names do not say which belong together, so they are paired by order, and that "
            "needs as many of one as of the other; give both of a pair one name or number, or leave out what has no "
            "partner (--exclude)"
        )
    return _found("order", [(i, i) for i in range(len(left))], left, right)


def _found(rule: Rule, pairs: Sequence[tuple[int, int]], left: Sequence[Path], right: Sequence[Path]) -> ImagePairs:
    ordered = tuple(sorted(pairs))
    mine, others = {i for i, _ in ordered}, {j for _, j in ordered}
    alone = tuple(tuple(i for i in range(len(s)) if i not in used) for s, used in ((left, mine), (right, others)))
    how = {
        "name": "by name",
        "time": "by the time stamps in their names",
        "order": "by order, because their names do not tell",
    }[rule]
    text = f"{len(ordered)} pairs {how}"
    for side, files, left_over in (("left", left, alone[0]), ("right", right, alone[1])):
        if left_over:
            names = ", ".join(files[i].name for i in left_over[:_LISTED])
            more = " …" if len(left_over) > _LISTED else ""
            text += f"; {len(left_over)} of the {side} camera without a partner: {names}{more}"
    return ImagePairs(rule, ordered, alone[0], alone[1], text)


def _first(files: Sequence[Path]) -> str:
    return ", ".join(f.name for f in files[:_LISTED]) + (" …" if len(files) > _LISTED else "")
