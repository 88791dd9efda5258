"""Which images of several cameras were taken at once: by name or number, by time stamp, else by order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from calibrant.errors import InputError

RULES = ("auto", "name", "order", "time")
_TOKENS = re.compile(r"\d+|[^\W\d_]+")
_STAMP = re.compile(r"\d{9,}(?:[.]\d+)?|\d+[.]\d+")
"""Seconds since 1970 have ten digits, nanoseconds nineteen; a shorter number is a time where it has a fraction."""
_UNITS_S = {13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Units of whole numbers since 1970, by their digits."""
_LISTED = 4
MOST_ALONE = 0.5
"""Names match images when they do so for half of a camera's, or of the longest other list where that is shorter: of
names that meet by chance few do."""

HOW = {
    "name": "by name",
    "time": "by the time stamps in their names",
    "order": "by order, because their names do not tell",
}
TIMES_GIVEN = "by the times given"
"""How images are matched, in words."""

Rule = Literal["name", "order", "time"]
Lists = Mapping[str, Sequence[Path]]
Times = Mapping[str, Mapping[Path, float]]
Keys = Sequence[Sequence[Hashable]]


@dataclass(frozen=True)
class ImageMoments:
    """rows: by moment, the position of its image in each list, None where a camera has none; rule: how they were found;
    alone (by list): positions of images without another at their moment; words: what was done."""

    rule: Rule
    rows: tuple[tuple[int | None, ...], ...]
    alone: tuple[tuple[int, ...], ...]
    words: str

    @property
    def shared(self) -> tuple[tuple[int | None, ...], ...]:
        """The moments that two cameras or more have an image of."""
        return tuple(row for row in self.rows if sum(i is not None for i in row) > 1)


def matched_images(lists: Lists, *, rule: str = "auto", times: Times | None = None) -> ImageMoments:
    """Match the images of two cameras or more.

    name: equal names in several folders (or frame numbers of videos), or names that differ by what all of a camera's
    have in common (left01, right01); time: the number in the name is a time, and the nearest within half a period
    belong together; order: as they are listed. auto: by name where names meet, by time where they hold one, else by
    order.
    Args: lists, the images of each camera by its name; times, seconds of every image by camera, for the rule time in
    place of those in the names.
    Raises: InputError for an unknown rule, names that do not meet, lists of unequal length without names that do.
    """
    if rule not in RULES:
        raise InputError(f"--pairs {rule}: choose {', '.join(RULES)}")
    if rule in ("auto", "name"):
        found = _by_name(lists)
        if found is not None:
            return found
    if rule in ("auto", "time"):
        found = _by_time(lists, times)
        if found is not None:
            return found
    if rule == "time" and times is not None:
        raise InputError(
            "--times: the times of no two images of different cameras meet, or two of one camera have the same: give "
            "times of one clock, a row an image"
        )
    if rule in ("name", "time"):
        what = "names meet" if rule == "name" else "names hold time stamps that meet"
        each = " and ".join(_first(files) for files in lists.values())
        raise InputError(f"--pairs {rule}: no {what}: {each}; rename them, or --pairs order")
    return _by_order(lists)


def moment_names(lists: Lists, found: ImageMoments) -> tuple[str, ...]:
    """A name for every row: that of its first image, with a number before it where two would have one."""
    stems = [next(files[i].stem for files, i in zip(lists.values(), row) if i is not None) for row in found.rows]
    return tuple(s if stems.count(s) == 1 else f"{k} {s}" for k, s in enumerate(stems))


def images_by_moment(lists: Lists, found: ImageMoments, keep: Mapping[str, bool]) -> dict[str, dict[Path, str]]:
    """By camera, the moment of each of its images. keep: by file name; a moment of which an image goes goes whole."""
    out: dict[str, dict[Path, str]] = {camera: {} for camera in lists}
    for moment, row in zip(moment_names(lists, found), found.rows):
        seen = {camera: files[i] for (camera, files), i in zip(lists.items(), row) if i is not None}
        if all(keep[file.name] for file in seen.values()):
            for camera, file in seen.items():
                out[camera][file] = moment
    return out


def stamp_s(stem: str) -> float | None:
    """Seconds of the time stamp in an image's name; None where it holds none."""
    found = _STAMP.findall(stem)
    return float(found[-1]) * _UNITS_S.get(len(found[-1]), 1.0) if found else None


def _by_name(lists: Lists) -> ImageMoments | None:
    """By the first way to read names under which they are unique and half of them meet."""
    stems = [[p.stem for p in files] for files in lists.values()]
    for keys in (stems, _without_camera(stems)):
        if keys is not None and _meet(keys):
            return _found("name", _rows(keys), lists)
    return None


def _meet(keys: Keys) -> bool:
    """Whether the keys are unique in each list, and enough of each stand in another; of more than two lists some may
    have no image together with the others."""
    if any(len(set(side)) < len(side) for side in keys):
        return False
    meeting = 0
    for k, side in enumerate(keys):
        others = [set(other) for i, other in enumerate(keys) if i != k]
        shared = sum(any(key in other for other in others) for key in side)
        if 0 < shared < MOST_ALONE * min(len(side), max(map(len, others))):
            return False
        meeting += shared > 0
    return meeting >= 2


def _rows(keys: Keys) -> list[tuple[int | None, ...]]:
    """A row for every key, in the order of the lists."""
    at = [{key: i for i, key in enumerate(side)} for side in keys]
    return [tuple(where.get(key) for where in at) for key in dict.fromkeys(k for side in keys for k in side)]


def _without_camera(stems: Sequence[Sequence[str]]) -> list[list[Hashable]] | None:
    """The names without the words and numbers that are the same in all of a list and other ones in another; None where
    nothing is: then nothing in them says the camera."""
    tokens = [[tuple(_TOKENS.findall(stem)) for stem in side] for side in stems]
    if len({len(t) for side in tokens for t in side}) != 1:
        return None
    columns = range(len(tokens[0][0]))
    words = [[{t[c] for t in side} for c in columns] for side in tokens]
    camera = {
        c for c in columns if all(len(w[c]) == 1 for w in words) and len({next(iter(w[c])) for w in words}) > 1
    }  # fmt: skip
    if not camera:
        return None
    return [[tuple(_value(t[c]) for c in columns if c not in camera) for t in each] for each in tokens]


def _value(token: str) -> int | str:
    return int(token) if token.isdigit() else token


def _by_time(lists: Lists, given: Times | None) -> ImageMoments | None:
    """The nearest within half a period belong together: each list to the first, and what is left of it to the next."""
    times: list[list[float]] = []
    for camera, files in lists.items():
        found = [stamp_s(p.stem) if given is None else given[camera][p] for p in files]
        told = [t for t in found if t is not None]
        if len(told) < len(files) or len(set(told)) < len(told):
            return None
        times.append(told)
    steps = [_median(_steps(side)) for side in times if len(side) > 1]
    half = 0.5 * min(steps, default=float("inf"))
    rows: list[dict[int, int]] = [{0: i} for i in range(len(times[0]))]
    for k, side in enumerate(times[1:], 1):
        _place(rows, times, k, side, half)
    full = [tuple(row.get(k) for k in range(len(times))) for row in rows]
    full.sort(key=lambda row: min(times[k][i] for k, i in enumerate(row) if i is not None))
    told_together = any(sum(i is not None for i in row) > 1 for row in full)
    return _found("time", full, lists, TIMES_GIVEN if given is not None else "") if told_together else None


def _place(
    rows: list[dict[int, int]], times: Sequence[Sequence[float]], k: int, side: Sequence[float], half: float
) -> None:
    """The images of list k in the rows that are nearest to them and they to these, the others in rows of their own."""
    at = [next(times[c][i] for c, i in row.items()) for row in rows]
    nearest = [min(range(len(at)), key=lambda r: abs(at[r] - t)) for t in side]
    for j, (t, r) in enumerate(zip(side, nearest)):
        back = min(range(len(side)), key=lambda i: abs(side[i] - at[r]))
        if back == j and abs(at[r] - t) < half:
            rows[r][k] = j
        else:
            rows.append({k: j})


def _steps(times: Sequence[float]) -> list[float]:
    ordered = sorted(times)
    return [b - a for a, b in pairwise(ordered)]


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def _by_order(lists: Lists) -> ImageMoments:
    counts = [len(files) for files in lists.values()]
    if len(set(counts)) > 1:
        each = " and ".join(f"{len(files)} of {_camera(name)} ({_first(files)})" for name, files in lists.items())
        raise InputError(
            f"{each}: their names do not say which images belong together, so they are matched by order, and that "
            "needs as many of one camera as of the other; give those of a moment one name or number, or leave out "
            "what has no partner (--exclude)"
        )
    return _found("order", [(i,) * len(counts) for i in range(counts[0])], lists)


def _found(rule: Rule, rows: Sequence[tuple[int | None, ...]], lists: Lists, how: str = "") -> ImageMoments:
    """The moments in the order of the first list's images, those that only others have after them, as they come."""
    ordered = list(rows)
    if rule == "name":
        ordered.sort(key=lambda row: next((k, i) for k, i in enumerate(row) if i is not None))
    counts = [sum(i is not None for i in row) for row in ordered]
    alone = tuple(
        tuple(i for row, n in zip(ordered, counts) if n == 1 and (i := row[k]) is not None) for k in range(len(lists))
    )
    return ImageMoments(rule, tuple(ordered), alone, _words(how or HOW[rule], counts, alone, lists))


def _words(how: str, counts: Sequence[int], alone: Sequence[Sequence[int]], lists: Lists) -> str:
    shared = Counter(n for n in counts if n > 1)
    if len(lists) == 2:
        text = f"{_counted(sum(shared.values()), 'pair')} {how}"
    else:
        parts = [f"{m} of {'all' if n == len(lists) else n}" for n, m in sorted(shared.items(), reverse=True)]
        moments = _counted(sum(shared.values()), "moment")
        text = f"{moments} of {len(lists)} cameras {how}, {', '.join(parts) or 'none shared'}"
    for (name, files), left_over in zip(lists.items(), alone):
        if left_over:
            names = ", ".join(files[i].name for i in left_over[:_LISTED])
            more = " …" if len(left_over) > _LISTED else ""
            text += f"; {len(left_over)} of {_camera(name)} without a partner: {names}{more}"
    return text


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _camera(name: str) -> str:
    return f"the {name} camera" if name in ("left", "right") else f"camera {name}"


def _first(files: Sequence[Path]) -> str:
    return ", ".join(f.name for f in files[:_LISTED]) + (" …" if len(files) > _LISTED else "")
