"""Markers, bundles and AprilGrids on rendered pictures with known corners."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.detect.detection import Detection
from calibrant.detect.registry import detector_for
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Target

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
LOOK = Look(blur_px=0.8, noise_grey=2.0, uneven_light=0.2, vignetting=0.1, clutter=30)


def photograph(
    target: Target, *, tilt_deg: float, turn_deg: float = 0.0, part: float = 0.5, shift: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """An image of the target, `part` of its height, and its true pixels (n, 2)."""
    middle = target.points.mean(axis=0)
    R = so3.exp(np.deg2rad(tilt_deg) * np.array([0.6, 0.8, 0])) @ so3.exp(np.array([0, 0, np.deg2rad(turn_deg)]))
    distance = 600.0 * np.ptp(target.points, axis=0).max() / (480.0 * part)
    T = se3.make(R, np.array([shift * distance, 0.0, distance]) - R @ middle)
    image = render(target.artwork(), CAMERA, T, rng=np.random.default_rng(3), look=LOOK)
    return image, CAMERA.project(se3.apply(T, target.points))


def detect(image: np.ndarray, target: Target) -> Detection:
    return detector_for(target.kind).detect(image, target)


@pytest.mark.parametrize("spec", ["marker:50mm:DICT_APRILTAG_36h11:10", "marker:50mm:DICT_4X4_50:3"])
@pytest.mark.parametrize(("tilt", "turn", "part"), [(0, 0, 0.5), (40, 100, 0.4), (25, 200, 0.12), (60, 40, 0.15)])
def test_a_markers_corners_are_found_in_their_order(spec: str, tilt: float, turn: float, part: float) -> None:
    target = parse_target(spec)
    image, truth = photograph(target, tilt_deg=tilt, turn_deg=turn, part=part)
    found = detect(image, target)
    assert found.point_ids.tolist() == [0, 1, 2, 3]
    # Four lines fitted to some 20 profiles each, good to a tenth of a pixel; crossings stretch that by 1 / cos(tilt).
    assert np.abs(found.uv - truth).max() < 0.2 / np.cos(np.deg2rad(tilt))


def test_another_id_is_not_taken() -> None:
    image, _ = photograph(parse_target("marker:50mm:DICT_4X4_50:3"), tilt_deg=10)
    assert not detect(image, parse_target("marker:50mm:DICT_4X4_50:4")).found


@pytest.mark.parametrize(("tilt", "turn", "part"), [(0, 0, 0.85), (35, 100, 0.7), (20, 180, 0.5)])
def test_every_corner_of_an_aprilgrid_is_found(tilt: float, turn: float, part: float) -> None:
    target = parse_target("aprilgrid:6x6:88mm:0.3:36h11")
    image, truth = photograph(target, tilt_deg=tilt, turn_deg=turn, part=part)
    found = detect(image, target)
    error = found.uv - truth[found.point_ids]
    assert len(found.point_ids) == 144
    assert np.abs(error).max() < 0.5
    assert np.sqrt((error**2).mean()) < 0.08


def test_an_aprilgrid_cut_off_keeps_its_labels() -> None:
    target = parse_target("aprilgrid:6x6:88mm:0.3:36h11")
    image, truth = photograph(target, tilt_deg=15, part=0.9, shift=0.4)
    found = detect(image, target)
    assert 24 <= len(found.point_ids) < 144
    assert np.abs(found.uv - truth[found.point_ids]).max() < 0.6
