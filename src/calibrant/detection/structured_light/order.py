"""Are the pictures of a capture those of the sequence, in its order? Each question to the pictures themselves.

    white, black    the brightest and the darkest of all
    pairs           a bit and its inverse light every point once: I + I' = white + black
    bits            neighbours have neighbouring numbers (see `bit_order`)
    cosines         shifted cosines leave no more than noise

What is out of place is named by its file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.detection.structured_light.bit_order import check_bits
from calibrant.detection.structured_light.capture import Capture, Grey, Picture
from calibrant.detection.structured_light.light import cosine_sums
from calibrant.detection.structured_light.tone import ENOUGH_DIM, adds_up, curved_words, dim, saturated_words
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.patterns.sequence import PatternSequence, sizes_of_count

LIT = 0.25
"""Of the brightest pixels' light: what is lit at all."""
NO_PAIR = 0.25
"""Of the light: a bit and another bit's inverse miss the sum at half of the points by all of it."""
NO_COSINE = 0.5
"""Of the amplitude: what cosines in order leave is noise; a shift that is out of place leaves most of it."""
SAME = 0.15
"""Of the light: two pictures of one pattern differ by noise; of different ones at half of the points by all of it."""
STRUCTURED = 0.5
"""Of the light: what a picture with dark and lit parts varies by at least."""
NEARLY = 0.03
"""Of the range of brightness: lamps flicker by a per cent or two."""
LEAST_LIGHT = 8.0
"""Grey levels: less is noise."""
SAMPLES = 20_000


def check_count(name: str, files: Sequence[str], sequence: PatternSequence, pictures: Grey | None) -> None:
    """Raises: InputError for more or fewer pictures than the sequence has, naming what misses or does not fit."""
    n, wanted = len(files), len(sequence.patterns)
    if n == wanted:
        return
    width, height = sequence.projector_size
    fits = sizes_of_count(n) if sequence.code == "gray" else ""
    found = f"{name}: {n} pictures, and {sequence.code} patterns for {width}x{height} px are {wanted}"
    where = _gap(files) or _doubled(files, pictures) or _first_broken(files, pictures, sequence)
    if where:
        raise InputError(f"{found}: {where}")
    cure = "check --projector-size" + (f" ({fits})" if fits else "") + ", and that each pattern was taken once"
    raise InputError(f"{found}: {cure}")


def check_order(capture: Capture) -> Capture:
    """The capture, white and black put last where they came first. Raises: InputError naming what is out of place."""
    _check_light(capture)
    capture = _white_and_black(capture)
    lit = _light(capture.pictures)[2]
    same = _doubled([capture.called(k) for k in range(len(capture.names))], capture.pictures)
    if same:
        raise InputError(f"{capture.name}: {same}")
    _check_cosines(capture, lit)
    if capture.sequence.code != "phase":
        _check_pairs(capture, lit)
        for axis in "xy":
            check_bits(capture, axis, lit)
    return capture


def _check_light(capture: Capture) -> None:
    """Raises: InputError where nothing is lit: neighbours together are hardly brighter in any picture than in another.
    Single pixels are so by noise."""
    small = np.array([cv2.resize(p, None, fx=1 / 8, fy=1 / 8, interpolation=cv2.INTER_AREA) for p in capture.pictures])
    most = int(np.ptp(small, axis=0).max())
    if most <= LEAST_LIGHT:
        raise InputError(
            f"{capture.name}: between all {len(small)} pictures nothing changes by more than {most} of 255 grey levels"
            ": the projector's light does not reach what the camera sees, or the exposure is too short"
        )


def _gap(files: Sequence[str]) -> str:
    """The number that file names leave out."""
    import re
    from pathlib import PurePath

    numbers = []
    for file in files:
        found = re.findall(r"\d+", PurePath(file).stem)
        if not found:
            return ""
        numbers.append(found)
    if len({len(f) for f in numbers}) != 1:
        return ""
    for column in range(len(numbers[0])):
        values = sorted(int(f[column]) for f in numbers)
        missing = sorted(set(range(values[0], values[-1] + 1)) - set(values))
        if len(set(values)) == len(values) and 0 < len(missing) <= 3:
            listed = ", ".join(str(m) for m in missing)
            return f"their numbers run from {values[0]} to {values[-1]} without {listed}: was it lost?"
    return ""


def _doubled(files: Sequence[str], pictures: Grey | None) -> str:
    """Two pictures that are one pattern's. Those of one brightness say nothing: all coarse bits may be so, and stripes
    too fine for the camera."""
    if pictures is None or len(pictures) < 4:
        return ""
    light, black, lit = _light(pictures)
    rows = np.flatnonzero(lit.ravel())
    if not len(rows):
        return ""
    rows = rows[:: max(len(rows) // SAMPLES, 1)]
    part = (pictures.reshape(len(pictures), -1)[:, rows] - black.ravel()[rows]) / light.ravel()[rows]
    structured = np.quantile(part, 0.9, axis=1) - np.quantile(part, 0.1, axis=1) > STRUCTURED
    for k in np.flatnonzero(structured).tolist():
        for j in np.flatnonzero(structured).tolist():
            if j > k and float(np.quantile(np.abs(part[k] - part[j]), 0.95)) < SAME:
                return (
                    f"{files[k]} and {files[j]} show the same pattern: one was taken twice, or two files were mixed up"
                )
    return ""


def _first_broken(files: Sequence[str], pictures: Grey | None, sequence: PatternSequence) -> str:
    """The first bit whose next picture is not its inverse."""
    if pictures is None or sequence.code == "phase" or len(pictures) < 4:
        return ""
    light, black, lit = _light(pictures)
    bits = 2 * (sequence.bits("x") + sequence.bits("y"))
    for k in range(0, min(bits, len(files) - 1), 2):
        if lit.any() and _miss(pictures[k], pictures[k + 1], light + black, black, lit) > NO_PAIR:
            return f"{files[k + 1]} is not the inverse of {files[k]}: one is missing or doubled there"
    return ""


def _levels(pictures: Grey) -> Picture:
    return np.array([float(p[::3, ::3].mean()) for p in pictures])


def _light(pictures: Grey) -> tuple[Picture, Picture, Mask]:
    """The projector's light (h, w), what is there without it, and where it falls, by all pictures."""
    level = _levels(pictures)
    black = pictures[int(np.argmin(level))].astype(np.float32)
    light = pictures[int(np.argmax(level))] - black
    return light, black, np.asarray(light > max(LIT * float(np.quantile(light, 0.99)), LEAST_LIGHT))


def _white_and_black(capture: Capture) -> Capture:
    """White and black where they belong. Raises: InputError where they are elsewhere than first or last."""
    level = _levels(capture.pictures)
    n, near = len(level), NEARLY * float(np.ptp(level))
    brightest, darkest = level > level.max() - near, level < level.min() + near
    # A coarse bit may light all that the camera sees, or nothing: any of the brightest may be white.
    for white, black in ((n - 2, n - 1), (n - 1, n - 2), (0, 1), (1, 0)):
        if brightest[white] and darkest[black]:
            rest = [k for k in range(n) if k not in (white, black)]
            return capture.reordered(np.array([*rest, white, black], dtype=np.int64))
    raise InputError(
        f"{capture.name}: the brightest picture is {capture.called(int(np.argmax(level)))} and the darkest "
        f"{capture.called(int(np.argmin(level)))}; white and black are expected last, or first: the pictures are out "
        "of order, or one of the two is missing"
    )


def _miss(one: Picture, other: Picture, white: Picture, black: Picture, lit: Mask) -> float:
    """How far a pair's sum is from white + black, of the light, where it is farthest but for a quarter."""
    return float(np.quantile(np.abs(adds_up(one, other, white, black, lit)), 0.75))


def _check_pairs(capture: Capture, lit: Mask) -> None:
    white, black = capture.white.astype(np.float32), capture.black.astype(np.float32)
    bits = 2 * (capture.sequence.bits("x") + capture.sequence.bits("y"))
    small = np.s_[::2, ::2]
    for k in range(0, bits, 2):
        off = adds_up(capture.pictures[k], capture.pictures[k + 1], white, black, lit)
        if float(np.quantile(np.abs(off), 0.75)) <= NO_PAIR:
            continue
        _refuse_bent_light(capture, off, white, black, lit, bits)
        misses = [
            _miss(capture.pictures[k][small], capture.pictures[j][small], white[small], black[small], lit[small])
            if j != k
            else np.inf
            for j in range(bits)
        ]
        best = int(np.argmin(misses))
        hint = f"; its inverse is {capture.called(best)}" if misses[best] <= NO_PAIR else "; no picture is"
        raise InputError(
            f"{capture.name}: {capture.called(k + 1)} is not the inverse of {capture.called(k)}{hint}. The pictures "
            "are out of order, one is missing or doubled, or something moved while they were taken"
        )


def _refuse_bent_light(capture: Capture, off: Array, white: Picture, black: Picture, lit: Mask, bits: int) -> None:
    """Raises: InputError where pictures that are in order do not add up: saturated ones, or bent by a tone curve."""
    said = saturated_words(white, lit, np.abs(off) > NO_PAIR)
    faint = dim(white, black)
    if said and faint.sum() >= ENOUGH_DIM:
        # What is not saturated tells whether the order is right.
        pairs = ((capture.pictures[k], capture.pictures[k + 1]) for k in range(0, bits, 2))
        said = said if all(_miss(a, b, white, black, faint) <= NO_PAIR for a, b in pairs) else ""
    said = said or curved_words(off)
    if said:
        raise InputError(f"{capture.name}: {said}")


def _check_cosines(capture: Capture, lit: Mask) -> None:
    for axis in "xy":
        for period in capture.sequence.periods(axis):
            shots = capture.shifted(axis, period).astype(np.float32)
            n = len(shots)
            if n < 4:
                continue
            mean, c, s = cosine_sums(shots)
            turn = 2 * np.pi * np.arange(n) / n
            left = np.zeros_like(mean)
            for k in range(n):
                left += (shots[k] - mean - 2 / n * (c * np.cos(turn[k]) + s * np.sin(turn[k]))) ** 2
            part = np.sqrt(left / (n - 3))[lit] / np.maximum(2 / n * np.hypot(c, s)[lit], 1.0)
            if float(np.median(part)) > NO_COSINE:
                said = saturated_words(capture.white, lit, part > NO_COSINE)
                if said:
                    raise InputError(f"{capture.name}: {said}")
                first = capture.place("shift", axis, 0, period)
                raise InputError(
                    f"{capture.name}: {capture.called(first)} to {capture.called(first + n - 1)} are no shifted cosine "
                    f"of period {period:g} px: they are out of order, one is doubled, or the sequence was made with "
                    "another --period or --shifts"
                )
