"""The camera of a bag's camera_info: its numbers, wherever a camera is read; and what is no camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.made_bags import KINDS, written_bag

from calibrant.errors import InputError
from calibrant.formats.cameras.read import read_camera

K = np.array([[300.5, 0.0, 162.25], [0.0, 299.5, 117.75], [0.0, 0.0, 1.0]])
D = [-0.05, 0.01, 0.001, -0.002, 0.003]


@pytest.mark.parametrize("kind", KINDS)
def test_the_camera_is_the_messages(kind: str, tmp_path: Path) -> None:
    with written_bag(tmp_path, kind) as (bag, writer):
        writer.camera_info("/camera/camera_info", K, D, (320, 240), 0.0)
        writer.camera_info("/never/camera_info", 0 * K, [], (320, 240), 0.0)
    camera = read_camera(bag / "camera/camera_info", image_size=(320, 240))
    assert camera.image_size == (320, 240)
    np.testing.assert_array_equal(camera.K, K)
    # A point by the published equations of plumb_bob: radial and tangential terms, then K.
    x, y = 0.2 / 1.1, -0.15 / 1.1
    k1, k2, p1, p2, k3 = D
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = 300.5 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 162.25
    v = 299.5 * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 117.75
    np.testing.assert_allclose(camera.project(np.array([[0.2, -0.15, 1.1]]))[0], [u, v], atol=1e-10)
    with pytest.raises(InputError, match="320"):
        read_camera(bag / "camera/camera_info", image_size=(640, 480))
    with pytest.raises(InputError, match=r"no camera_info under /camera/info; it has /camera/camera_info, /never"):
        read_camera(bag / "camera/info")
    with pytest.raises(InputError, match="its K is zero: that camera was never calibrated"):
        read_camera(bag / "never/camera_info")
