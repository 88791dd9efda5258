"""Scans of rendered scenes: depths err as much as stated, derivatives by the calibration, nothing where nothing is."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.decode import Decoded, decode
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.patterns.sequence import PatternSequence
from calibrant.perceive.scan.points import coloured_depth, scan
from calibrant.perceive.stereo.eyes import Eyes
from calibrant.simulate.projector.pictures import Lighting, photographed
from calibrant.simulate.projector.points import ProjectorPair, example_pair
from calibrant.simulate.projector.surfaces import Box, Plane, Scene, Sphere, Surface

PAIR = example_pair(image_size=(320, 240), projector_size=(320, 240))


def eyes_of(pair: ProjectorPair, covariance: np.ndarray | None = None) -> Eyes:
    places = np.stack([np.eye(4), pair.T_camera_projector])
    size = 6 + len(pair.camera.values) + len(pair.projector.values)
    C = np.zeros((size, size)) if covariance is None else covariance
    return Eyes(("camera", "projector"), (pair.camera, pair.projector), places, C)


def surface(kind: str, distance: float) -> Surface:
    """A thing before a wall."""
    wall = Plane(se3.make(so3.exp([0.1, 0.2, 0.0]), [0, 0, 1.15 * distance]), half=(distance, distance))
    at = np.array([0.0, -0.05 * distance, distance])
    if kind == "sphere":
        return Scene((wall, Sphere(at, 0.15 * distance)))
    if kind == "box":
        return Scene((wall, Box(se3.make(so3.exp([0.5, 0.6, 0.2]), at), distance * np.array([0.12, 0.1, 0.11]))))
    return wall


def taken(kind: str, distance: float, code: str) -> tuple[Capture, Surface]:
    thing, sequence = surface(kind, distance), PatternSequence(PAIR.projector.image_size, code)
    lighting = Lighting(distance_m=distance)
    pictures = np.stack(list(photographed(PAIR, thing, sequence, np.random.default_rng(1), lighting)))
    return Capture(kind, sequence, pictures, sequence.names), thing


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("kind", "distance", "code"),
    [
        ("plane", 0.5, "gray"),
        ("sphere", 1.0, "gray"),
        ("box", 2.0, "gray"),
        ("box", 1.0, "both"),
        ("sphere", 2.0, "phase"),
    ],
)
def test_depths_err_as_much_as_stated(kind: str, distance: float, code: str) -> None:
    shot, thing = taken(kind, distance, code)
    found = scan(decode(shot), eyes_of(PAIR))
    assert len(found.points) > 4000
    rays = PAIR.camera.unproject(found.uv.astype(np.float64))
    true = thing.hit(np.zeros(3), rays).distance * rays[:, 2]
    z = (found.points[:, 2] - true) / found.by_pixels
    assert 0.8 < np.mean(z**2) < 1.25
    assert np.abs(z).max() < 12
    assert 0.8 < found.across < 1.25


def exact(points_seen: np.ndarray, shape: tuple[int, int] = (240, 320)) -> Decoded:
    """Pixels decoded exactly for a plane at 1 m."""
    shot, _ = taken("plane", 1.0, "gray")
    decoded = decode(shot)
    v, u = np.mgrid[: shape[0], : shape[1]]
    rays = PAIR.camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float64))
    X = rays / rays[:, 2:]
    q = PAIR.projector.project(se3.apply(se3.inverse(PAIR.T_camera_projector), X)).reshape(*shape, 2)
    q[~points_seen] = np.nan
    return Decoded(q, np.full((*shape, 2), 0.1), decoded.light)


def block() -> np.ndarray:
    seen = np.zeros((240, 320), dtype=bool)
    seen[60:90, 140:180] = True
    return seen


def test_exact_pixels_give_exact_points() -> None:
    found = scan(exact(block()), eyes_of(PAIR))
    np.testing.assert_allclose(found.points[:, 2], 1.0, atol=1e-9)
    assert found.across < 1e-6


@pytest.mark.long
def test_derivatives_by_the_calibration_against_differences() -> None:
    """sigma by the calibration, where one of its numbers alone is uncertain, is the change of depth it makes."""
    decoded = exact(block())
    size = 6 + len(PAIR.camera.values) + len(PAIR.projector.values)
    for k in range(size):
        h = 1e-6 * (100.0 if k >= 6 and (k - 6) % 9 < 4 else 1.0)
        C = np.zeros((size, size))
        C[k, k] = 1.0
        stated = scan(decoded, eyes_of(PAIR, C)).by_calibration
        moved = []
        for sign in (1, -1):
            step = np.zeros(size)
            step[k] = sign * h
            T = se3.retract(PAIR.T_camera_projector, step[:6])
            lenses = [PAIR.camera, PAIR.projector]
            at = 6
            for i, lens in enumerate(lenses):
                values = lens.values + step[at : at + len(lens.values)]
                lenses[i] = Camera(lens.model, lens.image_size, values)
                at += len(values)
            moved.append(scan(decoded, eyes_of(ProjectorPair(lenses[0], lenses[1], T))).points[:, 2])
        np.testing.assert_allclose(np.abs(moved[0] - moved[1]) / (2 * h), stated, rtol=2e-3, atol=1e-7)


def test_pixels_beside_a_jump_or_the_dark_are_left_out() -> None:
    seen = block()
    decoded = exact(seen)
    decoded.pixels[60:90, 160:] += 8.0
    uv = scan(decoded, eyes_of(PAIR)).uv
    assert uv[:, 0].min() == 142
    assert not np.any((uv[:, 0] > 156) & (uv[:, 0] < 163))


def test_an_empty_cloud_is_refused() -> None:
    with pytest.raises(RefusedError, match="the cloud is empty: of 76800 pixels 0 are decoded"):
        scan(exact(np.zeros((240, 320), dtype=bool)), eyes_of(PAIR))


def test_the_cloud_has_its_sigmas_and_the_picture_its_colours() -> None:
    found = scan(exact(block()), eyes_of(PAIR))
    grey = np.full((240, 320), 90, dtype=np.uint8)
    cloud = found.cloud(grey)
    assert set(cloud.values) == {"sigma_z", "sigma_z_pixels", "sigma_z_calibration"}
    assert cloud.colours is not None
    assert np.all(cloud.colours == 90)
    assert coloured_depth(found, grey).shape[0] == 240
