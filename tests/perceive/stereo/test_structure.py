"""A box reconstructed under its planes, right angles, parallel edges: exact, as certain as stated, nearer the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.perceive.stereo.made import made_eyes, pixels_of

from calibrant.arrays import Array
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.stereo.points import points_from_matches
from calibrant.perceive.stereo.structure import Reconstruction, Structure, reconstruct

EYES = made_eyes(scale=1e-6)
T_TRUE = se3.make(so3.exp([0.3, 0.5, 0.2]) @ np.diag([1.0, -1.0, -1.0]), [0.06, 0.03, 0.55])
"""The box's corner and axes; its x and z faces and y face look at the cameras."""
SIZE = np.array([0.08, 0.06, 0.05])


def _box() -> tuple[Array, Structure]:
    """Marks on three faces that meet in the corner, edges and the corner among them: points (n, 3) of the box."""
    grid = np.linspace(0, 1, 4)
    points = {}
    for axis in range(3):
        for a in grid:
            for b in grid:
                p = np.zeros(3)
                p[(axis + 1) % 3], p[(axis + 2) % 3] = a, b
                points[tuple((-p * SIZE).round(9))] = None
    X = np.array(list(points))
    faces = [np.flatnonzero(X[:, axis] == 0).tolist() for axis in range(3)]
    return X, Structure.box(*faces)


BOX, STRUCTURE = _box()


def _found(rng: np.random.Generator | None, structure: Structure, sigma_px: float = 0.3) -> Reconstruction:
    uv = pixels_of(EYES, se3.apply(T_TRUE, BOX))
    if rng is not None:
        uv = uv + rng.normal(0, sigma_px, uv.shape)
    return reconstruct(points_from_matches(EYES, uv, sigma_px=sigma_px), structure, calibration=EYES.covariance)


def test_exact_points_stay_and_give_the_exact_pose() -> None:
    found = _found(None, STRUCTURE)
    np.testing.assert_allclose(found.points, se3.apply(T_TRUE, BOX), atol=1e-9)
    T, _ = found.pose(0, 1, 2)
    np.testing.assert_allclose(np.abs(np.sum(T[:3, :3] * T_TRUE[:3, :3], axis=0)), 1, atol=1e-9)
    np.testing.assert_allclose(T[:3, 3], T_TRUE[:3, 3], atol=1e-9)


def test_the_structure_holds_exactly_in_what_is_reconstructed() -> None:
    found = _found(np.random.default_rng(1), STRUCTURE)
    np.testing.assert_allclose(found.normals @ found.normals.T, np.eye(3), atol=1e-10)
    for k, members in enumerate(STRUCTURE.planes):
        np.testing.assert_allclose(found.points[list(members)] @ found.normals[k], found.offsets[k], atol=1e-12)
    assert found.fits > 1e-3


def _errors(found: Reconstruction) -> tuple[Array, Array]:
    """Pose error (6,) and its covariance."""
    T, C = found.pose(0, 1, 2)
    # The box's own axes or against them, as the faces look at the camera.
    true = T_TRUE.copy()
    true[:3, :3] *= np.sign(np.sum(T[:3, :3] * T_TRUE[:3, :3], axis=0))
    return se3.local(T, true), C


def _aligned(points: Array) -> Array:
    """The pose of the box from its points as they were triangulated: least squares of their places."""
    a, b = BOX - BOX.mean(axis=0), points - points.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return se3.make(R, points.mean(axis=0) - R @ BOX.mean(axis=0))


def _gain(off: dict[str, list[Array]], rows: slice) -> float:
    """RMS of poses' errors (6,) with the structure over that without."""
    a, b = (np.sqrt(np.mean(np.array(off[name])[:, rows] ** 2)) for name in ("with", "without"))
    return float(a / b)


@pytest.mark.statistics
def test_right_angles_lower_the_pose_error_and_sigma_says_so() -> None:
    """80 noisy boxes, with the structure and with planes alone."""
    rng = np.random.default_rng(2)
    off: dict[str, list[Array]] = {"with": [], "without": [], "raw": []}
    stated: dict[str, list[Array]] = {"with": [], "without": []}
    scores: dict[str, list[float]] = {"with": [], "without": []}
    points = {"with": 0.0, "raw": 0.0}
    for _ in range(80):
        uv = pixels_of(EYES, se3.apply(T_TRUE, BOX)) + rng.normal(0, 0.3, (2, len(BOX), 2))
        raw = points_from_matches(EYES, uv, sigma_px=0.3)
        for name, structure in (("with", STRUCTURE), ("without", STRUCTURE.free)):
            found = reconstruct(raw, structure, calibration=EYES.covariance)
            error, C = _errors(found)
            off[name].append(error)
            stated[name].append(np.diag(C))
            scores[name].append(float(error @ np.linalg.solve(C, error)) / 6)
        off["raw"].append(se3.local(_aligned(raw.points), T_TRUE))
        structured = reconstruct(raw, STRUCTURE, calibration=EYES.covariance)
        points["with"] += float(np.mean((structured.points - se3.apply(T_TRUE, BOX)) ** 2))
        points["raw"] += float(np.mean((raw.points - se3.apply(T_TRUE, BOX)) ** 2))
    # The nearest rotation to three free normals spreads their errors already, so that right angles take a quarter off
    # the turn (0.77 by the covariances) and more than a half off the place (0.46): what they say is what is seen.
    turns, places = (_gain(off, rows) for rows in (slice(0, 3), slice(3, 6)))
    sigma_turns, sigma_places = (
        _gain({n: [np.sqrt(v) for v in stated[n]] for n in stated}, rows) for rows in (slice(0, 3), slice(3, 6))
    )
    # Of 240 errors each way: a sigma of 6 %, less what the two have in common.
    assert turns == pytest.approx(sigma_turns, rel=0.12)
    assert places == pytest.approx(sigma_places, rel=0.12)
    assert turns < 0.8
    assert places < 0.55
    raw_turns = np.sqrt(np.mean([np.sum(e[:3] ** 2) for e in off["raw"]]) / 3)
    assert np.sqrt(np.mean([e[:3] ** 2 for e in off["with"]])) < 0.6 * raw_turns
    assert points["with"] < 0.25 * points["raw"]
    # The mean of 80 chi-squares of 6 degrees of freedom over 6 has a sigma of 6 %.
    assert np.mean(scores["with"]) == pytest.approx(1, abs=0.2)


def test_points_err_as_stated_and_a_crooked_box_is_told_by_its_chance() -> None:
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(60):
        found = _found(rng, STRUCTURE)
        off = found.points - se3.apply(T_TRUE, BOX)
        z = np.array([0.0, 0.0, 1.0])
        scores.append(np.mean((off @ z) ** 2 / np.einsum("i,nij,j->n", z, found.covariance, z)))
    assert np.mean(scores) == pytest.approx(1, abs=0.25)
    crooked = BOX + 0.15 * BOX[:, [1, 2, 0]] * [1.0, 0.0, 0.0]
    uv = pixels_of(EYES, se3.apply(T_TRUE, crooked))
    raw = points_from_matches(EYES, uv, sigma_px=0.3)
    assert reconstruct(raw, STRUCTURE, calibration=EYES.covariance).fits < 1e-6
    assert reconstruct(raw, STRUCTURE.free, calibration=EYES.covariance).fits > 0.5


def test_parallel_planes_share_a_direction() -> None:
    """The box on a table: its top is parallel to what it stands on."""
    table = np.array([[x, -0.07, z] for x in (-0.2, 0.1) for z in (-0.2, 0.05, 0.2)])
    X = np.concatenate([BOX, table])
    planes = (*STRUCTURE.planes, tuple(range(len(BOX), len(X))))
    structure = Structure(planes, STRUCTURE.right_angles, parallel=((1, 3),))
    uv = pixels_of(EYES, se3.apply(T_TRUE, X)) + np.random.default_rng(4).normal(0, 0.3, (2, len(X), 2))
    found = reconstruct(points_from_matches(EYES, uv, sigma_px=0.3), structure, calibration=EYES.covariance)
    assert abs(found.normals[1] @ found.normals[3]) == pytest.approx(1, abs=1e-10)
    np.testing.assert_allclose(found.normals[:3] @ found.normals[:3].T, np.eye(3), atol=1e-10)


def test_the_calibration_moves_the_planes_as_stated() -> None:
    eyes = made_eyes(seed=5)
    uv = pixels_of(eyes, se3.apply(T_TRUE, BOX)) + np.random.default_rng(5).normal(0, 0.1, (2, len(BOX), 2))
    raw = points_from_matches(eyes, uv, sigma_px=0.3)
    k = 20
    h = 1e-2 * np.sqrt(eyes.covariance[k, k])
    one = np.zeros(eyes.covariance.shape)
    one[k, k] = 1.0
    stated = reconstruct(raw, STRUCTURE, calibration=one).calibration
    moved = [replace(raw, points=raw.points + s * h * raw.by_calibration[:, :, k]) for s in (1, -1)]
    ends = [reconstruct(m, STRUCTURE, calibration=one).points for m in moved]
    J = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(stated, J[:, :, None] * J[:, None, :], rtol=0.05, atol=0.02 * np.abs(stated).max())


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="plane 0 has 2 points"):
        Structure(((0, 1),))
    with pytest.raises(InputError, match="planes 0 and 3"):
        Structure(((0, 1, 2),), right_angles=((0, 3),))
    raw = points_from_matches(EYES, pixels_of(EYES, se3.apply(T_TRUE, BOX)))
    with pytest.raises(InputError, match="names point 999"):
        reconstruct(raw, Structure(((0, 1, 999),)), calibration=EYES.covariance)
    row = np.flatnonzero((BOX[:, 0] == 0) & (BOX[:, 1] == 0)).tolist()
    with pytest.raises(RefusedError, match="lie on a line"):
        reconstruct(raw, Structure((tuple(row),)), calibration=EYES.covariance)
