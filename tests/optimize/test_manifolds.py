"""Charts: what the solver steps along, and that `basis` is the derivative of `retract`."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize import SE3, SO3, Euclidean, Interval, Manifold, Positive, Subspace, Variable, vector

RNG = np.random.default_rng(5)
NAMES = ("a", "b", "c")
CASES: dict[str, tuple[Manifold, np.ndarray]] = {
    "euclidean": (Euclidean(NAMES), RNG.normal(size=(4, 3))),
    "held": (Euclidean(NAMES, held=("b",)), RNG.normal(size=(4, 3))),
    "subspace": (Subspace(NAMES, np.array([[1.0], [2], [0]]), ("a with b",)), RNG.normal(size=(4, 3))),
    "positive": (Positive(NAMES), RNG.uniform(0.1, 9, (4, 3))),
    "interval": (Interval(NAMES, np.zeros(3), np.array([1.0, 2, 3])), RNG.uniform(0.1, 0.9, (4, 3)) * [1, 2, 3]),
    "se3": (SE3(), se3.exp(RNG.normal(size=(4, 6)))),
    "so3": (SO3(), so3.exp(RNG.normal(size=(4, 3)))),
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Manifold, np.ndarray]:
    return CASES[request.param]


def test_no_step_stays(case: tuple[Manifold, np.ndarray]) -> None:
    manifold, values = case
    moved = manifold.retract(values, np.zeros((4, len(manifold.free_names))))
    np.testing.assert_allclose(moved, values, atol=1e-14)
    np.testing.assert_allclose(manifold.local(values, values), 0, atol=1e-14)


def test_basis_is_the_derivative_of_retract(case: tuple[Manifold, np.ndarray]) -> None:
    manifold, values = case
    free, natural = len(manifold.free_names), len(manifold.natural_names)
    basis = manifold.basis(values)
    expected = np.broadcast_to(np.eye(natural)[None] if basis is None else basis, (4, natural, free))
    h = 1e-6
    for k, e in enumerate(np.eye(free)):
        ahead, behind = (manifold.retract(values, s * h * np.tile(e, (4, 1))) for s in (1, -1))
        difference = (manifold.local(values, ahead) - manifold.local(values, behind)) / (2 * h)
        # Truncation h^2, rounding 1e-15 / h.
        np.testing.assert_allclose(difference, expected[:, :, k], atol=1e-8)


def test_bounds_hold_for_any_step() -> None:
    manifold, values = CASES["interval"]
    for size in (1e3, -1e3, 30.0):
        moved = manifold.retract(values, np.full((4, 3), size))
        assert np.all((moved >= 0) & (moved <= [1, 2, 3]))
    positive, scales = CASES["positive"]
    assert np.all(positive.retract(scales, np.full((4, 3), -50.0)) > 0)


def test_held_components_do_not_move() -> None:
    manifold, values = CASES["held"]
    moved = manifold.retract(values, np.ones((4, 2)))
    np.testing.assert_array_equal(moved[:, 1], values[:, 1])
    np.testing.assert_allclose(moved[:, [0, 2]], values[:, [0, 2]] + 1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Euclidean(NAMES, held=("z",)), "cannot hold z.*a, b, c"),
        (lambda: Variable("x", Euclidean(NAMES), np.zeros((2, 4))), r"\(count, 3\)"),
        (lambda: Variable("x", Euclidean(NAMES), np.zeros((0, 3))), "count >= 1"),
        (lambda: vector("x", [1, np.nan, 2], NAMES), "NaN"),
        (lambda: Variable("s", Positive(("s",)), np.array([[0.0]])), "above 0"),
        (lambda: Variable("s", Interval(("s",), np.zeros(1), np.ones(1)), np.array([[1.0]])), "inside its bounds"),
    ],
)
def test_bad_variables_are_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]


def test_words_of_a_pose_name_its_axis() -> None:
    share = np.array([0, 0, 0, 0.1, 0, 0.9])
    assert SE3().describe(np.array([0, 0, 0, 0.01, 0, 1.0]), share) == "the position along z"
    oblique = SE3().describe(np.array([1.0, 0, 1, 0, 0, 0]), np.array([0.7, 0, 0.7, 0, 0, 0]))
    assert oblique == "the rotation about (0.71, 0.00, 0.71)"


def test_labels() -> None:
    poses = Variable("T", SE3(), np.tile(np.eye(4), (2, 1, 1)), labels=("a.png", "b.png"), words="the board in")
    assert poses.label(1) == "the board in b.png"
    assert vector("k", [1, 2, 3], NAMES).label(0) == "k"
