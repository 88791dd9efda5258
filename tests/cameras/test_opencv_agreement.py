"""The models that OpenCV has, against its own projection: the same numbers to 1e-9 px."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.peers import OPENCV_CONTRIB

from calibrant.cameras import Camera

SIZE = (1280, 1024)
PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
TERMS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
VALUES = (-0.28, 0.09, 0.0008, -0.0011, -0.012, 0.02, -0.01, 0.003, 0.001, -0.002, 0.0015, 0.0004, 0.05, -0.03)
OMNIDIR = """
import cv2
def answer(p, K, xi, terms):
    return {"uv": cv2.omnidir.projectPoints(p[:, None], np.zeros(3), np.zeros(3), K, float(xi), terms)[0]}
"""


def points(reach: float) -> np.ndarray:
    rng = np.random.default_rng(24)
    z = rng.uniform(0.3, 3, (300, 1))
    return np.concatenate([rng.uniform(-reach, reach, (300, 2)) * z, z], axis=-1)


@pytest.mark.parametrize(("model", "count"), [("brown", 5), ("rational", 8), ("thin_prism", 12), ("tilted", 14)])
def test_perspective_models(model: str, count: int) -> None:
    ours = Camera.create(model, {**PIXELS, **dict(zip(TERMS[:count], VALUES))}, image_size=SIZE)
    p = points(0.7)
    theirs, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), ours.K, np.array(VALUES[:count]))
    np.testing.assert_allclose(ours.project(p), theirs.reshape(-1, 2), atol=1e-9, rtol=0)


def test_skew_is_the_camera_matrix() -> None:
    ours = Camera.create("pinhole_skew", {**PIXELS, "skew": 1.7}, image_size=SIZE)
    p = points(0.7)
    by_matrix = p @ ours.K.T
    np.testing.assert_allclose(ours.project(p), by_matrix[:, :2] / by_matrix[:, 2:], atol=1e-9, rtol=0)


def test_fisheye() -> None:
    terms = {"k1": -0.02, "k2": 0.004, "k3": -0.001, "k4": 0.0002}
    ours = Camera.create("kannala_brandt", {**PIXELS, **terms}, image_size=SIZE)
    p = points(5.0)  # to 82 degrees; OpenCV's own ends at 90
    theirs, _ = cv2.fisheye.projectPoints(p[:, None], np.zeros(3), np.zeros(3), ours.K, np.array(list(terms.values())))
    np.testing.assert_allclose(ours.project(p), theirs[:, 0], atol=1e-9, rtol=0)


@pytest.mark.parametrize("xi", [0.4, 1.0, 1.6])
def test_omnidirectional(xi: float) -> None:
    terms = {"k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.002}
    ours = Camera.create("unified", {**PIXELS, **terms, "skew": 0.6, "xi": xi}, image_size=SIZE)
    p = points(3.0)
    p[::3, 2] *= -0.1  # some behind the image plane
    p = p[ours.model.sees(ours.values, p)]
    assert np.sum(p[:, 2] < 0) > 10
    given = {"p": p, "K": ours.K, "xi": np.array(xi), "terms": np.array(list(terms.values()))}
    theirs = OPENCV_CONTRIB.arrays(OMNIDIR, **given)["uv"]
    np.testing.assert_allclose(ours.project(p), theirs.reshape(-1, 2), rtol=1e-12, atol=1e-9)
