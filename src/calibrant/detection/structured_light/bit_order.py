"""Are the bits of Gray code in their order, each before its inverse? Neighbours tell.

On a surface neighbours have neighbouring numbers, and a finer bit has more edges than a coarser one. A bit that came
after its inverse is turned over, two bits that changed places are read for each other: either tears numbers apart, and
the change that mends most of the tears is the one that happened.
"""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Mask
from calibrant.detection.structured_light.capture import Capture
from calibrant.errors import InputError

Bits = NDArray[np.bool_]
"""Bits (n, r, c) of rows of pixels, coarsest first; columns are neighbours."""
Changes = dict[tuple[int, ...], list[tuple[Bits, Mask]]]
"""What may have happened, by the bits it concerns: the bits without it."""

CLEAR = 0.6
"""Of the light: where a bit differs by less, most of the light comes by way of other things."""
EVERY = 4
"""Rows, and columns, that are looked at."""
FEWER_EDGES = 0.7
"""Of the coarser bit's edges: a finer bit has more, and noise does not take a third of them."""
LEAST = 20
"""Neighbours that are torn apart, or edges; fewer are the rim of something."""
MENDED = 0.1
"""Of the tears: a bit that was turned over tears along all edges of the next coarser one."""
TORN_PIXELS = (1, 3)
"""Numbers of neighbours that differ by more are torn: by one, or, where pixels are small, by three."""


def check_bits(capture: Capture, axis: str, lit: Mask) -> None:
    """Raises: InputError naming pictures that changed places. Args: lit (h, w), where the projector's light falls."""
    parts = [p for p in _parts(capture, axis, lit) if p[1].any()]
    n = capture.sequence.bits(axis)
    torn = {limit: _tears(parts, limit) for limit in TORN_PIXELS}
    turned: Changes = {(k,): [(_turned(b, k), m) for b, m in parts] for k in range(1, n)}
    # Two bits that changed places have the finer one's many edges where few are expected.
    edges = [sum(int((b[k][:, 1:] != b[k][:, :-1])[_both(m)].sum()) for b, m in parts) for k in range(n)]
    fewer = any(fine < FEWER_EDGES * coarse for coarse, fine in pairwise(edges) if coarse > LEAST)
    if not fewer and _best(turned, torn) is None:
        return
    swapped: Changes = {(i, j): [(_swapped(b, i, j), m) for b, m in parts] for i, j in combinations(range(n), 2)}
    happened = _best(turned | swapped, torn)
    if happened is not None:
        raise InputError(f"{capture.name}: {_words(capture, axis, happened)}")


def _words(capture: Capture, axis: str, change: tuple[int, ...]) -> str:
    places = [capture.place("bit", axis, k) for k in change]
    names = [f"{capture.called(k)}, {capture.called(k + 1)}" for k in places]
    if len(names) == 1:
        return f"{names[0].replace(',', ' and')} have changed places: the inverse came first"
    return f"{names[0]} and {names[1]} have changed places: these are bits {change[1] + 1} and {change[0] + 1}"


def _best(changes: Changes, torn: dict[int, int]) -> tuple[int, ...] | None:
    """The change that mends the most tears, if it mends many."""
    best, most = None, 0.0
    for limit in TORN_PIXELS:
        for change, parts in changes.items():
            mended = torn[limit] - _tears(parts, limit)
            if mended > max(LEAST, MENDED * torn[limit]) and mended > most:
                best, most = change, mended
    return best


def _parts(capture: Capture, axis: str, lit: Mask) -> list[tuple[Bits, Mask]]:
    """Bits of every few rows, and of every few columns, with where they are clear."""
    light = capture.white.astype(np.float32) - capture.black
    out = []
    for turn in (False, True):
        window = np.s_[:, ::EVERY] if turn else np.s_[::EVERY]
        bits, sizes = [], []
        for bit, inverse in capture.pairs(axis):
            d = bit[window].astype(np.int16) - inverse[window]
            bits.append(d > 0)
            sizes.append(np.abs(d))
        clear = lit[window] & (np.median(np.stack(sizes), axis=0) > CLEAR * light[window])
        stacked = np.stack(bits)
        out.append((np.swapaxes(stacked, 1, 2), clear.T) if turn else (stacked, clear))
    return out


def _both(clear: Mask) -> Mask:
    return np.asarray(clear[:, 1:] & clear[:, :-1])


def _tears(parts: list[tuple[Bits, Mask]], limit: int) -> int:
    return sum(int((np.abs(np.diff(_numbers(bits), axis=1)) > limit)[_both(clear)].sum()) for bits, clear in parts)


def _numbers(bits: Bits) -> NDArray[np.int32]:
    number = np.zeros(bits.shape[1:], dtype=np.int32)
    last = np.zeros(bits.shape[1:], dtype=np.bool_)
    for bit in bits:
        last = last ^ bit
        number = 2 * number + last
    return number


def _turned(bits: Bits, k: int) -> Bits:
    out = bits.copy()
    out[k] = ~out[k]
    return out


def _swapped(bits: Bits, i: int, j: int) -> Bits:
    order = np.arange(len(bits))
    order[[i, j]] = j, i
    return bits[order]
