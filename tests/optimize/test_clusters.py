"""Errors that residuals share in clusters: influence against a new solve, scores against draws, statistics of sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.errors import InputError
from calibrant.optimize.chances import t_interval
from calibrant.optimize.clusters import (
    Clusters,
    cluster_scores,
    clustered_covariance,
    corrected,
    edge_sums,
    influence,
    square_root,
)
from calibrant.optimize.factors import Factor
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.losses import cauchy
from calibrant.simulate.scenes import intrinsics_scene


def _scene(**options):
    return intrinsics_scene(12, **options)


@pytest.mark.parametrize("shape", ["flat", "paraboloid"])
def test_influence_is_what_a_moved_pixel_does(shape: str) -> None:
    observations = _scene().observations
    kept = calibrate_keeping(observations, target_shape=shape)
    phi, residuals = influence(kept.solution, "reprojection", "camera")
    step = 1e-3
    for row, axis in ((3, 0), (200, 1), (411, 0)):
        view = int(np.searchsorted(kept.stacked.offsets, row, side="right")) - 1
        moved = np.array(observations.views[view].uv)
        moved[row - kept.stacked.offsets[view], axis] += step
        views = list(observations.views)
        views[view] = replace(views[view], uv=moved)
        again = calibrate_keeping(replace(observations, views=tuple(views)), target_shape=shape)
        change = again.solution.value("camera")[0] - kept.solution.value("camera")[0]
        # The residual is predicted minus observed: a pixel that moves by `step` changes it by -step.
        sigma = np.sqrt(np.diag(kept.solution.covariance("camera")))
        assert change / sigma == pytest.approx(phi[row, axis] * step / sigma, abs=2e-2 * step)
    assert residuals.shape == phi.shape[:2]


def test_the_compiled_influence_is_that_of_the_jacobians() -> None:
    kept = calibrate_keeping(_scene().observations)
    problem = kept.solution.problem
    factor, values = problem.factors[0], problem.gather(0, kept.solution.values)
    rng = np.random.default_rng(1)
    across = [rng.normal(size=(factor.edges, 4, 6)), rng.normal(size=(1, 4, 9))]
    weight = rng.uniform(0.5, 2, size=factor.blocks_count)
    compiled = factor.influence(across, values, weight=weight)
    for ours, plain in zip(compiled, Factor.influence(factor, across, values, weight=weight), strict=True):
        assert ours == pytest.approx(plain, abs=1e-9 * np.abs(plain).max())


@pytest.mark.parametrize("robust", [False, True])
def test_the_sums_of_an_edge_are_those_of_its_residuals(robust: bool) -> None:
    kept = calibrate_keeping(_scene().observations)
    solution = kept.solution
    if robust:
        problem = solution.problem
        factors = tuple(f.with_loss(cauchy(0.5)) for f in problem.factors)
        solution = solve(replace(problem, factors=factors), sigmas={"pixel": 0.1})
    _, inverse = square_root(solution.covariance("camera"))
    phi, residuals = influence(solution, "reprojection", "camera", onto=inverse)
    ((sums, squares),) = edge_sums(solution, "reprojection", [("camera", inverse)])
    first = kept.stacked.offsets[:-1]
    assert sums == pytest.approx(np.add.reduceat(np.einsum("ndp,nd->np", phi, residuals), first), abs=1e-9)
    assert squares == pytest.approx(np.add.reduceat(np.einsum("ndp,ndq->npq", phi, phi), first), abs=1e-9)


def test_an_unknown_that_is_held_has_no_influence() -> None:
    scene = _scene()
    names = scene.camera.model.parameter_names
    kept = calibrate_keeping(scene.observations, fix=["fx", "fy"], initial=scene.camera)
    phi, _ = influence(kept.solution, "reprojection", "camera")
    assert not phi[:, :, [names.index("fx"), names.index("fy")]].any()
    with pytest.raises(InputError, match="no shared unknown"):
        influence(kept.solution, "reprojection", "T_camera_target")


def _rows(n: int, each: int, p: int, rng: np.random.Generator):
    """A linear problem's influence rows in the metric where C is I: sum A^T A = I."""
    A = rng.normal(size=(n * each, 1, p))
    root = np.linalg.cholesky(np.linalg.inv(np.einsum("nij,nik->jk", A, A)))
    return A @ root


@pytest.mark.parametrize("clusters", [6, 30])
def test_independent_residuals_share_nothing_and_clustered_ones_do(clusters: int) -> None:
    rng, p, each = np.random.default_rng(2), 4, 40
    labels = np.repeat(np.arange(clusters), each)
    found: dict[str, list[float]] = {"alone": [], "shared": []}
    true = []
    for _ in range(60):
        rows = _rows(clusters, each, p, rng)
        flat = rows[:, 0]
        noise = rng.normal(size=len(flat))
        # A vector of each cluster's own, as blur that moves all its points along: e = noise + rows w_g.
        own = 6 * rng.normal(size=(clusters, p)) @ np.linalg.inv(np.linalg.cholesky(flat.T @ flat / clusters)).T
        for name, e in (("alone", noise), ("shared", noise + np.einsum("ij,ij->i", flat, own[labels]))):
            left = e - flat @ (flat.T @ e)
            scores = cluster_scores(rows, left[:, None], labels, root=np.eye(p))
            found[name].append(float(np.trace(clustered_covariance(np.eye(p), [scores]))) / p)
        blocks = [flat[labels == g].T @ flat[labels == g] for g in range(clusters)]
        mean = np.linalg.cholesky(flat.T @ flat / clusters)
        spread = sum(36 * G @ np.linalg.inv(mean @ mean.T) @ G for G in blocks)
        true.append(1 + float(np.trace(spread)) / p)
    few = (t_interval(clusters - 1) / 1.96) ** 2
    assert np.mean(found["alone"]) < 1 + 0.2 * few
    # Drawn towards a multiple of I, S keeps its trace: on average what is true, and the factor for few clusters.
    assert np.mean(found["shared"]) == pytest.approx(1 + few * (np.mean(true) - 1), rel=0.15)


def test_two_clusters_say_nothing() -> None:
    assert not Clusters(np.ones((2, 3)), np.eye(3)).shared.any()


def test_a_square_root_knows_units_and_held_directions() -> None:
    C = np.diag([1e6, 0.0, 1e-8])
    C[0, 2] = C[2, 0] = 0.05
    root, inverse = square_root(C)
    assert root.shape == (3, 2)
    assert not root[1].any()
    assert root @ root.T == pytest.approx(C, rel=1e-12)
    assert inverse @ root == pytest.approx(np.eye(2), abs=1e-9)


def test_clusters_are_corrected_alike_by_series_and_by_eigenvalues() -> None:
    """(I - G)^-1/2 z, for clusters of next to nothing up to ones that determine a direction by themselves."""
    rng = np.random.default_rng(4)
    axes = np.linalg.qr(rng.normal(size=(8, 5, 5)))[0]
    values = np.linspace(0.02, 0.99, 8)[:, None] * rng.uniform(0.2, 1.0, size=(8, 5))
    G = (axes * values[:, None, :]) @ np.swapaxes(axes, 1, 2)
    z = rng.normal(size=(8, 5))
    wanted = np.einsum("gab,gb,gcb,gc->ga", axes, 1 / np.sqrt(1 - values), axes, z)
    norms = np.sqrt(np.sum(G**2, axis=(1, 2)))
    assert norms.min() < 0.5 < norms.max()  # both ways are taken
    np.testing.assert_allclose(corrected(z, G, root=np.eye(5)).scores, wanted, rtol=1e-12, atol=1e-13)


def test_what_smooth_errors_do_to_one_direction_is_not_spread_over_all() -> None:
    """Errors that are linear across a cluster fall in the one direction that a linear map moves."""
    rng, p, clusters, each, level = np.random.default_rng(4), 9, 16, 60, 0.6
    labels = np.repeat(np.arange(clusters), each)
    shares: dict[str, list[float]] = {"by place": [], "nowhere": []}
    for _ in range(60):
        at = rng.uniform(-1, 1, size=(len(labels), 2))
        A = 0.4 * rng.normal(size=(len(labels), 1, p))
        A[:, 0, 0] += at[:, 0]
        rows = A @ np.linalg.cholesky(np.linalg.inv(np.einsum("nij,nik->jk", A, A)))
        flat = rows[:, 0]
        e = rng.normal(size=len(flat)) + level * np.sum(rng.normal(size=(clusters, 2))[labels] * at, axis=1)
        found = cluster_scores(rows, (e - flat @ (flat.T @ e))[:, None], labels, root=np.eye(p), at=at)
        most = np.linalg.eigh(found.alike)[1][:, -1]
        pulls = np.array([most @ flat[labels == g].T @ at[labels == g] for g in range(clusters)])
        few = (t_interval(min(found.freedom, clusters - 1)) / 1.96) ** 2
        for name, scores in (("by place", found), ("nowhere", replace(found, alike=None))):
            shares[name].append(float(most @ scores.shared @ most) / (few * level**2 * float(np.sum(pulls**2))))
    assert np.mean(shares["by place"]) == pytest.approx(0.86, abs=0.1)
    assert np.mean(shares["nowhere"]) < 0.7


def test_clusters_of_which_a_few_say_all_count_as_few() -> None:
    G = np.zeros((20, 2, 2))
    G[:4] = np.eye(2) * 0.24
    G[4:] = np.eye(2) * 0.0025
    assert corrected(np.ones((20, 2)), G, root=np.eye(2)).freedom == pytest.approx(1 / np.sum(G[:, 0, 0] ** 2))
    assert corrected(np.ones((20, 2)), np.tile(np.eye(2) / 20, (20, 1, 1)), root=np.eye(2)).freedom == pytest.approx(20)
