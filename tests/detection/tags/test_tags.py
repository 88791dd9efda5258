"""Markers, bundles and AprilGrids on rendered pictures with known corners."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.detection.detection import Detection
from calibrant.detection.opencv import marker_cells
from calibrant.detection.registry import detector_for
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.bundle import Bundle
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


def solid(target: Bundle, T: np.ndarray, *, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A picture of markers on any planes, each on white paper, the nearest in front; and which are seen, by order.

    4 x 4 rays a pixel meet the plane of each marker; independent of the package's own drawing.
    """
    fine = (np.arange(4 * 640) + 0.5) / 4 - 0.5, (np.arange(4 * 480) + 0.5) / 4 - 0.5
    u, v = np.meshgrid(*fine)
    rays = np.stack([(u - 319.5) / 600, (v - 239.5) / 600, np.ones_like(u)], axis=-1)
    grey, depth = np.full(u.shape, 100.0), np.full(u.shape, np.inf)
    facing = []
    for (marker_id, _), corners in zip(target.markers, se3.apply(T, target.points).reshape(-1, 4, 3), strict=True):
        x, y = corners[1] - corners[0], corners[3] - corners[0]
        normal = np.cross(x, y)
        facing.append(normal @ corners.mean(axis=0) > 0)
        if not facing[-1]:
            continue
        z = (normal @ corners[0]) / (rays @ normal)
        p = z[..., None] * rays - corners[0]
        a, b = p @ x / (x @ x), p @ y / (y @ y)
        on_paper = (np.abs(a - 0.5) < 0.62) & (np.abs(b - 0.5) < 0.62) & (z > 0) & (z < depth)
        cells = marker_cells(target.dictionary, marker_id)
        n = len(cells)
        inside = (a >= 0) & (a < 1) & (b >= 0) & (b < 1)
        at = cells[np.clip((b * n).astype(int), 0, n - 1), np.clip((a * n).astype(int), 0, n - 1)]
        grey = np.where(on_paper, np.where(inside & ~at, 35.0, 210.0), grey)
        depth = np.where(on_paper, z, depth)
    image = cv2.GaussianBlur(grey, (0, 0), 3.0).reshape(480, 4, 640, 4).mean(axis=(1, 3))
    image += np.random.default_rng(seed).normal(0.0, 2.0, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), np.array(facing)


BUNDLE = """
target: bundle
dictionary: DICT_APRILTAG_36h11
markers:
  - {id: 3, side: 50mm, position: [-75mm, 0mm, 0mm], rotation_vector_deg: [0, 0, 90]}
  - {id: 4, side: 40mm, position: [80mm, -20mm, 15mm], rotation_vector_deg: [0, 25, 0]}
cubes:
  - {side: 60mm, marker: 46mm, ids: [10, 11, 12, 13, 14, 15], position: [0mm, 0mm, 0mm]}
"""


@pytest.mark.long
def test_bundles_on_several_planes_give_the_corners_of_every_marker_seen(tmp_path: Path) -> None:
    (tmp_path / "bundle.yaml").write_text(BUNDLE)
    target = parse_target(f"bundle:{tmp_path / 'bundle.yaml'}")
    assert isinstance(target, Bundle)
    errors, planes = [], []
    for seed, turn in enumerate(([0.7, 0.0, 0.0], [0.5, 0.6, 0.2], [-0.6, 0.4, 2.0])):
        T = se3.make(so3.exp(np.array(turn)), np.array([0.0, 0.0, 0.38]))
        image, facing = solid(target, T, seed=seed)
        found = detect(image, target)
        truth = dict(zip(target.point_ids.tolist(), CAMERA.project(se3.apply(T, target.points)), strict=True))
        errors += [found.uv[k] - truth[i] for k, i in enumerate(found.point_ids.tolist())]
        seen = {i // 4 for i in found.point_ids.tolist()}
        assert seen <= {i for (i, _), ahead in zip(target.markers, facing, strict=True) if ahead}
        assert found.sigma_px is not None
        assert len(found.point_ids) == 4 * len(seen)
        planes.append(len(seen))
    # At least two markers of three planes in each picture: a flat face on and others at a slant.
    assert min(planes) >= 3
    # Faces at a steep slant show a few pixels of paper, to which the other side of their edges is known less well.
    assert np.abs(errors).max() < 1.0
    assert np.median(np.abs(errors)) < 0.06
    assert np.sqrt(np.mean(np.square(errors))) < 0.2


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
