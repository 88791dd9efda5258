from __future__ import annotations

import cv2
import numpy as np

from calibrant.cameras import Camera

CAMERA = Camera.create("pinhole", {"fx": 900, "fy": 905, "cx": 645, "cy": 507}, image_size=(1280, 1024))


def test_projection_by_hand() -> None:
    """u = 900 * 0.1 / 0.5 + 645, v = 905 * (-0.2) / 0.5 + 507."""
    np.testing.assert_allclose(CAMERA.project([0.1, -0.2, 0.5]), [825, 145], atol=1e-12)


def test_projection_is_opencvs() -> None:
    rng = np.random.default_rng(25)
    p = rng.uniform([-1, -1, 0.3], [1, 1, 3], size=(300, 3))
    theirs, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), CAMERA.K, np.zeros(5))
    np.testing.assert_allclose(CAMERA.project(p), theirs.reshape(-1, 2), atol=1e-9, rtol=0)


def test_x_goes_right_y_goes_down_z_goes_ahead() -> None:
    centre, right, down = CAMERA.project([[0, 0, 1], [0.01, 0, 1], [0, 0.01, 1]])
    np.testing.assert_allclose(centre, [645, 507])
    assert right[0] > centre[0]
    assert down[1] > centre[1]
    np.testing.assert_allclose(CAMERA.unproject(centre), [0, 0, 1], atol=1e-15)
