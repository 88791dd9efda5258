"""AprilTag 3's families on rendered pictures, and against the library that their codes come from."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.detection.registry import detector_for
from calibrant.errors import InputError, MissingExtraError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets import apriltag3
from calibrant.targets.registry import parse_target

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
LOOK = Look(blur_px=0.8, noise_grey=2.0, uneven_light=0.2, vignetting=0.1, clutter=30)


def photograph(spec: str, *, tilt_deg: float, turn_deg: float, look: Look = LOOK) -> tuple[np.ndarray, np.ndarray]:
    """An image of a marker whose square is about 100 px wide, and its true pixels (4, 2)."""
    target = parse_target(spec)
    R = so3.exp(np.deg2rad(tilt_deg) * np.array([0.6, 0.8, 0])) @ so3.exp(np.array([0, 0, np.deg2rad(turn_deg)]))
    T = se3.make(R, np.array([0.02, 0.01, 6.0 * np.ptp(target.points[:, 0])]))
    image = render(target.artwork(), CAMERA, T, rng=np.random.default_rng(3), look=look)
    return image, CAMERA.project(se3.apply(T, target.points))


@pytest.mark.long
@pytest.mark.parametrize("name", apriltag3.FAMILIES)
def test_a_familys_tags_are_found_with_their_corners_in_order(name: str) -> None:
    pytest.importorskip("pupil_apriltags")
    family = apriltag3.FAMILIES[name]
    known = apriltag3.tag_codes(name)
    assert len(known.codes) == family.capacity
    assert f"{len(known.row)}h{known.distance}" in name
    last = family.capacity - 1
    for tag_id, tilt, turn in ((0, 0, 0), (last, 40, 100)):
        spec = f"marker:50mm:{name}:{tag_id}"
        image, truth = photograph(spec, tilt_deg=tilt, turn_deg=turn)
        found = detector_for("marker").detect(image, parse_target(spec))
        assert found.point_ids.tolist() == [0, 1, 2, 3], found.reason
        assert found.sigma_px is not None
        assert np.abs(found.uv - truth).max() < 0.2
        assert np.all(np.linalg.norm(found.uv - truth, axis=1) < 4.0 * found.sigma_px)
        assert (
            not detector_for("marker")
            .detect(image, parse_target(f"marker:50mm:{name}:{(tag_id + 1) % family.capacity}"))
            .found
        )


@pytest.mark.long
@pytest.mark.parametrize("name", ["tagStandard41h12", "tagCircle21h7"])
def test_order_and_place_of_the_corners_are_those_of_apriltags_own_detector(name: str) -> None:
    library = pytest.importorskip("pupil_apriltags")
    spec = f"marker:50mm:{name}:7"
    image, _ = photograph(spec, tilt_deg=20, turn_deg=30)
    detector = library.Detector(families=name)
    (theirs,) = detector.detect(image)
    detector.tag_families.clear()  # its finaliser would free the family before the detector that reads it
    ours = detector_for("marker").detect(image, parse_target(spec))
    assert theirs.tag_id == 7
    # Theirs go counter-clockwise from the lower left, and count from the corner of the top left pixel.
    np.testing.assert_allclose(ours.uv, theirs.corners[::-1] - 0.5, atol=0.5)


def test_without_the_library_the_cure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "pupil_apriltags":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    apriltag3.tag_codes.cache_clear()
    target = parse_target("marker:50mm:standard41H12:7")
    assert target.spec == "marker:50mm:tagStandard41h12:7"
    with pytest.raises(MissingExtraError, match=r"pip install 'calibrant\[apriltag3\]'"):
        detector_for("marker").detect(np.zeros((480, 640), np.uint8), target)


def test_what_a_family_cannot_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="tagCircle21h7 has markers 0 to 37, got id 38"):
        parse_target("marker:50mm:tagCircle21h7:38")
    for spec in (
        "charuco:5x7:40mm:20mm:tagStandard41h12",
        "aprilgrid:6x6:88mm:0.3:41h12",
        "aprilgrid:6x6:88mm:0.3:standard41h12",
    ):
        with pytest.raises(InputError, match="41h12"):
            parse_target(spec)
    (tmp_path / "b.yaml").write_text("dictionary: tagStandard41h12\nmarkers:\n  - {id: 3, side: 50mm}\n")
    assert parse_target(f"bundle:{tmp_path / 'b.yaml'}").points.shape == (4, 3)
