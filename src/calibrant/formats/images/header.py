"""What an image file's bytes say besides its pixels: how to turn it, how many pictures it holds, whether it is whole.

Orientation: EXIF's tag 0x0112, 1 to 8 (CIPA DC-008, Exif 2.32, table 4), in a block that is a small TIFF file; it lies
in JPEG's APP1 segment, PNG's eXIf chunk, WebP's EXIF chunk. Decoders differ in which of these they follow, so that
images are decoded as stored and turned here; a TIFF file's own tag is the decoder's, which applies it always.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

UPRIGHT = 1
WORDS = {
    2: "mirrored left to right",
    3: "turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "mirrored and turned by 90 degrees anticlockwise",
    6: "turned by 90 degrees clockwise",
    7: "mirrored and turned by 90 degrees clockwise",
    8: "turned by 90 degrees anticlockwise",
}
"""What is done to the stored pixels to show them upright."""
_ORIENTATION, _WIDTH, _HEIGHT = 0x0112, 0x0100, 0x0101
_SHORT, _LONG = 3, 4
_EXIF = b"Exif\0\0"
_PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_TIFF = (b"II*\0", b"MM\0*")
_PNM_HEADER = 4096
"""Bytes in which a text header's numbers stand."""
_MOST_PAGES = 1000
"""Directories followed in a TIFF file: a damaged one may lead in a circle."""


def orientation(data: bytes) -> int:
    """The orientation 1 to 8 that a file's bytes ask for; 1 where they say nothing, and for TIFF files."""
    for block in _exif_blocks(data):
        pages = _pages(block.removeprefix(_EXIF))
        found = pages[0].get(_ORIENTATION, UPRIGHT) if pages else UPRIGHT
        if found in WORDS:
            return found
    return UPRIGHT


def turned(image: NDArray[Any], asked: int) -> NDArray[Any]:
    """The image (h, w) or (h, w, channels) turned from its stored pixels as an orientation asks."""
    if asked in (2, 5, 7):
        image = image[:, ::-1]
    elif asked == 4:
        image = image[::-1]
    quarters_anticlockwise = {3: 2, 5: 1, 6: 3, 7: 3, 8: 1}.get(asked, 0)
    return np.ascontiguousarray(np.rot90(image, quarters_anticlockwise))


def pictures(data: bytes) -> int:
    """How many pictures of one size a file holds: frames of an animation, or pages; smaller pages are previews."""
    if data[:8] == _PNG:
        control = next(_chunks(data, 8, ">I", b"acTL", size_first=True), b"")
        return int.from_bytes(control[:4], "big") or 1
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return max(1, sum(1 for _ in _chunks(data, 12, "<I", b"ANMF", size_first=False)))
    if data[:4] == b"GIF8":
        return _gif_frames(data)
    if data[:4] in _TIFF:
        sizes = [(page.get(_WIDTH), page.get(_HEIGHT)) for page in _pages(data)]
        return max(1, sum(1 for size in sizes if size == sizes[0]))
    return 1


def size(data: bytes) -> tuple[int, int] | None:
    """Width and height as the file states them, before anything is decoded; None where its format is not known here."""
    try:
        if data[:8] == _PNG:
            return _pair(">II", data, 16)
        if data[:2] == b"BM":
            width, height = _pair("<ii", data, 18)
            return abs(width), abs(height)
        if data[:4] == b"GIF8":
            return _pair("<HH", data, 6)
        if data[:4] == b"\x59\xa6\x6a\x95":
            return _pair(">II", data, 4)
        if data[:3] == JPEG:
            return _jpeg_size(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_size(data)
        if data[:4] in _TIFF:
            sides = [(page.get(_WIDTH, 0), page.get(_HEIGHT, 0)) for page in _pages(data)]
            return max(sides, key=lambda side: side[0] * side[1], default=None)
        if data[:1] == b"P" and data[1:2] in b"123456":
            words = re.sub(rb"#[^\n]*", b"", data[2:_PNM_HEADER]).split()
            return int(words[0][:10]), int(words[1][:10])
        if data[4:8] == b"jP  ":
            at = data.find(b"ihdr", 0, _PNM_HEADER)
            height, width = _pair(">II", data, at + 4) if at >= 0 else (0, 0)
            return (width, height) if at >= 0 else None
    except (struct.error, ValueError, IndexError):
        return None
    return None


def _pair(form: str, data: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(form, data, at)
    return first, second


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Of the frame's header, the first of its kinds (ITU-T T.81, B.2.2)."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        mark = data[at + 1]
        if 0xC0 <= mark <= 0xCF and mark not in (0xC4, 0xC8, 0xCC):
            height, width = _pair(">HH", data, at + 5)
            return width, height
        at += 1 if mark == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _webp_size(data: bytes) -> tuple[int, int] | None:
    """Of the first chunk: extended, lossless or lossy (RFC 9649)."""
    kind = data[12:16]
    if kind == b"VP8X":
        return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = _pair("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None


def is_cut_off(data: bytes) -> bool:
    """Whether a JPEG or PNG file ends before its picture does; decoders fill the rest with grey."""
    if data[:3] == JPEG:
        # The picture's end mark after its beginning; a preview in the header has marks of its own.
        return data.find(b"\xff\xd9", max(0, data.rfind(b"\xff\xda"))) < 0
    return data[:8] == _PNG and b"IEND" not in data[-64:] and b"IEND" not in data


def is_heif(data: bytes) -> bool:
    """Whether a file is HEIC or HEIF, as phones save: its first box names a brand of HEVC pictures (ISO 23008-12)."""
    end = int.from_bytes(data[:4], "big")
    brands = [data[8:12], *(data[at : at + 4] for at in range(16, min(end, 64), 4))]
    return data[4:8] == b"ftyp" and any(brand in _HEIF_BRANDS for brand in brands) and b"avif" not in brands


def png_damage(data: bytes) -> str | None:
    """What is wrong with a PNG file's parts by their checksums; None if nothing, or for another kind of file."""
    at = 8 if data[:8] == _PNG else len(data)
    while at + 12 <= len(data):
        length, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + length
        # Parts that begin in small letters say something beside the picture.
        if name[:1].isupper() and zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return f"its part {name.decode('latin-1')!r} at byte {at} does not agree with its checksum"
        at = end + 4
    return None


def _exif_blocks(data: bytes) -> Iterator[bytes]:
    """The parts of a file that may be EXIF's TIFF."""
    if data[:3] == JPEG:
        at = 2
        while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:  # 0xDA: the picture begins
            length = int.from_bytes(data[at + 2 : at + 4], "big")
            if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == _EXIF:
                yield data[at + 4 : at + 2 + length]
            at += 2 + length
    elif data[:8] == _PNG:
        yield from _chunks(data, 8, ">I", b"eXIf", size_first=True)
    elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        yield from _chunks(data, 12, "<I", b"EXIF", size_first=False)


def _chunks(data: bytes, at: int, size: str, wanted: bytes, *, size_first: bool) -> Iterator[bytes]:
    """The `wanted` chunks: PNG's size, name, content, checksum, or RIFF's name, size, content padded to even."""
    while at + 8 <= len(data):
        head, second = data[at : at + 4], data[at + 4 : at + 8]
        count, name = (head, second) if size_first else (second, head)
        (length,) = struct.unpack(size, count)
        if name == wanted:
            yield data[at + 8 : at + 8 + length]
        at += 8 + length + (4 if size_first else length % 2)


def _pages(tiff: bytes) -> list[dict[int, int]]:
    """Tags and values, of those with one number, of every directory of a TIFF; none where it is damaged."""
    order = {b"II": "<", b"MM": ">"}.get(tiff[:2])
    pages: list[dict[int, int]] = []
    try:
        (at,) = struct.unpack_from(f"{order}I", tiff, 4) if order else (0,)
        while at and len(pages) < _MOST_PAGES:
            (count,) = struct.unpack_from(f"{order}H", tiff, at)
            page = {}
            for i in range(count):
                tag, kind, _ = struct.unpack_from(f"{order}HHI", tiff, at + 2 + 12 * i)
                if kind in (_SHORT, _LONG):
                    letter = "H" if kind == _SHORT else "I"
                    (page[tag],) = struct.unpack_from(f"{order}{letter}", tiff, at + 10 + 12 * i)
            pages.append(page)
            (at,) = struct.unpack_from(f"{order}I", tiff, at + 2 + 12 * count)
    except struct.error:
        return pages  # EXIF blocks may leave out the end of their last directory
    return pages


def _gif_frames(data: bytes) -> int:
    """Image descriptors of a GIF file, by its chain of blocks (GIF89a, W3C)."""

    def table(flags: int) -> int:
        return 3 * 2 ** ((flags & 7) + 1) if flags & 0x80 else 0

    def skipped(at: int) -> int:
        while at < len(data) and data[at]:
            at += data[at] + 1
        return at + 1

    at, frames = 13 + table(data[10] if len(data) > 10 else 0), 0
    while at + 10 <= len(data) and data[at] in (0x21, 0x2C):
        if data[at] == 0x21:
            at = skipped(at + 2)
        else:
            frames += 1
            at = skipped(at + 11 + table(data[at + 9]))
    return max(1, frames)
