"""Pictures whose bytes were changed: decoders make a picture of them all the same, with blocks moved or grey."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.detection.images.images import load_grey
from calibrant.errors import InputError
from calibrant.formats.images.jpeg import jpeg_damage

KINDS = {
    "baseline": [],
    "optimised": [cv2.IMWRITE_JPEG_OPTIMIZE, 1],
    "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 4],
    "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
}


def picture(size: tuple[int, int] = (123, 157)) -> np.ndarray:
    """Colour, of sides that are no multiples of a block's."""
    rng = np.random.default_rng(5)
    small = rng.integers(0, 256, (12, 16, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(small, size[::-1], interpolation=cv2.INTER_CUBIC))


def jpeg(kind: str, quality: int = 90, image: np.ndarray | None = None) -> bytes:
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, *KINDS[kind]]
    return bytes(cv2.imencode(".jpg", picture() if image is None else image, options)[1])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("quality", [30, 90, 100])
def test_whole_ones_are_whole(kind: str, quality: int) -> None:
    assert jpeg_damage(jpeg(kind, quality)) is None
    assert jpeg_damage(jpeg(kind, quality, picture()[..., 0])) is None


@pytest.mark.parametrize("kind", ["baseline", "optimised", "restarts"])
def test_changed_bytes_are_found(kind: str) -> None:
    data, found = jpeg(kind), 0
    begin = data.rfind(b"\xff\xda") + 14
    for seed in range(40):
        rng, changed = np.random.default_rng(seed), bytearray(data)
        for at in rng.integers(begin, len(data) - 2, 20):
            changed[at] = rng.integers(0, 256)
        found += jpeg_damage(bytes(changed)) is not None
    # A code is as long as another by chance: blocks are then wrong, but all there.
    assert found >= 36


def test_any_bytes_give_an_answer() -> None:
    data = jpeg("baseline")
    for seed in range(200):
        rng, changed = np.random.default_rng(seed), bytearray(data)
        for at in rng.integers(2, len(data), 3):
            changed[at] = rng.integers(0, 256)
        jpeg_damage(bytes(changed[: rng.integers(2, len(data))]))


def test_the_file_is_named(tmp_path: Path) -> None:
    file, changed = tmp_path / "a.jpg", bytearray(jpeg("restarts"))
    changed[len(changed) // 2 :] = bytes(len(changed) - len(changed) // 2 - 2) + b"\xff\xd9"
    file.write_bytes(changed)
    with pytest.raises(InputError, match=r"a.jpg is damaged \(part .* copy it again"):
        load_grey(file)


def test_a_png_whose_bytes_were_changed(tmp_path: Path) -> None:
    file, data = tmp_path / "a.png", bytearray(cv2.imencode(".png", picture())[1])
    file.write_bytes(data)
    assert load_grey(file).shape == (123, 157)
    data[len(data) // 2] ^= 0x10
    file.write_bytes(data)
    with pytest.raises(InputError, match=r"is damaged .*checksum"):
        load_grey(file)


def test_a_picture_from_the_field(shared_case: Callable[[str], Path]) -> None:
    with pytest.raises(InputError, match="is damaged"):
        load_grey(shared_case("13-corrupt-jpeg") / "flip4.jpg")
