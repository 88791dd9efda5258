"""Targets that are fixed to each other: cameras that see no common board, and one camera that measures a bundle."""

from __future__ import annotations

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.problem.layout import HANDHELD, Pictures
from calibrant.data import Observations, View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, standard_camera
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(8, 6, 0.03)
CENTRED = POINTS - POINTS.mean(axis=0)
T_A_B = se3.make(so3.exp([0.1, np.pi - 0.2, 0.05]), [0.05, -0.02, 0.12])
"""The second board faces the other way, on the back of the first."""
T_ROOT_BACK = se3.make(so3.exp([0.02, np.pi, 0.05]), [0.1, 0.05, 1.5])
"""The second camera looks at the first one, from behind the boards."""


def pictures(seed: int, *, sigma: float = 0.1, n: int = 20, seen: str = "ab") -> list[Pictures]:
    """What a camera in front sees of board A, and one behind of board B; seen: which boards, in this order."""
    rng = np.random.default_rng(seed)
    poses = look_at_board(CAMERA, CENTRED, n, rng=rng, distance=(0.6, 0.8), tilt_deg=35)
    out = []
    for camera, board, T in (
        ("front", "a", poses),
        ("back", "b", se3.inverse(T_ROOT_BACK) @ poses @ T_A_B),
    ):
        if board not in seen:
            continue
        views = []
        for m, M in enumerate(T):
            uv = CAMERA.project(se3.apply(M, CENTRED))
            uv = uv + sigma * rng.normal(size=uv.shape)
            inside = np.all(np.isfinite(uv) & (uv > 0) & (uv < np.array(CAMERA.image_size) - 1), axis=1)
            if inside.sum() >= 12:
                ids = np.arange(len(POINTS))[inside]
                views.append(View(f"{camera}-{m}", CENTRED[inside], uv[inside], ids, camera, moment=str(m)))
        out.append(Pictures(camera, HANDHELD, Observations(tuple(views), {camera: CAMERA.image_size}), target=board))
    return out


def bundle(seed: int, *, sigma: float = 0.1, n: int = 16) -> tuple[list[Pictures], dict[str, np.ndarray]]:
    """One camera goes round three tags of 5 cm; tag0 and tag2 are hardly seen together."""
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0.05, 0]])
    places = {
        "tag0": np.eye(4),
        "tag1": se3.make(so3.exp([0, 0.3, 0.2]), [0.15, 0.02, 0.01]),
        "tag2": se3.make(so3.exp([0.2, 0.5, -0.4]), [0.28, 0.05, 0.06]),
    }
    pairs = (("tag0", "tag1"), ("tag1", "tag2"))
    views: dict[str, list[View]] = {name: [] for name in places}
    for m, T in enumerate(look_at_board(CAMERA, corners, n, rng=rng, distance=(0.35, 0.5), tilt_deg=40)):
        shown = pairs[m % 2]
        for name in shown:
            uv = CAMERA.project(se3.apply(T @ se3.inverse(places[shown[0]]) @ places[name], corners))
            uv = uv + sigma * rng.normal(size=uv.shape)
            views[name].append(View(f"{name}-{m}", corners, uv, np.arange(4), "camera", moment=str(m)))
    lists = [
        Pictures("camera", HANDHELD, Observations(tuple(v), {"camera": CAMERA.image_size}), target=name)
        for name, v in views.items()
    ]
    return lists, places


def test_cameras_that_see_no_common_board_are_tied_by_its_motion() -> None:
    result = cb.calibrate_cell({}, pictures(0, sigma=0.0), rigid=[("a", "b")])
    np.testing.assert_allclose(result.transform("front", "back").matrix, T_ROOT_BACK, atol=1e-6)
    np.testing.assert_allclose(result.transform("a", "b").matrix, T_A_B, atol=1e-6)


@pytest.mark.statistics
def test_errors_of_cameras_and_boards_match_their_covariance() -> None:
    cameras, boards = [], []
    for seed in range(12):
        result = cb.calibrate_cell({}, pictures(seed), rigid=[("a", "b")])
        cameras.append(normalised(result.transform("front", "back"), T_ROOT_BACK))
        boards.append(normalised(result.transform("a", "b"), T_A_B))
    # Means of 12 values of deviation sqrt(12): 6 +- 1; three sigmas allowed.
    assert 3.0 < np.mean(cameras) < 9.0
    assert 3.0 < np.mean(boards) < 9.0


def test_one_camera_measures_how_tags_stand_to_each_other() -> None:
    lists, places = bundle(0, sigma=0.0)
    result = cb.calibrate_cell({}, lists, rigid=[tuple(places)], cameras={"camera": CAMERA})
    for name in ("tag1", "tag2"):
        np.testing.assert_allclose(result.transform("tag0", name).matrix, places[name], atol=1e-7)


@pytest.mark.statistics
def test_errors_of_a_bundle_match_their_covariance() -> None:
    scores = []
    for seed in range(15):
        lists, places = bundle(seed)
        result = cb.calibrate_cell({}, lists, rigid=[tuple(places)], cameras={"camera": CAMERA})
        scores += [normalised(result.transform("tag0", name), places[name]) for name in ("tag1", "tag2")]
    assert 3.0 < np.mean(scores) < 9.0


def test_boards_that_nothing_ties_are_named() -> None:
    lists = pictures(1)
    with pytest.raises(RefusedError, match="the rig falls apart: back"):
        cb.calibrate_cell({}, lists)


def test_groups_that_make_no_sense_are_named() -> None:
    lists = pictures(2)
    with pytest.raises(InputError, match="no pictures of a handheld target 'c'"):
        cb.calibrate_cell({}, lists, rigid=[("a", "c")])
    with pytest.raises(InputError, match="a group of one"):
        cb.calibrate_cell({}, lists, rigid=[("a",)])
