"""Pictures that would fill the memory are refused by their header; all others pass it."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from calibrant.detection.images.images import load_grey, load_image
from calibrant.detection.images.video import frames
from calibrant.errors import InputError
from calibrant.formats.images import header
from calibrant.formats.images.picture_bytes import refuse_vast
from calibrant.opencv import cv2

PICTURE = (np.arange(37 * 53) % 251).astype(np.uint8).reshape(37, 53)


def bomb(width: int, height: int) -> bytes:
    """A PNG that states a size and holds next to nothing."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    sizes = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + sizes + chunk(b"IDAT", zlib.compress(bytes(9999))) + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tiff", ".webp", ".pgm", ".ppm", ".jp2", ".ras", ".pbm"])
def test_the_size_of_every_format_is_read_from_its_header(suffix: str) -> None:
    picture = np.repeat(PICTURE[..., None], 3, axis=2) if suffix in (".ppm", ".ras") else PICTURE
    data = cv2.imencode(suffix, picture)[1].tobytes()
    assert header.size(data) == (53, 37)
    for cut in range(min(len(data), 60)):
        header.size(data[:cut])


def test_a_picture_that_unfolds_to_gigabytes_is_refused_unread(tmp_path: Path) -> None:
    for size, words in (((30_000, 30_000), "250 megapixels at most"), ((15_000, 15_000), "made to fill the memory")):
        (tmp_path / "bomb.png").write_bytes(bomb(*size))
        for read in (load_grey, load_image):
            with pytest.raises(InputError, match=rf"image .*bomb\.png states {size[0]}x{size[1]} px.*{words}"):
                read(tmp_path / "bomb.png")
    refuse_vast((15_000, 10_000), 20_000_000, "a photo of 150 megapixels")
    refuse_vast((400, 33_000), 9_000, "a strip")
    refuse_vast(None, 10, "a format that is not known")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without named pipes")
def test_pipes_and_sparse_files_are_no_pictures(tmp_path: Path) -> None:
    for name in ("a.png", "a.mp4"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=r"image .*a\.png cannot be read: it is a pipe"):
        load_grey(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"video .*a\.mp4 cannot be read: it is a pipe"):
        frames(tmp_path / "a.mp4")
    with open(tmp_path / "b.png", "wb") as stream:
        stream.truncate(2_000_000_000)
    with pytest.raises(InputError, match=r"has 2,000 MB; expected 1000 MB at most"):
        load_grey(tmp_path / "b.png")


def test_a_video_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "v.avi").write_bytes(b"RIFF" + bytes(50))
    with pytest.raises(InputError, match=r"video .*v\.avi cannot be read: it is damaged"):
        frames(tmp_path / "v.avi")
