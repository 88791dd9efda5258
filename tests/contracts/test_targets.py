"""What every kind of target promises: its spec reads back, its points match its labels, what is drawn is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.detection.registry import detector_for
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import KINDS, parse_target

SPECS = (
    "chessboard:9x6:25mm",
    "charuco:5x7:40mm:30mm:DICT_4X4_50",
    "charuco:6x8:30mm:22mm:DICT_APRILTAG_36h11:legacy:inverted",
    "circles:7x5:40mm",
    "circles:7x7:20mm:bigdot",
    "circles:4x11:20mm:asymmetric",
    "circles:10x8:25.4mm:bigdot:inverted:dots=10mm",
    "aprilgrid:4x3:60mm:0.3:36h11",
    "aprilgrid:3x3:60mm:0.25:25h9:border=1",
    "marker:80mm:DICT_APRILTAG_36h11:10",
    "marker:80mm:DICT_4X4_50:3",
    "bundle:plate.yaml",
    "points:points.csv",
)
UNSEEN = ("points:points.csv",)
"""Targets of which nothing is known but their points."""
DRAWN = [spec for spec in SPECS if spec not in UNSEEN]
PLATE = """
target: bundle
dictionary: DICT_5X5_100  # one for all
markers:
  - {id: 3, side: 50mm, position: [0mm, 0mm, 0mm]}
  - id: 7
    side: 50mm
    position: [80mm, 0mm, 0mm]
  - {id: 8, corners: [[-25mm, 45mm, 0mm], [15mm, 45mm, 0mm], [15mm, 85mm, 0mm], [-25mm, 85mm, 0mm]]}
"""
LOOK = Look(blur_px=0.7, noise_grey=2.0, clutter=40)


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files that specs name, in the working folder."""
    (tmp_path / "plate.yaml").write_text(PLATE)
    (tmp_path / "points.csv").write_text("id,x_mm,y_mm,z_mm\n4,0,0,0\n5,100,0,0\n7,0,100,-5\n9,100,100,20\n")
    monkeypatch.chdir(tmp_path)


def test_every_kind_is_tried() -> None:
    assert {spec.split(":")[0] for spec in SPECS} == set(KINDS)


@pytest.mark.parametrize("spec", SPECS)
def test_a_spec_reads_back(spec: str) -> None:
    target = parse_target(spec)
    assert parse_target(target.spec) == target
    kind, *fields = target.spec.split(":")
    assert parse_target(":".join([kind.upper(), *(f.removeprefix("DICT_") for f in fields)])) == target


@pytest.mark.parametrize("spec", SPECS)
def test_points_and_labels_belong_together(spec: str) -> None:
    target = parse_target(spec)
    assert target.points.shape == (len(target.point_ids), 3)
    assert len(set(target.point_ids.tolist())) == len(target.point_ids)


@pytest.mark.parametrize("spec", SPECS)
def test_scaling_scales_every_length(spec: str) -> None:
    target = parse_target(spec)
    double = target.scaled(2.0)
    np.testing.assert_allclose(double.points, 2 * target.points, atol=1e-15)
    assert parse_target(double.spec) == double
    if spec in UNSEEN:
        with pytest.raises(InputError, match="artwork"):
            target.artwork()
    else:
        np.testing.assert_allclose(double.artwork().bounds, 2 * np.array(target.artwork().bounds), atol=1e-12)


def camera() -> Camera:
    parameters = {"fx": 800.0, "fy": 800.0, "cx": 322.0, "cy": 238.0, "k1": -0.15, "k2": 0.05}
    return Camera.create("brown", parameters, image_size=(640, 480))


def pose(spec: str, *, tilt_deg: float, about_deg: float, turn_deg: float) -> np.ndarray:
    """The artwork's middle on the axis, as far as its longer side fills 0.8 of the picture's height; then tilted."""
    x0, y0, x1, y1 = parse_target(spec).artwork().bounds
    about = np.deg2rad(about_deg)
    R = so3.exp(np.deg2rad(tilt_deg) * np.array([np.cos(about), np.sin(about), 0.0])) @ so3.exp(
        np.array([0.0, 0.0, np.deg2rad(turn_deg)])
    )
    middle = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0])
    distance = 800.0 * np.hypot(x1 - x0, y1 - y0) / (0.95 * 480)
    return se3.make(R, np.array([0.0, 0.0, distance]) - R @ middle)


@pytest.mark.parametrize("view", [(0.0, 0.0, 5.0), (40.0, 70.0, -30.0), (50.0, 200.0, 20.0)])
@pytest.mark.parametrize("spec", DRAWN)
def test_what_is_drawn_is_found(spec: str, view: tuple[float, float, float]) -> None:
    target, cam = parse_target(spec), camera()
    T = pose(spec, tilt_deg=view[0], about_deg=view[1], turn_deg=view[2])
    image = render(target.artwork(), cam, T, rng=np.random.default_rng(1), look=LOOK)
    found = detector_for(target.kind).detect(image, target)
    assert found.found, found.reason
    truth = cam.project(se3.apply(T, target.points))
    row_of = {int(label): row for row, label in enumerate(target.point_ids)}
    error = found.uv - truth[[row_of[int(label)] for label in found.point_ids]]
    # Most of the board is found, every point is the one it is called, and to the accuracy that 2 grey levels allow.
    assert len(found.uv) >= 0.9 * len(target.points)
    assert np.abs(error).max() < 0.5
    assert np.sqrt((error**2).mean()) < 0.06


@pytest.mark.parametrize("spec", DRAWN)
def test_nothing_is_found_where_nothing_is(spec: str) -> None:
    target = parse_target(spec)
    for grey in (np.full((120, 160), 128, np.uint8), np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8)):
        found = detector_for(target.kind).detect(grey, target)
        assert not found.found
        assert found.reason


@pytest.mark.parametrize("kind", KINDS)
def test_a_spec_without_fields_is_named(kind: str) -> None:
    with pytest.raises(InputError, match=kind):
        parse_target(kind)
