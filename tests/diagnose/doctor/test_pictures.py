"""What only pictures show: a real board of another size than configured, markers of another size than given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import Observations, RobotPoses
from calibrant.detection import detect
from calibrant.diagnose.doctor import case_of_views
from calibrant.diagnose.doctor.diagnosis import diagnose_views
from calibrant.diagnose.doctor.faults import markers
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import se3
from calibrant.simulate.render import render
from calibrant.simulate.scenes import look_at_board, standard_camera
from calibrant.targets.charuco import Charuco

Array = NDArray[np.float64]
SPACING = 0.0254


def dots(image: NDArray[np.uint8]) -> Array:
    """Centres of a 10x10 grid of dots, (100, 2) px, from the corner with the dot of double size, by rows.

    Blob parameters of the data set's target.yaml.
    """
    p = cv2.SimpleBlobDetector_Params()
    p.minThreshold, p.maxThreshold, p.thresholdStep, p.minRepeatability = 20, 220, 10, 3
    p.minDistBetweenBlobs = 5
    p.filterByColor, p.blobColor = True, 0
    p.filterByArea, p.minArea, p.maxArea = True, 25, 5000
    p.filterByCircularity = p.filterByInertia = False
    p.filterByConvexity, p.minConvexity = True, 0.95
    detector = cv2.SimpleBlobDetector_create(p)
    found, centres = cv2.findCirclesGrid(
        image, (10, 10), flags=cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING, blobDetector=detector
    )
    assert found
    grid = centres.reshape(10, 10, 2).astype(np.float64)
    blobs = detector.detect(image)
    centre = np.array([b.pt for b in blobs])
    size = np.array([b.size for b in blobs])
    corners = [grid[r, c] for r, c in ((0, 0), (0, -1), (-1, 0), (-1, -1))]
    big = max(corners, key=lambda q: size[np.argmin(np.linalg.norm(centre - q, axis=1))])
    turned = [np.rot90(g, k) for g in (grid, grid.transpose(1, 0, 2)) for k in range(4)]
    for g in turned:
        along, down = g[0, -1] - g[0, 0], g[-1, 0] - g[0, 0]
        if np.allclose(g[0, 0], big) and along[0] * down[1] - along[1] * down[0] > 0:
            return g.reshape(-1, 2)
    raise AssertionError("no orientation starts at the big dot")


@pytest.fixture(scope="module")
def circles(shared_data: Callable[[str], Path]) -> tuple[tuple, Observations]:
    """Notations of the poses and observations of the 15 pictures."""
    folder = shared_data("handeye_rct_circles_eih")
    names = [str(i) for i in range(15)]
    row, column = np.divmod(np.arange(100), 10)
    points = np.column_stack([column * SPACING, row * SPACING, np.zeros(100)])
    uv = [dots(cv2.imread(str(folder / "images" / f"{i}.png"), cv2.IMREAD_GRAYSCALE)) for i in names]
    observations = Observations.from_points([points] * 15, uv, image_size=(640, 480), ids=names)
    complete = notations(read_poses(str(folder / "poses" / "*.yaml")))
    order = [complete[0].ids.index(i) for i in names]
    return tuple(r.take(order) for r in complete), observations


def test_a_grid_of_another_spacing_than_configured(circles: tuple[tuple, Observations]) -> None:
    """The configured 25.4 mm and the label on the disc disagree (the set's README): the robot decides."""
    complete, observations = circles
    found = diagnose_views(complete, observations, calibrate_intrinsics(observations).camera)
    finding = found.named("target-size")[0]
    assert finding.status == "warn"
    assert finding.measured is not None
    assert finding.evidence is not None
    # OpenCV's loop is 7.2 mm; a scale some per cent below one, known to some tenths of a per cent, halves it.
    assert 0.965 < finding.measured.value < 0.985
    assert finding.measured.sigma < 0.005
    assert finding.evidence.before.mm > 2 * finding.evidence.after.mm
    assert found.poses.setup == "eye-in-hand"
    assert "poses-shifted" not in {f.name for f in found.findings}


@pytest.mark.long
@pytest.mark.parametrize(("given", "named"), [(18.0, False), (20.0, True), (15.0, True)])
def test_markers_of_another_size_than_given(tmp_path: Path, given: float, named: bool) -> None:
    rng = np.random.default_rng(1)
    board = Charuco(columns=5, rows=7, square=0.036, marker=0.018, dictionary="DICT_6X6_250")
    camera = standard_camera()
    T = look_at_board(camera, board.points, 4, rng=rng, distance=(0.3, 0.4), tilt_deg=25)
    files = []
    for i, pose in enumerate(T):
        files.append(tmp_path / f"{i}.png")
        cv2.imwrite(str(files[-1]), render(board.artwork(), camera, pose, rng=rng))
    observations = detect([str(f) for f in files], target=replace(board, marker=1e-3 * given), workers=1)
    poses = RobotPoses(tuple(v.id for v in observations.views), se3.inverse(T)[: len(observations.views)])
    found = markers.examine(case_of_views(poses, observations, camera, setup="eye-in-hand"))
    assert [f.name for f in found] == (["marker-size"] if named else [])
    if named:
        assert found[0].measured is not None
        assert found[0].measured.value == pytest.approx(0.018, rel=0.03)
