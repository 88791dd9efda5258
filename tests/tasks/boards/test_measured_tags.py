"""calibrant target --from-photos: tags at unknown places become a target, where photos tie them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target
from calibrant.tasks.boards.target import Request, run
from calibrant.tasks.writing import write_documents

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
PLACES = {
    3: np.eye(4),
    4: se3.make(so3.exp([0.0, 0.0, 0.3]), [0.11, 0.02, 0.0]),
    7: se3.make(so3.exp([0.0, 0.0, -0.2]), [0.03, 0.12, 0.0]),
}
SPEC = "marker:50mm:DICT_APRILTAG_36h11:3,4,7"


def write_bundle(path: Path) -> None:
    lines = ["target: bundle", "dictionary: DICT_APRILTAG_36h11", "markers:"]
    for i, T in PLACES.items():
        x, y, z = 1e3 * T[:3, 3]
        turn = np.rad2deg(so3.log(T[:3, :3])).tolist()
        lines.append(f"  - {{id: {i}, side: 50mm, position: [{x}mm, {y}mm, {z}mm], rotation_vector_deg: {turn}}}")
    path.write_text("\n".join(lines))


def photos(folder: Path, count: int = 8) -> Path:
    """Photos of the three tags: each drawn as its own artwork would be, in one plane, turned as they are."""
    from calibrant.targets.marker import Marker

    rng = np.random.default_rng(2)
    write_bundle(folder / "truth.yaml")
    points = parse_target(str(folder / "truth.yaml")).points
    (folder / "photos").mkdir()
    for k, T in enumerate(look_at_board(CAMERA, points, count, rng=rng, distance=(0.35, 0.5), tilt_deg=40)):
        image = np.full((480, 640), 200, np.uint8)
        for i, place in PLACES.items():
            tag = Marker(0.05, "DICT_APRILTAG_36h11", i)
            drawn = render(tag.artwork(), CAMERA, T @ place, rng=rng, look=Look(clutter=0, noise_grey=1.0))
            edge = 0.05 * np.array([[-0.7, -0.7, 0], [0.7, -0.7, 0], [0.7, 0.7, 0], [-0.7, 0.7, 0]])
            mask = np.zeros_like(image)
            cv2.fillConvexPoly(mask, np.round(CAMERA.project(se3.apply(T @ place, edge))).astype(np.int32), 255)
            image = np.where(mask > 0, drawn, image)
        cv2.imwrite(str(folder / "photos" / f"{k}.png"), image)
    CalibrationResult("intrinsics", "ok", cameras={"camera": CAMERA}).write(folder / "camera.json")
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return photos(tmp_path_factory.mktemp("tags"))


def asked(folder: Path, out: Path, spec: str = SPEC) -> Request:
    return Request(spec=spec, out=out, from_photos=(str(folder / "photos"),), camera=folder / "camera.json")


@pytest.mark.long
def test_the_file_that_is_written_is_the_target(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "bundle.yaml"
    write_documents(run(asked(folder, out)).documents, force=False)
    found, truth = parse_target(str(out)), parse_target(str(folder / "truth.yaml"))
    np.testing.assert_array_equal(found.point_ids, truth.point_ids)
    np.testing.assert_allclose(found.points, truth.points, atol=0.4e-3)
    assert "mm (1 sigma)" in out.read_text()


def test_what_is_no_set_of_tags_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="ids of two or more"):
        run(asked(folder, tmp_path / "b.yaml", "marker:50mm:DICT_APRILTAG_36h11:3"))
    with pytest.raises(InputError, match="tag9 is in none of 8 photos"):
        run(asked(folder, tmp_path / "b.yaml", f"{SPEC},9"))
    with pytest.raises(InputError, match="is a YAML file"):
        run(asked(folder, tmp_path / "b.pdf"))
    with pytest.raises(InputError, match="needs the camera"):
        run(Request(spec=SPEC, out=tmp_path / "b.yaml", from_photos=("photos",)))


def test_tags_that_no_photo_ties_are_named(folder: Path, tmp_path: Path) -> None:
    """Tag 7 is covered in the first photos, the others in the last."""
    (tmp_path / "photos").mkdir()
    for k in range(8):
        image = cv2.imread(str(folder / "photos" / f"{k}.png"))
        T = look_at_board(
            CAMERA, parse_target(str(folder / "truth.yaml")).points, 8,
            rng=np.random.default_rng(2), distance=(0.35, 0.5), tilt_deg=40,
        )[k]  # fmt: skip
        for i in (7,) if k < 4 else (3, 4):
            cover = CAMERA.project(
                se3.apply(T @ PLACES[i], 0.04 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
            )
            cv2.fillConvexPoly(image, np.round(cover).astype(np.int32), (200, 200, 200))
        cv2.imwrite(str(tmp_path / "photos" / f"{k}.png"), image)
    (tmp_path / "camera.json").write_bytes((folder / "camera.json").read_bytes())
    with pytest.raises(RefusedError, match="tag7 was seen at no moment together with tag3"):
        run(asked(tmp_path, tmp_path / "b.yaml"))
