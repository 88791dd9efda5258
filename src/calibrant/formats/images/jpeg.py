"""Whether a JPEG file's picture is whole: its Huffman codes followed from the first block to the last.

A decoder makes a picture of any bytes; where some were changed it goes on with wrong blocks, often to the picture's
end, and OpenCV passes none of its warnings on. Here the codes of baseline and extended sequential scans are read as in
ISO/IEC 10918-1, annex F.2.2: each must be in its table, no block may have more than 64 coefficients, the mean of no
block may leave the range of 8 bits, and the last block must end where the scan does. Progressive and arithmetic scans,
and files that leave out their tables, are not judged.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrant.compiled import compiled

Bytes = NDArray[np.uint8]

WHOLE, BAD_CODE, TOO_LONG, OUT_OF_RANGE, TOO_SHORT, LEFT_OVER, NO_RESTART = range(7)
WORDS = {
    BAD_CODE: "holds a code that is none",
    TOO_LONG: "holds a block of more than 64 values",
    OUT_OF_RANGE: "is brighter or darker than 8 bits can be",
    TOO_SHORT: "lies behind the end of the data",
    LEFT_OVER: "is the last, and data are left over",
    NO_RESTART: "is followed by no restart mark where one must be",
}
MOST_LEFT = 2
"""Bytes between the last block and the next mark that are let pass: some cameras pad."""
MOST_MEAN = 1100.0
"""Of a block's mean, eight times from grey 128: 1024, and some for the rounding of what wrote it."""
_HUFFMAN_FRAMES = (0xC0, 0xC1)
_OTHER_FRAMES = (0xC2, 0xC3, *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))


@dataclass
class _Header:
    """What the marks before a scan say. tables: by class (0 DC, 1 AC) and number, look-ups by 16 bits of length << 8 |
    value; components: by id, horizontal and vertical sampling and number of their quantisation table."""

    tables: dict[tuple[int, int], NDArray[np.int32]] = field(default_factory=dict)
    first_step: dict[int, int] = field(default_factory=dict)
    components: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    size: tuple[int, int] = (0, 0)
    restart: int = 0


def jpeg_damage(data: bytes) -> str | None:
    """What is wrong with a JPEG file's picture, a sentence; None if nothing.

    None, too, where the file is of a kind that is not judged.
    """
    header, at = _Header(), 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return None  # no mark where one must be: the decoder says more
        mark = data[at + 1]
        if mark == 0xFF:
            at += 1
            continue
        if mark in _OTHER_FRAMES or mark == 0xD9:
            return None
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        part = data[at + 4 : at + 2 + length]
        at += 2 + length
        try:
            if mark == 0xDA:
                problem, at = _scan(header, part, data, at)
                if problem is not None or at < 0:
                    return problem
            else:
                _read_part(header, mark, part)
        except (IndexError, KeyError, ValueError):
            return None  # tables or components that are not there: the decoder says more
    return None


def _read_part(header: _Header, mark: int, part: bytes) -> None:
    if mark in _HUFFMAN_FRAMES:
        height, width = int.from_bytes(part[1:3], "big"), int.from_bytes(part[3:5], "big")
        header.size = (width, height)
        for k in range(part[5]):
            name, sampling, table = part[6 + 3 * k : 9 + 3 * k]
            header.components[name] = (sampling >> 4, sampling & 15, table)
    elif mark == 0xC4:
        while part:
            counts = np.frombuffer(part[1:17], np.uint8).astype(int)
            total = int(counts.sum())
            header.tables[(part[0] >> 4, part[0] & 15)] = _look_up_of(counts, part[17 : 17 + total])
            part = part[17 + total :]
    elif mark == 0xDB:
        while part:
            wide = part[0] >> 4
            header.first_step[part[0] & 15] = int.from_bytes(part[1 : 2 + wide], "big")
            part = part[1 + 64 * (1 + wide) :]
    elif mark == 0xDD:
        header.restart = int.from_bytes(part[:2], "big")


def _look_up_of(counts: NDArray[np.int64], values: bytes) -> NDArray[np.int32]:
    """Length << 8 | value of the code that 16 bits begin with, (65536,); 0 for no code."""
    table, code, at = np.zeros(1 << 16, np.int32), 0, 0
    for length in range(1, 17):
        for _ in range(int(counts[length - 1])):
            first = code << (16 - length)
            table[first : first + (1 << (16 - length))] = length << 8 | values[at]
            code, at = code + 1, at + 1
        code <<= 1
    return table


def _scan(header: _Header, part: bytes, data: bytes, start: int) -> tuple[str | None, int]:
    """What is wrong with a scan's data, which begin at `start`, and where they end; -1 where it cannot be judged."""
    count = part[0]
    chosen = [(part[1 + 2 * k], part[2 + 2 * k]) for k in range(count)]
    most = [max(c[k] for c in header.components.values()) for k in (0, 1)]
    width, height = header.size
    blocks: list[tuple[int, int]] = []
    for name, _ in chosen:
        across, down, _ = header.components[name]
        blocks.append((across, down))
    if count == 1:
        # Alone, a component has its own blocks and no more.
        across, down = blocks[0]
        units = -(-width * across // (8 * most[0])) * -(-height * down // (8 * most[1]))
        blocks = [(1, 1)]
    else:
        units = -(-width // (8 * most[0])) * -(-height // (8 * most[1]))
    if units == 0:
        return None, -1  # the height follows later
    which = np.array([k for k, (across, down) in enumerate(blocks) for _ in range(across * down)], np.int64)
    dc = np.stack([header.tables[(0, tables >> 4)] for _, tables in chosen])
    ac = np.stack([header.tables[(1, tables & 15)] for _, tables in chosen])
    steps = np.array([header.first_step[header.components[name][2]] for name, _ in chosen], np.float64)
    raw = np.frombuffer(data, np.uint8)
    found = _follow(raw, start, which, dc, ac, steps, units, header.restart)
    problem, unit, end = (int(v) for v in found)
    if problem == WHOLE:
        return None, end
    return f"part {unit + 1} of {units} of its picture {WORDS[problem]}", end


@compiled(
    "UniTuple(int64, 3)(Array(uint8, 1, 'C', readonly=True), int64, int64[::1], int32[:, ::1], int32[:, ::1], "
    "float64[::1], int64, int64)"
)
def _follow(data, at, which, dc, ac, steps, units, restart):  # type: ignore[no-untyped-def]
    """What is wrong (one of the constants), in which unit, and where the data end."""
    mean = np.zeros(len(steps))
    held, bits, beyond, size = np.uint64(0), 0, 0, len(data)
    for unit in range(units):
        if restart > 0 and unit > 0 and unit % restart == 0:
            # What is left of the last byte is padding, then comes the mark; a mark holds back what is behind it.
            marked = at + 1 < size and data[at] == 0xFF and data[at + 1] >= 0xD0 and data[at + 1] <= 0xD7
            if not marked or bits - beyond >= 8 + 8 * MOST_LEFT:
                return NO_RESTART, unit - 1, at
            at += 2
            held, bits, beyond = np.uint64(0), 0, 0
            for k in range(len(mean)):
                mean[k] = 0.0
        for k in which:
            index = 0
            while index < 64:
                while bits <= 48:
                    value = np.uint64(0)
                    if at < size and (data[at] != 0xFF or (at + 1 < size and data[at + 1] == 0)):
                        value = np.uint64(data[at])
                        at += 1 if data[at] != 0xFF else 2
                    else:
                        beyond += 8
                    held = (held << np.uint64(8)) | value
                    bits += 8
                code = (held >> np.uint64(bits - 16)) & np.uint64(0xFFFF)
                entry = dc[k, code] if index == 0 else ac[k, code]
                length, symbol = entry >> 8, entry & 255
                if length == 0:
                    return BAD_CODE, unit, at
                bits -= length
                category = symbol & 15
                if index == 0:
                    category = symbol
                    if category > 11:
                        return BAD_CODE, unit, at
                    if category > 0:
                        value = np.int64((held >> np.uint64(bits - category)) & np.uint64((1 << category) - 1))
                        if value < 1 << (category - 1):
                            value -= (1 << category) - 1
                        mean[k] += value
                        if abs(mean[k]) * steps[k] > MOST_MEAN + steps[k]:
                            return OUT_OF_RANGE, unit, at
                    index = 1
                elif category == 0:
                    # 15 stands for sixteen zeros, 0 for the block's end.
                    index = index + 16 if symbol == 0xF0 else 64
                else:
                    index += (symbol >> 4) + 1
                    if index > 64:
                        return TOO_LONG, unit, at
                bits -= category
            if beyond > bits:
                return TOO_SHORT, unit, at
    left = (bits - beyond) // 8
    while at < size and (data[at] != 0xFF or (at + 1 < size and data[at + 1] == 0)):
        left += 1 if data[at] != 0 else 0
        at += 1
    return (LEFT_OVER if left > MOST_LEFT else WHOLE), units - 1, at
