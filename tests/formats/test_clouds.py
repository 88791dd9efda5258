"""Clouds as PLY: what is written is read again, and what other programs write is read."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from calibrant.data.cloud import Cloud
from calibrant.errors import InputError
from calibrant.formats.clouds import ply_bytes, read_ply


def _cloud(rng: np.random.Generator) -> Cloud:
    return Cloud(
        rng.normal(size=(50, 3)),
        rng.integers(0, 256, (50, 3)).astype(np.uint8),
        {"sigma_z": rng.random(50), "confidence": rng.random(50)},
        "left",
    )


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    cloud = _cloud(np.random.default_rng(1))
    file = tmp_path / "cloud.ply"
    file.write_bytes(ply_bytes(cloud))
    back = read_ply(file)
    np.testing.assert_allclose(back.points, cloud.points, rtol=1e-6)
    np.testing.assert_array_equal(back.colours, cloud.colours)
    np.testing.assert_allclose(back.values["sigma_z"], cloud.values["sigma_z"], rtol=1e-6)
    assert list(back.values) == ["sigma_z", "confidence"]
    assert back.frame == "left"


def test_the_bytes_are_those_of_the_format() -> None:
    cloud = Cloud(np.array([[1.0, 2.0, 3.0]]), np.array([[10, 20, 30]], np.uint8))
    head, _, body = ply_bytes(cloud).partition(b"end_header\n")
    assert head.split(b"\n")[:2] == [b"ply", b"format binary_little_endian 1.0"]
    assert b"element vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n" in head
    assert body == struct.pack("<fff3B", 1.0, 2.0, 3.0, 10, 20, 30)


def test_text_and_the_other_byte_order_are_read(tmp_path: Path) -> None:
    file = tmp_path / "a.ply"
    file.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 1\n0.5 0 nan\n1 2 3\n3 0 1 2\n"
    )
    np.testing.assert_array_equal(read_ply(file).points, [[0, 0, 1], [1, 2, 3]])
    big = b"ply\nformat binary_big_endian 1.0\nelement vertex 1\n"
    big += b"property float x\nproperty float y\nproperty float z\nend_header\n" + struct.pack(">fff", 1, 2, 3)
    file.write_bytes(big)
    np.testing.assert_array_equal(read_ply(file).points, [[1, 2, 3]])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"hello", "no PLY file"),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n" + b"property float x\n" * 1 + b"end_header\n",
            "x, y",
        ),
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\n"
            b"property float z\nend_header\n1234",
            "cut short",
        ),
        (
            b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n"
            b"end_header\n",
            "empty",
        ),
    ],
)
def test_files_that_are_none_are_named(tmp_path: Path, content: bytes, words: str) -> None:
    file = tmp_path / "bad.ply"
    file.write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_ply(file)


def test_an_empty_cloud_and_unequal_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="empty"):
        Cloud(np.zeros((0, 3)))
    with pytest.raises(InputError, match="colours of 2 points"):
        Cloud(np.zeros((2, 3)), np.zeros((3, 3), np.uint8))
    with pytest.raises(InputError, match="sigma_z: expected a number a point"):
        Cloud(np.zeros((2, 3)), values={"sigma_z": np.zeros(3)})
    with pytest.raises(InputError, match="NaN"):
        Cloud(np.array([[0.0, 0.0, np.nan]]))
