from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from calibrant.errors import InputError
from calibrant.geometry import projective, se3, so3

K_A = np.array([[900.0, 0, 640], [0, 905, 512], [0, 0, 1]])
K_B = np.array([[700.0, 0, 320], [0, 702, 240], [0, 0, 1]])
T_B_A = se3.make(so3.exp([0.05, -0.2, 0.03]), [-0.3, 0.02, 0.05])


def board(columns: int = 9, rows: int = 6) -> np.ndarray:
    return 0.025 * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)


def view(seed: int) -> np.ndarray:
    """A board's homography as a camera half a metre away sees it, Frobenius norm 1."""
    rng = np.random.default_rng(seed)
    T = se3.make(so3.exp(rng.normal(size=3) * 0.4), [-0.1, -0.05, rng.uniform(0.4, 0.8)])
    H = K_A @ T[:3, [0, 1, 3]]
    return H / np.linalg.norm(H)


def pixels(K: np.ndarray, p: np.ndarray) -> np.ndarray:
    uvw = p @ K.T
    return uvw[..., :2] / uvw[..., 2:]


def matches(n: int) -> tuple[np.ndarray, np.ndarray]:
    p_a = np.random.default_rng(15).uniform([-0.4, -0.3, 1], [0.4, 0.3, 2], size=(n, 3))
    return pixels(K_A, p_a), pixels(K_B, se3.apply(T_B_A, p_a))


@pytest.mark.parametrize("n", [4, 5, 54])
def test_homography_is_exact_on_exact_points(n: int) -> None:
    corners = board()[[0, 8, 45, 53, *range(10, 10 + n - 4)]] if n < 54 else board()
    H = view(1)
    found = projective.homography(corners, projective.apply_homography(H, corners))
    # Elements of H lie six decades apart; the normalised system's condition of ~1e3 leaves 1e-12 of the norm.
    np.testing.assert_allclose(found, H, atol=1e-12)


def test_homographies_of_ragged_views_equal_single_ones() -> None:
    rng = np.random.default_rng(16)
    sources = [board()[:n] for n in (54, 20, 31)]
    targets = [projective.apply_homography(view(i), s) + rng.normal(size=s.shape) for i, s in enumerate(sources)]
    together = projective.homographies(sources, targets)
    assert together.shape == (3, 3, 3)
    for H, source, target in zip(together, sources, targets):
        np.testing.assert_allclose(H, projective.homography(source, target), atol=1e-13)


def test_homography_averages_noise() -> None:
    source, sigma, H = board(), 0.3, view(2)
    exact = projective.apply_homography(H, source)
    rng = np.random.default_rng(17)
    rms = []
    for _ in range(50):
        found = projective.homography(source, exact + sigma * rng.normal(size=exact.shape))
        rms.append(np.sqrt(np.mean((projective.apply_homography(found, source) - exact) ** 2)))
    # 8 parameters from 108 values: sigma sqrt(8 / 108) = 0.082 px; the linear solution is a little above the bound.
    assert 0.07 < np.sqrt(np.mean(np.square(rms))) < 0.10


def test_homography_has_positive_depth_on_its_points() -> None:
    source, H = board() - 10.0, view(3)
    H = H @ np.array([[1, 0, 10.0], [0, 1, 10.0], [0, 0, 1]])
    found = projective.homography(source, projective.apply_homography(H, source))
    assert np.all(np.column_stack([source, np.ones(len(source))]) @ found[2] > 0)


def test_a_point_mapped_to_infinity_is_nan() -> None:
    H = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, -1]])
    mapped = projective.apply_homography(H, [[1.0, 5.0], [2.0, 5.0]])
    assert np.all(np.isnan(mapped[0]))
    np.testing.assert_allclose(mapped[1], [2.0, 5.0])


LINE = np.column_stack([np.arange(8.0), 3 * np.arange(8.0) + 1])
SPREAD = board()[:12] * 1000


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (SPREAD[:3], SPREAD[:3], "at least 4 points, got 3"),
        (SPREAD, SPREAD[:11], r"one shape \(n, 2\), got \(12, 2\) and \(11, 2\)"),
        (LINE, SPREAD[4:], "source points lie on one line"),
        (np.column_stack([SPREAD[:, 0], SPREAD[:, 1] % 7]), np.full((12, 2), 5.0), "target points lie on one line"),
        (np.vstack([LINE, [[0, 9.0]]]), np.vstack([2 * LINE, [[4, 1.0]]]), "all points but one lie on a line"),
        (SPREAD, np.where(np.arange(12)[:, None] == 3, np.nan, SPREAD), "target points hold NaN"),
    ],
    ids=["three", "unequal", "collinear", "one-place", "all-but-one", "nan"],
)
def test_degenerate_homographies_are_refused(source: np.ndarray, target: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        projective.homography(source, target)


def test_the_bad_view_of_a_batch_is_named() -> None:
    with pytest.raises(InputError, match="view 2: the source points lie on one line"):
        projective.homographies([SPREAD[4:], SPREAD[4:], LINE], [SPREAD[4:]] * 3)
    with pytest.raises(InputError, match="got 2 and 1"):
        projective.homographies([SPREAD, SPREAD], [SPREAD])


def test_epipolar_constraint_holds_on_matches() -> None:
    uv_a, uv_b = matches(50)
    E = projective.essential_from_transform(T_B_A)
    ideal_a, ideal_b = (
        np.column_stack([(uv - K[:2, 2]) / np.diag(K)[:2], np.ones(50)]) for uv, K in ((uv_a, K_A), (uv_b, K_B))
    )
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", ideal_b, E, ideal_a), 0, atol=1e-14)
    F = projective.fundamental_from_transform(T_B_A, K_a=K_A, K_b=K_B)
    # Distances of pixels of order 1e3: 1e-16 of rounding times a few hundred.
    np.testing.assert_allclose(projective.epipolar_distance(F, uv_a, uv_b), 0, atol=1e-9)
    np.testing.assert_allclose(projective.epipolar_distance(F.T, uv_b, uv_a), 0, atol=1e-9)
    np.testing.assert_allclose(projective.sampson_distance(F, uv_a, uv_b), 0, atol=1e-9)


def test_epipolar_distance_is_in_pixels_across_the_line() -> None:
    uv_a, uv_b = matches(20)
    F = projective.fundamental_from_transform(T_B_A, K_a=K_A, K_b=K_B)
    lines = projective.epipolar_lines(F, uv_a)
    along = np.column_stack([-lines[:, 1], lines[:, 0]])
    moved = uv_b + 2.5 * lines[:, :2] + 40 * along
    np.testing.assert_allclose(projective.epipolar_distance(F, uv_a, moved), 2.5, atol=1e-9)


def test_sampson_distance_is_the_distance_to_the_nearest_consistent_pair() -> None:
    uv_a, uv_b = (uv[0] for uv in matches(1))
    F = projective.fundamental_from_transform(T_B_A, K_a=K_A, K_b=K_B)
    pair = np.concatenate([uv_a, uv_b]) + np.array([0.3, -0.5, -0.2, 0.7])

    def constraint(x: np.ndarray) -> float:
        return float(np.append(x[2:], 1) @ F @ np.append(x[:2], 1)) * 1e4

    nearest = minimize(
        lambda x: np.sum((x - pair) ** 2), pair, constraints={"type": "eq", "fun": constraint}, tol=1e-14
    )
    assert nearest.success
    # Sampson's is the first order of it; the second is the shift over the focal length, a thousandth.
    expected = np.linalg.norm(nearest.x - pair)
    np.testing.assert_allclose(projective.sampson_distance(F, pair[:2], pair[2:]), expected, rtol=2e-3)


def test_one_centre_has_no_epipolar_geometry() -> None:
    with pytest.raises(InputError, match="one centre"):
        projective.essential_from_transform(se3.make(so3.exp([0.1, 0, 0]), np.zeros(3)))


def test_the_epipole_has_no_line() -> None:
    F = projective.fundamental_from_transform(T_B_A, K_a=np.eye(3), K_b=np.eye(3))
    ahead = se3.make(np.eye(3), [0, 0, 1.0])
    assert np.all(np.isnan(projective.epipolar_lines(projective.essential_from_transform(ahead), [0.0, 0.0])))
    assert np.linalg.norm(F) == pytest.approx(1.0)
