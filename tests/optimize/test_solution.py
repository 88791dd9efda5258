"""Covariances against the inverse of the dense matrix; undetermined directions by name."""

from __future__ import annotations

import numpy as np
import pytest
from dense import first_columns, system
from problems import SHAPES, Curve, bundle, curve

from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize import SE3, Euclidean, Problem, Solution, TranslationPrior, Variable, VectorPrior, solve, vector
from calibrant.optimize.factors import Factor


def dense_covariance(solution: Solution) -> tuple[np.ndarray, list[int]]:
    """Covariance of all natural tangents, and each variable's first row."""
    problem = solution.problem
    _, J = system(problem, solution.values)
    scale = 1 / np.linalg.norm(J, axis=0)
    C = np.linalg.inv((J * scale).T @ (J * scale)) * np.outer(scale, scale)
    starts, natural = first_columns(problem), [0]
    blocks = []
    for v, value, a in zip(problem.variables, solution.values, starts):
        basis = v.manifold.basis(value)
        for i in range(v.count):
            B = np.eye(v.free_dim) if basis is None else basis[i if len(basis) > 1 else 0]
            blocks.append((B, a + i * v.free_dim))
        natural.append(natural[-1] + v.count * len(v.manifold.natural_names))
    rows = []
    for B, a in blocks:
        row = np.zeros((len(B), len(C)))
        row[:, a : a + B.shape[1]] = B
        rows.append(row)
    all_rows = np.concatenate(rows)
    return all_rows @ C @ all_rows.T, natural


@pytest.mark.parametrize("shape", SHAPES)
def test_every_block_is_the_dense_inverse(shape: str) -> None:
    solution = solve(SHAPES[shape](11))
    C, starts = dense_covariance(solution)
    tolerance = 1e-7 * np.abs(C).max()
    for v, a in zip(solution.problem.variables, starts):
        k = len(v.manifold.natural_names)
        together = solution.covariances(v.name)
        for i in range(v.count):
            block = C[a + i * k : a + (i + 1) * k, a + i * k : a + (i + 1) * k]
            np.testing.assert_allclose(solution.covariance(v.name, i), block, rtol=1e-6, atol=tolerance)
            np.testing.assert_allclose(together[i], block, rtol=1e-6, atol=tolerance)


def test_joint_covariance_of_any_two() -> None:
    solution = solve(bundle(12))
    C, starts = dense_covariance(solution)
    size = {v.name: len(v.manifold.natural_names) for v in solution.problem.variables}
    first = {v.name: a for v, a in zip(solution.problem.variables, starts)}
    # Within a component, across components, component with shared, shared with shared, and back.
    picks = [("point", 3), ("pose", 2), ("point", 7), ("focal", 0), ("pose", 0)]
    rows = np.concatenate([first[n] + i * size[n] + np.arange(size[n]) for n, i in picks])
    joint = solution.joint_covariance(picks)
    np.testing.assert_allclose(joint, C[np.ix_(rows, rows)], rtol=1e-6, atol=1e-8 * np.abs(C).max())
    np.testing.assert_allclose(joint, joint.T, atol=1e-12 * np.abs(C).max())


def test_constants_and_held_components_have_no_variance() -> None:
    x = np.linspace(0, 3, 20)
    abc = Variable("abc", Euclidean(("a", "b", "c"), held=("b",)), np.array([[2.0, -1, 0.1]]))
    solution = solve(Problem((abc,), (Curve(x, 2 * np.exp(-x) + 0.1 * np.cos(9 * x)),)))
    C = solution.covariance("abc")
    assert np.all(C[1] == 0)
    assert C[0, 0] > 0


def test_unknown_names_and_instances() -> None:
    solution = solve(curve(0))
    with pytest.raises(InputError, match="no variable 'x'"):
        solution.covariance("x")
    with pytest.raises(InputError, match="has 1 instances, asked for number 4"):
        solution.covariance("abc", 4)
    with pytest.raises(InputError, match="no factor 'x'"):
        solution.residuals("x")


def test_a_flat_direction_is_named_and_has_no_covariance() -> None:
    # Only a + b is measured.
    prior = VectorPrior("sum", "ab", 0, np.array([0.0, 0.0]), sqrt_information=np.array([[1.0, 1.0]]))
    solution = solve(Problem((vector("ab", [1.0, 2.0], ("gain", "offset")),), (prior,)))
    assert solution.cost < 1e-20
    (direction,) = solution.unobservable
    assert {name for name, _ in direction.components} == {"gain of ab", "offset of ab"}
    shares = dict(direction.components)
    assert shares["gain of ab"] == pytest.approx(-shares["offset of ab"])
    with pytest.raises(RefusedError, match=r"gain with offset of ab|offset with gain of ab"):
        solution.covariance("ab")


def test_directions_speak_the_problems_words() -> None:
    # Two heights that only appear as their difference: nothing says where both are.
    mounted = Variable(
        "X", SE3(), np.eye(4)[None], words="the camera on the flange", hint="turn the flange about another axis"
    )
    place = TranslationPrior("position", "X", np.eye(4)[None], noise="mm")
    flat = Problem((mounted,), (place,), {"mm": 1.0})
    messages = [u.message for u in solve(flat).unobservable]
    assert len(messages) == 3
    assert all("the rotation about" in m and "of the camera on the flange" in m for m in messages)
    assert all(m.endswith(": turn the flange about another axis") for m in messages)


def test_weak_components_are_named_by_their_label() -> None:
    T = np.tile(np.eye(4), (3, 1, 1))
    poses = Variable("T", SE3(), T, labels=("a.png", "b.png", "c.png"), words="the board in")
    # Positions only: the rotations of every pose are free, and poses are eliminated.
    problem = Problem((poses, vector("t", [0.0], "t")), (
        TranslationPrior("position", "T", T, noise="mm"),
        VectorPrior("t", "t", 0, np.zeros(1), sqrt_information=np.eye(1)),
    ))  # fmt: skip
    solution = solve(problem)
    assert "rotation x of the board in a.png" in solution.unobservable[0].message
    assert len(solution.unobservable) == 3


def test_near_singular_is_not_singular() -> None:
    # Condition 1e4 in the unknowns: determined, if badly.
    root = np.array([[1.0, 1.0], [1e-4, -1e-4]])
    solution = solve(Problem((vector("ab", [1.0, 2.0], "ab"),), (
        VectorPrior("p", "ab", 0, np.zeros(2), sqrt_information=root),
    )))  # fmt: skip
    assert not solution.unobservable
    np.testing.assert_allclose(solution.covariance("ab"), np.linalg.inv(root.T @ root), rtol=1e-6)


def test_pose_covariance_belongs_to_its_chart() -> None:
    """Positions of a pose rotated by a prior: the covariance along the parent's axes is the prior's."""
    T = se3.exp(np.array([[0.3, -0.8, 0.5, 0.1, 0.2, 0.3]]))
    problem = bundle(13)
    solution = solve(problem)
    assert solution.covariance("pose", 0).shape == (6, 6)
    alone = Problem((Variable("T", SE3(), T),), (TranslationPrior("t", "T", T, noise="t"),), {"t": 0.5})
    assert len(solve(alone).unobservable) == 3


class Linear(Factor):
    """r = A_i own_i + B_i shared, i = 1 ... n: every condition of the normal equations can be had."""

    def __init__(self, A: np.ndarray, B: np.ndarray) -> None:
        self.A, self.B = A, B
        edges = np.arange(len(A))
        super().__init__("linear", variables=("own", "all"), indices=(edges, 0 * edges), dim=A.shape[1], noise="unit")

    def linearize(self, *values: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        own, shared = values
        return np.einsum("nmb,nb->nm", self.A, own) + np.einsum("nms,ns->nm", self.B, shared), (self.A, self.B)


def linear_problem(A: np.ndarray, B: np.ndarray) -> Problem:
    own = Variable("own", Euclidean(tuple("abcdef")), np.zeros((len(A), 6)))
    shared = vector("all", np.zeros(B.shape[2]), tuple(f"s{i}" for i in range(B.shape[2])))
    return Problem((own, shared), (Linear(A, B),))


def random_views(views: int, shared: int, condition: float) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    """Jacobians of views whose own six unknowns have the given condition, and of unknowns in units of all sizes."""
    rng = np.random.default_rng(views + shared)
    rows = 16 + 3 * shared // views
    A = rng.standard_normal((views, rows, 6))
    A[:, :, 1] = A[:, :, 0] + A[:, :, 1] / np.sqrt(condition)
    return A, rng.standard_normal((views, rows, shared)) * 10 ** rng.uniform(-3, 3, shared), rng


@pytest.mark.parametrize("views", [5, 50])
@pytest.mark.parametrize("shared", [4, 12, 60])
@pytest.mark.parametrize("condition", [1e0, 1e3, 1e6])
def test_an_exact_gauge_is_found_whatever_the_condition(views: int, shared: int, condition: float) -> None:
    A, B, rng = random_views(views, shared, condition)
    # The last column follows from the others, through the components' weak direction, which amplifies rounding.
    weak = np.sqrt(condition) * rng.standard_normal(views)
    B[:, :, -1] = B[:, :, :-1] @ rng.standard_normal(shared - 1) + (A[:, :, 0] - A[:, :, 1]) * weak[:, None]
    assert len(solve(linear_problem(A, B)).unobservable) == 1


@pytest.mark.parametrize("shared", [4, 12, 60])
def test_collinear_but_determined_columns_are_not_refused(shared: int) -> None:
    """Two terms a millionth apart: an eigenvalue of 1e-12, fifty times rounding and more. sigma is right to a digit."""
    A, B, rng = random_views(50, shared, 1e1)
    apart = 1e-6 * rng.standard_normal(B.shape[:2])
    B[:, :, -1] = B[:, :, -2] * (1 + apart)
    solution = solve(linear_problem(A, B))
    assert not solution.unobservable
    # What the last two differ in says the last, after all others have taken their part of it.
    others = np.zeros((50 * B.shape[1], 50 * 6 + shared - 1))
    for i, block in enumerate(A):
        others[i * len(block) : (i + 1) * len(block), 6 * i : 6 * i + 6] = block
    others[:, 300:] = B[:, :, :-1].reshape(len(others), -1) / np.abs(B[:, :, :-1]).max(axis=(0, 1))
    difference = (B[:, :, -2] * apart).reshape(-1)
    left = difference - others @ np.linalg.lstsq(others, difference, rcond=None)[0]
    assert solution.covariance("all")[-1, -1] == pytest.approx(1 / (left @ left), rel=0.2)
