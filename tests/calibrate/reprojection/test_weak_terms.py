"""What lenses can do, as a prior: by the picture's corner, for the terms that have a bound."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.reprojection.weak_terms import corner_reach, term_sigma, weak_terms_information
from calibrant.cameras import Camera

SQUARE = {"fx": 1000.0, "fy": 1000.0, "cx": 499.5, "cy": 299.5}
LENS = {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0}


def test_the_corner_counts_from_the_axis_wherever_that_is() -> None:
    centred = Camera.create("brown", SQUARE | LENS, image_size=(1000, 600))
    shifted = Camera.create("brown", SQUARE | LENS | {"cy": 599.5}, image_size=(1000, 600))
    assert corner_reach(centred) == pytest.approx(np.hypot(0.5, 0.3))
    assert corner_reach(shifted) == pytest.approx(np.hypot(0.5, 0.6))


def test_a_term_moves_the_corner_by_its_share() -> None:
    camera = Camera.create("brown", SQUARE | LENS, image_size=(1000, 600))
    r = corner_reach(camera)
    corner = np.array([[-0.5, -0.3, 1.0]])
    here = camera.project(corner)
    for name, share in (("k1", 0.1), ("k2", 0.03), ("k3", 0.01)):
        sigma = term_sigma(name, r)
        assert sigma is not None
        bent = Camera.create("brown", camera.parameters | {name: sigma}, image_size=(1000, 600)).project(corner)
        assert np.linalg.norm(bent - here) / (1000 * r) == pytest.approx(share)
    assert term_sigma("fx", r) is None


def test_the_prior_holds_distortion_and_nothing_else() -> None:
    camera = Camera.create("brown", SQUARE | LENS, image_size=(1000, 600))
    held = np.flatnonzero(weak_terms_information(camera).any(axis=0))
    assert [camera.model.parameter_names[k] for k in held] == ["k1", "k2", "p1", "p2", "k3"]
    pinhole = Camera.create("pinhole", SQUARE, image_size=(1000, 600))
    assert weak_terms_information(pinhole).shape == (0, 4)
