"""When each picture of several cameras was taken, from a table: a row a picture, its camera, its name or number, time.

Cameras are called by their names; or by numbers, which are those in the names or else the order in which the cameras
are given. Pictures are called by file names; or by numbers: those of a video's frames, or in the files' names. Where a
table counts from elsewhere, as one of a longer recording, row k of as many rows as there are pictures is picture k's.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import isfinite
from pathlib import Path, PurePath
from statistics import median
from typing import TypeVar

from calibrant.errors import InputError
from calibrant.reading.files import read_text
from calibrant.reading.notes import note_unused

K = TypeVar("K", Path, int)
_COLUMNS = {
    "camera": ("camera", "cam", "cam_id", "camera_id"),
    "picture": ("image", "file", "frame", "frame_index", "sync_index", "moment"),
    "time": ("time", "frame_time", "timestamp", "t"),
}
"""What the columns are called; of several, the first counts."""
_EXPECTED = "a CSV file with the columns camera, image (or frame) and time, in seconds"
_LATEST_S = 1e11
"""Seconds since 1970 until the year 5138: a larger number is of milliseconds or less."""
_LISTED = 4
EVERY = "add their rows: pictures are matched by their times"


@dataclass(frozen=True)
class PictureTimes:
    """seconds: of every picture that the table tells, by camera and file, from the earliest on; words: how rows were
    matched."""

    seconds: Mapping[str, Mapping[Path, float]]
    words: str

    def by_moment(self, moments: Mapping[str, Mapping[Path, str]]) -> dict[str, dict[str, float]]:
        """Seconds by camera and moment. moments: by camera, that of every picture that counts.

        Raises: InputError for pictures without a time, and cameras whose clocks began elsewhere: then pictures of one
        moment are further apart than moments are.
        """
        self.require(moments, "add their rows, or leave the pictures out (--exclude)")
        times = {c: {m: self.seconds[c][f] for f, m in files.items()} for c, files in moments.items()}
        _refuse_other_clocks(times)
        return times

    def require(self, files: Mapping[str, Iterable[Path]], cure: str) -> None:
        """Raises: InputError, which ends with the cure, for pictures of a camera without a time."""
        lacking = {c: [f.name for f in mine if f not in self.seconds[c]] for c, mine in files.items()}
        texts = [f"{_listed(names)} of camera {camera}" for camera, names in lacking.items() if names]
        if texts:
            raise InputError(f"--times tells no time of {' and '.join(texts)} ({self.words}); {cure}")


@dataclass(frozen=True)
class _Row:
    camera: str
    picture: str
    t: float
    line: int

    @property
    def number(self) -> int | None:
        """Of the picture; None where the row has a name."""
        return _whole(self.picture)


def read_picture_times(path: Path, lists: Mapping[str, Sequence[Path]]) -> PictureTimes:
    """The times of pictures. lists: every camera's pictures by its name.

    Raises: InputError naming the file and line for a table that is none, times that are no seconds, one picture with
    two times; for cameras that it does not tell, or tells by numbers that may be several's.
    """
    rows = _rows(path)
    names, how = _cameras(path, rows, list(lists))
    first = min(row.t for row in rows)
    note_unused(str(path), (f"rows of camera {row.camera}" for row in rows if row.camera not in names))
    seconds: dict[str, dict[Path, float]] = {}
    ranked: dict[str, list[str]] = {}
    by_number = all(row.number is not None for row in rows)
    for camera, files in lists.items():
        mine = [row for row in rows if names.get(row.camera) == camera]
        if by_number:
            told, shift = _by_number(path, mine, files)
            if shift:
                ranked.setdefault(shift, []).append(camera)
        else:
            told = _by_name(path, mine, files)
        seconds[camera] = {file: t - first for file, t in told.items()}
    words = f"times of {PurePath(path).name}: {how}, pictures by {'number' if by_number else 'name'}"
    words += f", by rank where they begin elsewhere: {'; '.join(_of_whom(ranked))}" if ranked else ""
    return PictureTimes(seconds, words)


def _rows(path: Path) -> list[_Row]:
    text = read_text(path, what="table of times", expected=_EXPECTED)
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    try:
        given = [name.strip() for name in reader.fieldnames or ()]
        fields = [name.lower() for name in given]
        reader.fieldnames = fields
        table = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num + 1}: {error}; expected {_EXPECTED}") from None
    used = {what: next((name for name in names if name in fields), "") for what, names in _COLUMNS.items()}
    for what, name in used.items():
        if not name:
            raise InputError(
                f"{path}: no column says the {what} ({', '.join(_COLUMNS[what])}); its header is {','.join(given)}"
            )
        if fields.count(name) > 1:
            raise InputError(f"{path}: the column {name!r} stands there twice; keep one")
    note_unused(str(path), (g for g, name in zip(given, fields) if name and name not in used.values()))
    rows = [_row(path, line, {what: (row[name] or "").strip() for what, name in used.items()}) for line, row in table]
    if not rows:
        raise InputError(f"{path}: the header stands alone; expected a row for each picture")
    return rows


def _row(path: Path, line: int, cells: Mapping[str, str]) -> _Row:
    """Raises: InputError for an empty cell, a time that is no number, or none of seconds."""
    for what in ("camera", "picture"):
        if not cells[what]:
            raise InputError(f"{path}:{line}: the row has no {what}")
    try:
        t = float(cells["time"])
    except ValueError:
        t = float("nan")
    if not isfinite(t):
        raise InputError(f"{path}:{line}: the time is {cells['time']!r}; expected seconds, a finite number")
    if abs(t) > _LATEST_S:
        raise InputError(f"{path}:{line}: the time {cells['time']} is no seconds since 1970; give seconds")
    return _Row(cells["camera"], cells["picture"], t, line)


def _whole(text: str) -> int | None:
    """A whole number, as "7" or "7.0" write it; None for another text."""
    found = re.fullmatch(r"(\d+)(?:[.]0*)?", text)
    return int(found[1]) if found else None


def _cameras(path: Path, rows: Sequence[_Row], names: Sequence[str]) -> tuple[dict[str, str], str]:
    """Names of the cameras as the table calls them, and how that is told. Raises: InputError for those it does not."""
    values = list(dict.fromkeys(row.camera for row in rows))
    numbers = {v: n for v in values if (n := _whole(v)) is not None}
    if len(numbers) < len(values) or set(values) & set(names):
        found, how = {name: name for name in names if name in values}, "cameras by name"
    elif own := _numbers_in(names):
        found, how = {v: own[n] for v, n in numbers.items() if n in own}, "cameras by the number in their names"
    else:
        ordered = sorted(numbers, key=lambda v: numbers[v])
        if len(ordered) != len(names):
            raise InputError(
                f"{path}: rows of {len(ordered)} cameras, {_listed(ordered)}, for {len(names)} that have no number in "
                f"their names, {', '.join(names)}: write the names into the column of cameras"
            )
        found = dict(zip(ordered, names))
        how = f"cameras in the order given ({', '.join(f'{v} is {name}' for v, name in found.items())})"
    missing = [name for name in names if name not in found.values()]
    if missing:
        raise InputError(
            f"{path}: no rows of camera {_listed(missing)} ({how}); it has rows of {_listed(values)}. Call the cameras "
            "there as --images does"
        )
    return found, how


def _numbers_in(names: Sequence[str]) -> dict[int, str]:
    """Names by the last number in each; none where some have none, or two the same."""
    found = {int(digits[-1]): name for name in names if (digits := re.findall(r"\d+", name))}
    return found if len(found) == len(names) else {}


def _of_whom(ranked: Mapping[str, Sequence[str]]) -> list[str]:
    """What holds, and of which cameras."""
    return [f"{shift} of {', '.join(cameras)}" for shift, cameras in ranked.items()]


def _by_name(path: Path, rows: Sequence[_Row], files: Sequence[Path]) -> dict[Path, float]:
    """Seconds of the files that the rows name, by as much of the path as they have, with or without the ending."""
    named: dict[str, list[Path]] = {}
    for file in files:
        named.setdefault(file.name, []).append(file)
        if file.stem != file.name:
            named.setdefault(file.stem, []).append(file)
    out: dict[Path, float] = {}
    for row in rows:
        folders = PurePath(row.picture.replace("\\", "/")).parts
        meant = [f for f in named.get(folders[-1], ()) if f.parts[-len(folders) : -1] == folders[:-1]]
        if len(meant) > 1:
            raise InputError(f"{path}:{row.line}: {row.picture} may be {_listed([str(f) for f in meant])}; add folders")
        for file in meant:
            _add(path, out, file, row)
    return out


def _by_number(path: Path, rows: Sequence[_Row], files: Sequence[Path]) -> tuple[dict[Path, float], str]:
    """Seconds of the files whose numbers the rows have; else, of as many rows as pictures, by rank, and which is
    which."""
    told: dict[int, float] = {}
    for row in rows:
        if row.number is not None:
            _add(path, told, row.number, row)
    numbers, every = _numbers_of(files)
    if not set(every) <= set(told) and len(told) == len(every):
        ranks = dict(zip(sorted(every), sorted(told)))
        shift = f"{ranks[min(every)]} is picture {min(every)}"
        return {file: told[ranks[n]] for file, n in numbers.items()}, shift
    return {file: told[n] for file, n in numbers.items() if n in told}, ""


def _numbers_of(files: Sequence[Path]) -> tuple[dict[Path, int], list[int]]:
    """The number of each file, and of every picture there is: of a video also of the frames that are not taken."""
    from calibrant.detection.images.files import frame_of
    from calibrant.detection.images.recordings import source_of

    videos = list(dict.fromkeys(place[0] if (place := frame_of(file)) else None for file in files))
    if len(videos) > 1:
        given = _listed(["photos" if video is None else str(video) for video in videos])
        raise InputError(f"--times tells pictures by number, and one camera has {given}: give one video a camera")
    found = {file: re.findall(r"\d+", file.stem) for file in files}
    for file, digits in found.items():
        if not digits:
            raise InputError(f"--times tells pictures by number, and {file.name} has none; write file names there")
    numbers = {file: int(digits[-1]) for file, digits in found.items()}
    if len(set(numbers.values())) < len(numbers):
        raise InputError("--times tells pictures by number, and two of a camera have the same; write file names there")
    return numbers, sorted(numbers.values()) if videos[0] is None else list(
        range(source_of(videos[0]).frame_count(videos[0]))
    )


def _add(path: Path, out: dict[K, float], key: K, row: _Row) -> None:
    """Raises: InputError for another time of the same picture."""
    if out.setdefault(key, row.t) != row.t:
        raise InputError(
            f"{path}:{row.line}: picture {row.picture} of camera {row.camera} has a time already, {out[key]:g} s, and "
            f"here {row.t:g} s; keep one"
        )


def _refuse_other_clocks(times: Mapping[str, Mapping[str, float]]) -> None:
    """Raises: InputError where pictures of a moment are further apart than a camera's own are, by the median: pictures
    of the moments before or after are then nearer in time."""
    steps = [[b - a for a, b in pairwise(sorted(mine.values()))] for mine in times.values()]
    period = min((median(each) for each in steps if each), default=float("inf"))
    for (a, mine), (b, others) in combinations(times.items(), 2):
        off = median([others[m] - mine[m] for m in mine if m in others] or [0.0])
        if abs(off) > period:
            raise InputError(
                f"--times: at one moment pictures of {b} are {abs(off):.4g} s {'after' if off > 0 else 'before'} those "
                f"of {a}, and its own are {period:.3g} s apart: either the clocks began at other times, or other "
                "pictures belong together; give times of one clock, or another rule of --pairs"
            )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
