"""Pictures of bags: every encoding back to the numbers that were put in, through every kind of bag."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.made_bags import KINDS, written_bag

from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey, load_image
from calibrant.errors import InputError
from calibrant.formats.bags import pictures

COLOUR = np.random.default_rng(1).integers(0, 256, (12, 16, 3), np.uint8)
GREY16 = np.random.default_rng(2).integers(0, 4096, (12, 16)).astype(np.uint16)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_numbered_over_all_cameras_and_read_back(kind: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind) as (bag, writer):
        for k in range(4):
            writer.image("/left/image_raw", COLOUR + np.uint8(k), 1.0 + k, "bgr8")
            writer.compressed("/right/image_raw/compressed", COLOUR[::-1] + np.uint8(k), 1.5 + k)
    found = pictures.entries(bag)
    assert [(e.number, e.topic) for e in found[:2]] == [(0, "/left/image_raw"), (1, "/right/image_raw/compressed")]
    assert found[2].stamp_ns - found[0].stamp_ns == 10**9
    for number in (6, 0, 5):  # in any order
        expected = (COLOUR if number % 2 == 0 else COLOUR[::-1]) + np.uint8(number // 2)
        np.testing.assert_array_equal(load_image(bag / f"{number:06d}"), expected)
    with pytest.raises(InputError, match="there is no 8"):
        load_grey(bag / "000008")
    with pytest.raises(InputError, match=r"/left/image_raw, /right/image_raw/compressed"):
        expand(bag)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_one_camera_stands_for_its_pictures(kind: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind, compressed=True) as (bag, writer):
        for k in range(3):
            writer.image("/image", COLOUR[..., 0], 1.0 + k, "mono8")
    assert expand([str(bag)]) == [bag / f"{k:06d}" for k in range(3)]
    if kind != "ros1":
        (file,) = bag.glob("*.db3" if kind == "sqlite3" else "*.mcap")
        np.testing.assert_array_equal(load_grey(file / "000001"), COLOUR[..., 0])


@pytest.mark.parametrize(
    ("encoding", "stored", "expected"),
    [
        ("rgb8", COLOUR[..., ::-1], COLOUR),
        ("rgba8", np.dstack([COLOUR[..., ::-1], COLOUR[..., 0]]), np.dstack([COLOUR, COLOUR[..., 0]])),
        ("8UC3", COLOUR, COLOUR),
        ("8UC1", COLOUR[..., 0], COLOUR[..., 0]),
        ("mono16", GREY16, GREY16),
        ("16UC1", GREY16.astype(">u2"), GREY16),
        ("32FC1", GREY16.astype(np.float32), GREY16.astype(np.float32)),
    ],
)
def test_every_encoding_gives_the_numbers_put_in(
    encoding: str, stored: np.ndarray, expected: np.ndarray, tmp_path: Path
) -> None:
    with written_bag(tmp_path, "mcap") as (bag, writer):
        writer.image("/image", stored, 1.0, encoding)
    np.testing.assert_array_equal(load_image(bag / "000000"), expected)


@pytest.mark.parametrize(("order", "at"), [("rggb", (0, 0)), ("bggr", (1, 1)), ("gbrg", (1, 0)), ("grbg", (0, 1))])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_red_of_a_bayer_pattern_is_red(order: str, at: tuple[int, int], dtype: type, tmp_path: Path) -> None:
    mosaic = np.zeros((12, 16), dtype)
    mosaic[at[0] :: 2, at[1] :: 2] = 200  # light falls on the red pixels alone
    bits = 8 * np.dtype(dtype).itemsize
    with written_bag(tmp_path, "ros1") as (bag, writer):
        writer.image("/image", mosaic, 1.0, f"bayer_{order}{bits}")
    blue, green, red = load_image(bag / "000000")[2:-2, 2:-2].mean(axis=(0, 1))
    assert (blue, green) == (0, 0)
    assert red == 200


def test_rows_that_are_filled_up_and_yuv_are_read(tmp_path: Path) -> None:
    wide = np.zeros((12, 20), np.uint8)
    wide[:, :16] = COLOUR[..., 1]
    yuv = np.full((12, 16, 2), 128, np.uint8)
    yuv[..., 1] = np.arange(16, 208, 16, dtype=np.uint8)[:, None]
    with written_bag(tmp_path, "sqlite3") as (bag, writer):
        header = writer.header(1.0)
        kind = writer.type("sensor_msgs/msg/Image")
        padded = kind(header=header, height=12, width=16, encoding="mono8", is_bigendian=0, step=20, data=wide.ravel())
        writer.write("/image", padded, 1.0)
        writer.image("/image", yuv, 2.0, "uyvy")
    np.testing.assert_array_equal(load_image(bag / "000000"), COLOUR[..., 1])
    grey = load_image(bag / "000001")
    assert np.ptp(grey, axis=2).max() <= 2  # no chroma: grey
    np.testing.assert_allclose(grey[:, 0, 0], (np.arange(16, 208, 16) - 16) * 255 / 219, atol=1.5)


def test_compressed_bayer_is_interpolated_and_jpeg_is_near(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(np.repeat(np.repeat(COLOUR, 4, 0), 4, 1), (0, 0), 4)
    mosaic = np.zeros((48, 64), np.uint8)
    mosaic[::2, ::2] = 90
    with written_bag(tmp_path, "mcap") as (bag, writer):
        writer.compressed("/image", smooth, 1.0, "rgb8; jpeg compressed bgr8")
        writer.compressed("/image", mosaic, 2.0, "bayer_rggb8; png compressed ")
    assert np.abs(load_image(bag / "000000").astype(int) - smooth).max() < 12
    assert load_image(bag / "000001")[8, 8].tolist() == [0, 0, 90]


@pytest.mark.parametrize("encoding", ["nv21", "8UC9", "32UC1"])
def test_an_encoding_that_is_not_read_is_named(encoding: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, "mcap") as (bag, writer):
        writer.image("/image", COLOUR, 1.0, encoding)
    with pytest.raises(InputError, match=f"000000: the encoding '{encoding}' is not read; expected mono8"):
        load_image(bag / "000000")


def test_a_message_without_its_bytes_is_refused(tmp_path: Path) -> None:
    with written_bag(tmp_path, "mcap") as (bag, writer):
        kind = writer.type("sensor_msgs/msg/Image")
        data = np.zeros(5, np.uint8)
        message = kind(
            header=writer.header(1.0), height=12, width=16, encoding="mono8", is_bigendian=0, step=16, data=data
        )
        writer.write("/image", message, 1.0)
    with pytest.raises(InputError, match="5 bytes in rows of 16 are no 16x12 px of mono8"):
        load_image(bag / "000000")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.9, 0.999])
def test_a_bag_that_is_cut_off_says_so(kind: str, part: float, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind) as (bag, writer):
        for k in range(8):
            writer.image("/image", COLOUR, 1.0 + k, "bgr8")
    file = bag if kind == "ros1" else next(f for f in bag.iterdir() if f.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    file.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(InputError, match=r"is empty|cut off or damaged .*record it again|no \.\w+ bag"):
        [load_image(bag / f"{k:06d}") for k in range(8)]


@pytest.mark.parametrize("kind", KINDS)
def test_bytes_that_were_changed_raise_nothing_else(kind: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind, compressed=True) as (bag, writer):
        for k in range(3):
            writer.image("/image", COLOUR, 1.0 + k, "bgr8")
            writer.compressed("/other", COLOUR, 1.0 + k)
    file = bag if kind == "ros1" else next(f for f in bag.iterdir() if f.suffix in (".db3", ".mcap"))
    whole, rng = file.read_bytes(), np.random.default_rng(3)
    for _ in range(40):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 8):
            data[at] = rng.integers(0, 256)
        file.write_bytes(bytes(data))
        with suppress(InputError):  # and nothing else
            for k in range(len(pictures.entries(bag))):
                load_image(bag / f"{k:06d}")
        pictures._reader.cache_clear()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.bag", b"\x89PNG and more", "no .bag bag: its content is something else"),
        ("run.mcap", b"#ROSBAG V2.0\n", "a bag of the kind .bag: rename it"),
        ("run.bag", b"#ROSBAG V1.2\n", "rosbag fix"),
        ("run.db3", b"", "empty"),
        ("run.mcap", b"\x89MCAP0\r\n\x01" + bytes(8) + b"\4\0\0\0ros1" + bytes(90), "profile 'ros1', expected 'ros2'"),
    ],
)
def test_a_bag_that_is_something_else_is_named(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        pictures.entries(tmp_path / name)


def bomb(width: int, height: int) -> bytes:
    """A blank PNG of some kilobytes that unfolds to so many pixels, as `zlib` alone writes it."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packer = zlib.compressobj(9)
    rows = b"".join(packer.compress(bytes(1 + width)) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda png: b"", "is empty"),
        (lambda png: png[: len(png) // 2], "is cut off"),
        (lambda png: png[:60] + bytes([png[60] ^ 255]) + png[61:], "is damaged"),
        (lambda png: bomb(20_000, 10_000), "made to fill the memory"),
        (lambda png: bomb(4, 1)[:16] + struct.pack(">II", 40_000, 40_000) + bomb(4, 1)[24:], "megapixels at most"),
    ],
)
def test_a_compressed_picture_is_read_within_the_bounds_of_a_file(
    change: Callable[[bytes], bytes], words: str, tmp_path: Path
) -> None:
    png = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 60), np.uint8))[1].tobytes()
    with written_bag(tmp_path, "mcap") as (bag, writer):
        message = writer.type("sensor_msgs/msg/CompressedImage")
        data = np.frombuffer(change(png), np.uint8)
        writer.write("/camera/compressed", message(header=writer.header(0.0), format="png", data=data), 0.0)
    with pytest.raises(InputError, match=words) as told:
        load_grey(bag / "000000")
    assert "000000" in str(told.value)


def test_a_raw_picture_of_more_pixels_than_sensors_have_is_refused(tmp_path: Path) -> None:
    with written_bag(tmp_path, "mcap") as (bag, writer):
        message = writer.type("sensor_msgs/msg/Image")(
            header=writer.header(0.0), height=50_000, width=50_000, encoding="mono8", is_bigendian=0, step=50_000,
            data=np.zeros(100, np.uint8),
        )  # fmt: skip
        writer.write("/camera/image", message, 0.0)
    with pytest.raises(InputError, match="megapixels at most"):
        load_grey(bag / "000000")
