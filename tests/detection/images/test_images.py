"""Reading images and lists of images; every way in which users get that wrong is named."""

from __future__ import annotations

import os
import struct
import zlib

import cv2
import numpy as np
import pytest
from tests.detection.chessboard_pictures import Lens, facing, picture

from calibrant.detection import detect
from calibrant.detection.images.files import EXTENSIONS, expand
from calibrant.detection.images.images import load_grey, load_image, orientation_of, to_grey8
from calibrant.detection.pipeline import notes_on_orientation
from calibrant.errors import InputError

PNG = b"\x89PNG\r\n\x1a\n"
RAMP = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))


def save(path, image):
    cv2.imwrite(str(path), image)
    return path


def test_numbers_in_names_are_sorted_by_value(tmp_path):
    for name in ("10.png", "2.png", "1.png", "a10.png", "a9.png"):
        save(tmp_path / name, RAMP)
    (tmp_path / "notes.txt").write_text("not an image")
    names = ["1.png", "2.png", "10.png", "a9.png", "a10.png"]
    assert [p.name for p in expand(tmp_path)] == names
    assert [p.name for p in expand([tmp_path / "*.png"])] == names


def test_order_given_is_kept_and_a_file_is_taken_once(tmp_path):
    first, second = save(tmp_path / "b.png", RAMP), save(tmp_path / "a.png", RAMP)
    assert expand([first, second, first, tmp_path]) == [first, second]


def test_a_name_with_brackets_is_a_file_before_it_is_a_pattern(tmp_path):
    file = save(tmp_path / "shot[1].png", RAMP)
    assert expand(file) == [file]


@pytest.mark.parametrize("name", ["missing.png", "*.png"])
def test_missing_files_and_patterns_are_named(tmp_path, name):
    with pytest.raises(InputError, match=r"missing\.png does not exist|no file matches .*\*\.png"):
        expand(tmp_path / name)


def test_folder_without_images_and_no_images(tmp_path):
    with pytest.raises(InputError, match="holds no images"):
        expand(tmp_path)
    with pytest.raises(InputError, match="no images were given"):
        expand([])
    with pytest.raises(InputError, match="name is empty, as from a shell variable"):
        expand(["", tmp_path])


@pytest.mark.parametrize(
    "image", [RAMP, cv2.cvtColor(RAMP, cv2.COLOR_GRAY2BGR), cv2.cvtColor(RAMP, cv2.COLOR_GRAY2BGRA)]
)
def test_grey_colour_and_alpha_read_alike(tmp_path, image):
    grey = load_grey(save(tmp_path / "a.png", image))
    assert grey.dtype == np.uint8
    assert np.abs(grey.astype(int) - RAMP).max() <= 1


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_images_keep_their_contrast(tmp_path, bits):
    deep = (RAMP.astype(np.uint16) << (bits - 8)).astype(np.uint16)
    assert np.abs(load_grey(save(tmp_path / "a.png", deep)).astype(int) - RAMP).max() <= 1


def test_floats_truth_values_and_wrong_shapes():
    assert to_grey8(np.linspace(0, 1, 12).reshape(3, 4)).max() == 255
    assert set(np.unique(to_grey8(np.eye(4, dtype=bool)))) == {0, 255}
    assert to_grey8(np.zeros((3, 4), np.uint16)).max() == 0
    with pytest.raises(InputError, match="2 channels"):
        to_grey8(np.zeros((4, 4, 2), np.uint8))


# Lossy formats keep a ramp to a few grey levels.
LOSSY = {".jpg": 3, ".jpeg": 3, ".jpe": 3, ".webp": 3}
GREY_ONLY, COLOUR_ONLY = (".pgm",), (".ppm",)
DEEP = (".png", ".tif", ".tiff", ".pgm", ".ppm", ".pnm", ".jp2")


@pytest.mark.parametrize("extension", sorted(set(EXTENSIONS) - {".pbm", ".gif"}))  # OpenCV writes no grey GIF
def test_every_format_is_read_in_grey_and_colour(tmp_path, extension):
    for channels in (1, 3):
        if (channels == 1 and extension in COLOUR_ONLY) or (channels == 3 and extension in GREY_ONLY):
            continue
        image = RAMP if channels == 1 else cv2.cvtColor(RAMP, cv2.COLOR_GRAY2BGR)
        (file,) = expand(save(tmp_path / f"a{extension}", image).parent)
        assert np.abs(load_grey(file).astype(int) - RAMP).max() <= LOSSY.get(extension, 1)
        as_stored = load_image(file)
        assert as_stored.shape[:2] == RAMP.shape
        assert as_stored.dtype == np.uint8
        file.unlink()


@pytest.mark.parametrize("extension", DEEP)
def test_sixteen_bits_are_read_and_kept(tmp_path, extension):
    deep = RAMP.astype(np.uint16) * 257
    deep = deep if extension not in COLOUR_ONLY else np.repeat(deep[..., None], 3, axis=2)
    file = save(tmp_path / f"a{extension}", deep)
    assert np.abs(load_grey(file).astype(int) - RAMP).max() <= 1
    np.testing.assert_array_equal(load_image(file), deep)


def test_colour_keeps_its_channels(tmp_path):
    rng = np.random.default_rng(5)
    colour = rng.integers(0, 255, (*RAMP.shape, 3)).astype(np.uint8)
    alpha = np.dstack([colour, RAMP])
    np.testing.assert_array_equal(load_image(save(tmp_path / "a.png", colour)), colour)
    np.testing.assert_array_equal(load_image(save(tmp_path / "b.png", alpha)), alpha)
    # The decoder weighs colours with integers of its own.
    ours = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(int)
    for name in ("a.png", "b.png"):
        assert np.abs(load_grey(tmp_path / name).astype(int) - ours).max() <= 1


def test_floating_point_colour_is_read(tmp_path):
    image = np.repeat((RAMP / 255).astype(np.float32)[..., None], 3, axis=2)
    grey = load_grey(save(tmp_path / "a.tiff", image))
    assert np.abs(grey.astype(float) - RAMP * (255 / RAMP.max())).max() <= 1


def one_bit_png(bits: np.ndarray) -> bytes:
    """A PNG of bit depth 1, colour type 0 (PNG specification, 11.2.2)."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    h, w = bits.shape
    rows = b"".join(b"\0" + np.packbits(row).tobytes() for row in bits)
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 1, 0, 0, 0, 0))
    return PNG + header + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def test_one_bit_images_are_black_and_white(tmp_path):
    bits = RAMP > 100
    (tmp_path / "a.png").write_bytes(one_bit_png(bits))
    (tmp_path / "b.pbm").write_bytes(b"P4\n64 48\n" + np.packbits(~bits, axis=1).tobytes())  # 1 is black
    for name in ("a.png", "b.pbm"):
        np.testing.assert_array_equal(load_grey(tmp_path / name), bits * np.uint8(255))


def with_orientation(image: np.ndarray, extension: str, asked: int) -> bytes:
    """A file whose EXIF block, a little-endian TIFF with one entry, asks for an orientation."""
    # The quality above 100 asks for lossless WebP.
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if extension == ".webp" else []
    raw = cv2.imencode(extension, image, options)[1].tobytes()
    tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0" + bytes([asked]) + b"\0\0\0\0\0\0\0"
    if extension == ".jpg":
        block = b"Exif\0\0" + tiff
        return raw[:2] + b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block + raw[2:]
    if extension == ".png":
        block = struct.pack(">I", len(tiff)) + b"eXIf" + tiff + struct.pack(">I", zlib.crc32(b"eXIf" + tiff))
        return raw[:33] + block + raw[33:]
    if extension == ".webp":
        h, w = image.shape[:2]
        canvas = bytes([0x08, 0, 0, 0]) + (w - 1).to_bytes(3, "little") + (h - 1).to_bytes(3, "little")
        parts = [b"WEBPVP8X", struct.pack("<I", 10), canvas, raw[12:], b"EXIF", struct.pack("<I", len(tiff)), tiff]
        body = b"".join(parts)
        return b"RIFF" + struct.pack("<I", len(body)) + body
    return tiff_with_tag(bytearray(raw), asked)


def tiff_with_tag(raw: bytearray, asked: int) -> bytes:
    """A TIFF file with the orientation among its tags, its directory moved to the end."""
    (at,) = struct.unpack_from("<I", raw, 4)
    (count,) = struct.unpack_from("<H", raw, at)
    entries = [bytes(raw[at + 2 + 12 * i : at + 14 + 12 * i]) for i in range(count)]
    entries = [e for e in entries if e[:2] != b"\x12\x01"] + [struct.pack("<HHIHH", 0x112, 3, 1, asked, 0)]
    raw += b"\0" * (len(raw) % 2)
    struct.pack_into("<I", raw, 4, len(raw))
    return bytes(raw) + struct.pack("<H", len(entries)) + b"".join(sorted(entries)) + b"\0\0\0\0"


# An orientation says where the stored first row and column are: (row, column) of 2 is (top, right), of 6 (right, top).
UPRIGHT_OF = {
    1: lambda im: im,
    2: lambda im: im[:, ::-1],
    3: lambda im: im[::-1, ::-1],
    4: lambda im: im[::-1],
    5: lambda im: im.swapaxes(0, 1),
    6: lambda im: im[::-1].swapaxes(0, 1),
    7: lambda im: im[::-1, ::-1].swapaxes(0, 1),
    8: lambda im: im[:, ::-1].swapaxes(0, 1),
}


@pytest.mark.parametrize("extension", [".jpg", ".png", ".webp", ".tif"])
@pytest.mark.parametrize("asked", range(1, 9))
def test_exif_orientation_is_respected(tmp_path, extension, asked):
    corner = np.zeros((48, 64, 3), np.uint8)
    corner[:16, :24], corner[32:, :16] = (0, 0, 250), 120  # red top left, grey bottom left
    file = tmp_path / f"a{extension}"
    file.write_bytes(with_orientation(corner, extension, asked))
    expected = UPRIGHT_OF[asked](corner)
    upright = load_image(file)
    assert upright.shape == expected.shape
    # JPEG smears the edges of the coloured squares.
    assert np.mean(np.abs(upright.astype(int) - expected)) < 2
    assert load_grey(file).shape == expected.shape[:2]
    assert orientation_of(file) == (1 if extension == ".tif" else asked)


def test_an_exif_block_that_ends_early_says_nothing(tmp_path):
    file = tmp_path / "a.jpg"
    raw = with_orientation(RAMP, ".jpg", 6)
    file.write_bytes(raw.replace(b"II*\0\x08\0\0\0", b"II*\0\xff\xff\0\0"))
    assert load_grey(file).shape == RAMP.shape


def test_turned_photos_are_reported(tmp_path):
    board = cv2.cvtColor(cv2.resize(RAMP, (64, 64)), cv2.COLOR_GRAY2BGR)
    files = []
    for number, turn in enumerate((1, 3, 3)):
        files.append(tmp_path / f"{number}.png")
        files[-1].write_bytes(with_orientation(board, ".png", turn))
    asked = [orientation_of(file) for file in files]
    assert notes_on_orientation(asked[:1]) == []
    (both,) = notes_on_orientation(asked[1:])
    assert both == "Images turned upright as their EXIF data say: 2 turned by 180 degrees, of 2."
    (mixed,) = notes_on_orientation(asked)
    assert "2 turned by 180 degrees, of 3. A camera that was held in different ways" in mixed


def gif(frames: int) -> bytes:
    """A GIF of 2 x 2 pixels: a palette of two colours, and `frames` pictures coded as clear, 0 0 0 0, end."""
    picture = b"\x21\xf9\x04\0\0\0\0\0" + b"\x2c" + struct.pack("<HHHHB", 0, 0, 2, 2, 0) + b"\x02\x03\x04\x02\x05\0"
    return b"GIF89a" + struct.pack("<HHBBB", 2, 2, 0x80, 0, 0) + b"\0\0\0\xff\xff\xff" + frames * picture + b";"


def animated_webp(frames: int) -> bytes:
    parts = b"WEBPVP8X" + struct.pack("<I", 10) + b"\x02" + b"\0" * 9
    parts += b"ANIM" + struct.pack("<I", 6) + b"\0" * 6 + frames * (b"ANMF" + struct.pack("<I", 16) + b"\0" * 16)
    return b"RIFF" + struct.pack("<I", len(parts)) + parts


def animated_png(frames: int) -> bytes:
    control = b"acTL" + struct.pack(">II", frames, 0)
    raw = one_bit_png(RAMP > 100)
    return raw[:33] + struct.pack(">I", 8) + control + struct.pack(">I", zlib.crc32(control)) + raw[33:]


def test_animations_and_pages_are_refused_by_name(tmp_path):
    (tmp_path / "a.gif").write_bytes(gif(3))
    (tmp_path / "a.webp").write_bytes(animated_webp(3))
    (tmp_path / "a.png").write_bytes(animated_png(3))
    assert cv2.imwritemulti(str(tmp_path / "a.tif"), [RAMP, RAMP, RAMP])
    for name in ("a.gif", "a.webp", "a.png", "a.tif"):
        for read in (load_grey, load_image):
            with pytest.raises(InputError, match=rf"{name} holds 3 pictures .* expected one a file"):
                read(tmp_path / name)
    (tmp_path / "one.png").write_bytes(animated_png(1))
    assert load_grey(tmp_path / "one.png").shape == RAMP.shape


def test_a_preview_in_a_tiff_is_no_second_picture(tmp_path):
    assert cv2.imwritemulti(str(tmp_path / "a.tif"), [RAMP, RAMP[::4, ::4].copy()])
    np.testing.assert_array_equal(load_grey(tmp_path / "a.tif"), RAMP)


def test_a_file_that_is_cut_off_is_named(tmp_path):
    rng = np.random.default_rng(7)
    noise = rng.integers(0, 255, (48, 64)).astype(np.uint8)
    for extension in (".jpg", ".png", ".webp", ".tif", ".jp2"):
        raw = cv2.imencode(extension, noise)[1].tobytes()
        file = tmp_path / f"a{extension}"
        file.write_bytes(raw[: len(raw) // 2])
        with pytest.raises(InputError, match=rf"a\{extension} is (cut off|not an image)"):
            load_grey(file)


def test_images_of_size_zero_are_named(tmp_path):
    empty = one_bit_png(np.zeros((1, 8), bool))
    header = b"IHDR" + struct.pack(">IIBBBBB", 0, 0, 1, 0, 0, 0, 0)
    (tmp_path / "a.png").write_bytes(empty[:12] + header + struct.pack(">I", zlib.crc32(header)) + empty[33:])
    (tmp_path / "a.pgm").write_bytes(b"P5\n0 0\n255\n")
    for name in ("a.png", "a.pgm"):
        with pytest.raises(InputError, match=f"{name} .*(not an image|cannot be decoded)"):
            load_grey(tmp_path / name)


def test_bad_images_cost_themselves_alone(tmp_path):
    """Every kind of bad file beside one good photo: the good one is used, the others are listed with their reasons."""
    lens = Lens(290.0, 160.0, 120.0)
    pose = facing(9, 6, lens, distance=15, tilt_deg=10, axis_deg=30, roll_deg=5)
    save(tmp_path / "good.png", picture(9, 6, pose, lens, (320, 240)))
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.jpg").write_text("no image")
    (tmp_path / "moving.webp").write_bytes(animated_webp(2))
    (tmp_path / "cut.png").write_bytes((tmp_path / "good.png").read_bytes()[:200])
    (tmp_path / "zero.pgm").write_bytes(b"P5\n0 0\n255\n")
    found = detect([tmp_path], target="chessboard:9x6:25mm", workers=1)
    assert [v.id for v in found.views] == ["good.png"]
    reasons = {m.id: m.reason for m in found.missed}
    assert set(reasons) == {"empty.png", "text.jpg", "moving.webp", "cut.png", "zero.pgm"}
    assert "is empty" in reasons["empty.png"]
    assert "holds 2 pictures" in reasons["moving.webp"]
    assert "is cut off" in reasons["cut.png"]


def test_bad_files_are_named(tmp_path):
    empty, text = tmp_path / "empty.png", tmp_path / "text.png"
    empty.touch()
    text.write_text("no image")
    with pytest.raises(InputError, match=r"empty\.png is empty"):
        load_grey(empty)
    with pytest.raises(InputError, match=r"text\.png is not an image"):
        load_grey(text)
    with pytest.raises(InputError, match=r"gone\.png does not exist"):
        load_grey(tmp_path / "gone.png")
    with pytest.raises(InputError, match="cannot be read"):
        load_grey(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_named_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(InputError, match=r"pipe\.png is a pipe or a device"):
        expand(tmp_path / "pipe.png")
