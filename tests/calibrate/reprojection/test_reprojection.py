"""The reprojection factor: Jacobians through every product of links, and compiled kernels against their NumPy form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.calibrate.reprojection.slopes import check_slopes

from calibrant.calibrate.reprojection.factor import ReprojectionFactor, StackedViews, TargetModes, stack
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.cameras.registry import MODELS
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize import SE3, Problem, Variable, solve, vector
from calibrant.optimize import threads as pool
from calibrant.optimize.factors import Factor
from calibrant.optimize.losses import Loss, cauchy, geman_mcclure, huber, squared
from calibrant.simulate.scenes import intrinsics_scene

VIEWS = 5
SCENE = intrinsics_scene(VIEWS, seed=3, columns=5, rows=4)
RNG = np.random.default_rng(0)
EYE = np.arange(VIEWS)
ONE = np.zeros(VIEWS, dtype=np.int64)
LINKS = {
    "plain": [Link("T", EYE)],
    "inverted": [Link("T", EYE, inverted=True)],
    "rig": [Link("A", ONE), Link("T", EYE)],
    "eye-in-hand": [Link("A", ONE, inverted=True), Link("T", EYE, inverted=True), Link("B", ONE)],
    "eye-to-hand": [Link("A", ONE, inverted=True), Link("T", EYE), Link("B", ONE)],
}


def values_for(links: list[Link]) -> list[np.ndarray]:
    """Random links whose product is near the scene's poses, so that every point stays in front of the camera."""
    values = [se3.exp(0.3 * RNG.normal(size=(1 if link.indices is ONE else VIEWS, 6))) for link in links]
    k = next(i for i, link in enumerate(links) if link.variable == "T")
    spread = [np.broadcast_to(v, (VIEWS, 4, 4)) for v in values]
    left = product(links[:k], spread[:k])
    right = product(links[k + 1 :], spread[k + 1 :])
    middle = se3.inverse(left) @ SCENE.T_camera_target @ se3.inverse(right)
    values[k] = se3.inverse(middle) if links[k].inverted else middle
    return [np.ascontiguousarray(np.broadcast_to(v, (VIEWS, 4, 4))) for v in values]


def make(
    links: list[Link], *, modes: bool, loss: Loss | None = None, views: StackedViews | None = None
) -> ReprojectionFactor:
    stacked = views or stack(SCENE.observations.views)
    deform = TargetModes("m", np.stack([stacked.points, stacked.points[:, [2, 2, 0]]])) if modes else None
    return ReprojectionFactor(
        "r", model=SCENE.camera.model, camera="camera", links=links, views=stacked, modes=deform, loss=loss
    )


def arguments(links: list[Link], *, modes: bool) -> list[np.ndarray]:
    camera = np.tile(SCENE.camera.values, (VIEWS, 1))
    return [*values_for(links), camera, *([np.tile([0.01, -0.02], (VIEWS, 1))] if modes else [])]


@pytest.mark.parametrize("modes", [False, True], ids=["rigid", "modes"])
@pytest.mark.parametrize("name", LINKS)
def test_jacobians_against_central_differences(name: str, modes: bool) -> None:
    links = LINKS[name]
    factor, values = make(links, modes=modes), arguments(links, modes=modes)
    check_slopes(factor, values)


@pytest.mark.parametrize(
    "loss", [squared(), huber(1.0), cauchy(1.0), geman_mcclure(2.0)], ids=["l2", "huber", "cauchy", "gm"]
)
@pytest.mark.parametrize("modes", [False, True], ids=["rigid", "modes"])
@pytest.mark.parametrize("name", LINKS)
def test_compiled_blocks_equal_the_numpy_form(name: str, modes: bool, loss: Loss) -> None:
    links = LINKS[name]
    factor, values = make(links, modes=modes, loss=loss), arguments(links, modes=modes)
    compiled, plain = factor.blocks(values, sigma=0.2), Factor.blocks(factor, values, sigma=0.2)
    assert compiled.cost == pytest.approx(plain.cost, rel=1e-11)
    for a, b in zip(compiled.gradient, plain.gradient):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9 * np.abs(b).max())
    assert compiled.hessian.keys() == plain.hessian.keys()
    for key, block in plain.hessian.items():
        np.testing.assert_allclose(compiled.hessian[key], block, rtol=1e-9, atol=1e-11 * np.abs(block).max())


def elongated() -> StackedViews:
    """The scene's views, three of them less certain along a direction of each point's own."""
    views = []
    for i, view in enumerate(SCENE.observations.views):
        turn, long = RNG.uniform(0, np.pi, len(view)), RNG.uniform(1, 3, len(view))
        axis = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        C = 0.04 * (np.eye(2) + (long**2 - 1)[:, None, None] * axis[:, :, None] * axis[:, None, :])
        views.append(replace(view, covariance_px=C) if i < 3 else replace(view, sigma_px=np.full(len(view), 0.3)))
    return stack(views)


def test_whitening_is_the_root_of_the_information() -> None:
    views = elongated()
    assert views.whitening is not None
    C = [np.linalg.inv(W.T @ W) for W in views.whitening]
    # Relative: the trace of covariance over sigma^2 is 2, and I is what views without a covariance have.
    np.testing.assert_allclose(np.trace(np.array(C), axis1=1, axis2=2), 2.0, rtol=1e-12)
    np.testing.assert_array_equal(views.whitening[views.offsets[3] :], np.tile(np.eye(2), (2 * 20, 1, 1)))
    assert stack(SCENE.observations.views).whitening is None


@pytest.mark.parametrize("loss", [squared(), cauchy(1.0)], ids=["l2", "cauchy"])
@pytest.mark.parametrize("name", ["plain", "eye-in-hand"])
def test_blocks_of_points_with_covariances_are_those_of_whitened_residuals(name: str, loss: Loss) -> None:
    links, views = LINKS[name], elongated()
    factor, values = make(links, modes=True, loss=loss, views=views), arguments(links, modes=True)
    r, jacobians = factor.linearize(*values)
    W, sigma = views.whitening, 0.2
    assert W is not None
    white = np.einsum("nij,nj->ni", W, r) / (sigma * views.sigma[:, None])
    rho, slope = loss.evaluate(np.sum(white**2, axis=1))
    J = np.concatenate([np.einsum("nij,njk->nik", W, j) for j in jacobians], axis=2)
    J *= (np.sqrt(slope) / (sigma * views.sigma))[:, None, None]
    H = np.add.reduceat(np.einsum("nik,nil->nkl", J, J), views.offsets[:-1])
    g = np.add.reduceat(np.einsum("nik,ni->nk", J, np.sqrt(slope)[:, None] * white), views.offsets[:-1])
    for blocks in (factor.blocks(values, sigma=sigma), Factor.blocks(factor, values, sigma=sigma)):
        assert blocks.cost == pytest.approx(0.5 * rho.sum(), rel=1e-11)
        np.testing.assert_allclose(blocks.H, H, rtol=1e-8, atol=1e-10 * np.abs(H).max())
        np.testing.assert_allclose(blocks.g, g, rtol=1e-8, atol=1e-9 * np.abs(g).max())
    np.testing.assert_allclose(factor.whitened_norms(values, sigma=sigma), np.linalg.norm(white, axis=1), rtol=1e-9)


def test_influence_of_points_with_covariances_equals_its_numpy_form() -> None:
    links = LINKS["plain"]
    factor, values = make(links, modes=False, views=elongated()), arguments(links, modes=False)
    across = [RNG.normal(size=(VIEWS, 3, 6)), RNG.normal(size=(1, 3, len(SCENE.camera.values)))]
    compiled = factor.influence(across, values, weight=factor.weight)
    plain = Factor.influence(factor, across, values, weight=factor.weight)
    for a, b in zip(compiled, plain):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_every_model_through_the_kernels(model: object) -> None:
    """Values do not matter here, only that kernel and NumPy form agree for every registered model."""
    names = model.parameter_names  # type: ignore[attr-defined]
    some = {"fx": 800.0, "fy": 790.0, "cx": 640.0, "cy": 500.0, "f": 800.0}
    parameters = np.array([some.get(n, 0.01 if i % 2 else 0.02) for i, n in enumerate(names)])
    stacked = stack(SCENE.observations.views)
    factor = ReprojectionFactor("r", model=model, camera="camera", links=LINKS["plain"], views=stacked)  # type: ignore[arg-type]
    values = [SCENE.T_camera_target, np.tile(parameters, (VIEWS, 1))]
    r = factor.linearize(*values)[0]
    if not np.isfinite(r).all():
        pytest.skip("these parameters put points outside the model's field")
    np.testing.assert_allclose(factor.residuals(*values), r, atol=1e-8)
    compiled, plain = factor.blocks(values, sigma=1.0), Factor.blocks(factor, values, sigma=1.0)
    for key, block in plain.hessian.items():
        np.testing.assert_allclose(compiled.hessian[key], block, rtol=1e-8, atol=1e-10 * max(np.abs(block).max(), 1e-9))


def test_threads_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = intrinsics_scene(60, seed=1)
    stacked = stack(scene.observations.views)
    factor = make([Link("T", np.arange(60))], modes=False, views=stacked)
    values = [scene.T_camera_target, np.tile(scene.camera.values, (60, 1))]
    results = []
    for cores in (1, 2, 7):
        monkeypatch.setattr(pool, "cores", lambda n=cores: n)
        monkeypatch.setattr(pool, "SMALLEST_PIECE_SECONDS", 1e-9)
        blocks = factor.blocks(values, sigma=0.1)
        results.append((blocks.cost, *blocks.hessian.values(), *blocks.gradient, factor.residuals(*values)))
    for other in results[1:]:
        for a, b in zip(results[0], other):
            np.testing.assert_array_equal(a, b)


def test_a_camera_for_every_view() -> None:
    links = LINKS["plain"]
    stacked = stack(SCENE.observations.views)
    cameras = np.array([0, 1, 1, 0, 1])
    factor = ReprojectionFactor(
        "r", model=SCENE.camera.model, camera="camera", links=links, views=stacked, camera_indices=cameras
    )
    two = np.stack([SCENE.camera.values, SCENE.camera.values * 1.01])
    values = [SCENE.T_camera_target, two[cameras]]
    r = factor.residuals(*values)
    np.testing.assert_allclose(r, factor.linearize(*values)[0], atol=1e-9)
    compiled, plain = factor.blocks(values, sigma=1.0), Factor.blocks(factor, values, sigma=1.0)
    np.testing.assert_allclose(compiled.hessian[0, 1], plain.hessian[0, 1], rtol=1e-9, atol=1e-6)


def test_points_behind_the_camera_have_no_finite_cost() -> None:
    T = SCENE.T_camera_target.copy()
    T[2, 2, 3] = -1.0
    factor = make(LINKS["plain"], modes=False)
    camera = np.tile(SCENE.camera.values, (VIEWS, 1))
    assert not np.isfinite(factor.blocks([T, camera], sigma=1.0).cost)
    assert not np.isfinite(factor.residuals(T, camera)).all()
    problem = Problem(
        (
            Variable("T", SE3(), T, labels="abcde"),
            vector("camera", SCENE.camera.values, SCENE.camera.model.parameter_names),
        ),
        (factor,),
    )
    with pytest.raises(InputError, match=r"no finite residual in 'r' \(T c, camera\): a point lies behind the camera"):
        solve(problem)


def test_relative_sigmas_have_a_mean_weight_of_one() -> None:

    views = [
        replace(v, sigma_px=np.full(len(v), s)) for v, s in zip(SCENE.observations.views, (0.1, 0.2, 0.1, 0.3, 0.1))
    ]
    sigma = stack(views).sigma
    assert np.mean(sigma**-2) == pytest.approx(1.0)
    assert sigma[20] / sigma[0] == pytest.approx(2.0)


@pytest.mark.parametrize("name", LINKS)
def test_link_maps_are_derivatives_of_the_product(name: str) -> None:
    links = LINKS[name]
    values = values_for(links)
    T = product(links, values)
    for k, M in enumerate(link_maps(links, values)):
        for column, e in enumerate(np.eye(6)):
            v = list(values)
            v[k] = se3.retract(v[k], 1e-6 * e)
            ahead = se3.local(T, product(links, v)) / 1e-6
            np.testing.assert_allclose(np.broadcast_to(M, (VIEWS, 6, 6))[:, :, column], ahead, atol=1e-5)
