"""Closed-form solvers: exact without noise, no worse than OpenCV's with noise, refusing what motions cannot tell."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrant.calibrate.solvers import SOLVERS, get_solver
from calibrant.calibrate.solvers import convex as convex_module
from calibrant.calibrate.solvers.kronecker import linear_system
from calibrant.calibrate.solvers.loop_errors import loop_errors
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]

NAMES = sorted(SOLVERS)
OPENCV_HAND_EYE = {
    "tsai": "CALIB_HAND_EYE_TSAI",
    "park": "CALIB_HAND_EYE_PARK",
    "horaud": "CALIB_HAND_EYE_HORAUD",
    "andreff": "CALIB_HAND_EYE_ANDREFF",
    "daniilidis": "CALIB_HAND_EYE_DANIILIDIS",
}
OPENCV_ROBOT_WORLD = {"shah": "CALIB_ROBOT_WORLD_HAND_EYE_SHAH", "li": "CALIB_ROBOT_WORLD_HAND_EYE_LI"}


def problem(rng: np.random.Generator, R_A: Array) -> tuple[Array, Array, Array, Array]:
    """A, B, X, Z with A_i X B_i = Z exactly, for robot rotations (n, 3, 3) and a random X and Z."""
    A = se3.make(R_A, rng.normal(scale=0.3, size=(len(R_A), 3)))
    X, Z = se3.make(so3.random(rng, 2), rng.normal(scale=0.3, size=(2, 3)))
    return A, se3.inverse(X) @ se3.inverse(A) @ Z, X, Z


def noisy(rng: np.random.Generator, T: Array, deg: float, mm: float) -> Array:
    """Poses with Gaussian noise per axis."""
    n = len(T)
    omega, v = rng.normal(scale=np.deg2rad(deg), size=(n, 3)), rng.normal(scale=mm * 1e-3, size=(n, 3))
    return se3.retract(T, np.concatenate([omega, v], axis=1))


def assert_solves(name: str, scene: tuple[Array, Array, Array, Array], tolerance: float = 1e-9) -> None:
    A, B, X, Z = scene
    solution = SOLVERS[name].solve(A, B)
    np.testing.assert_allclose(solution.X, X, atol=tolerance)
    np.testing.assert_allclose(solution.Z, Z, atol=tolerance)


@pytest.mark.parametrize("name", NAMES)
class TestExactWithoutNoise:
    def test_random_poses(self, name: str) -> None:
        rng = np.random.default_rng(1)
        for n in (3, 3, 3, 4, 5, 8, 15, 30, 50):
            assert_solves(name, problem(rng, so3.random(rng, n)))

    def test_small_motions(self, name: str) -> None:
        # 3 degrees: methods that square the motion twice (Shah, Dornaika) keep eps / theta^4 = 3e-11.
        rng = np.random.default_rng(2)
        for n in (5, 10, 20):
            assert_solves(name, problem(rng, so3.random(rng, 1) @ so3.exp(rng.normal(scale=0.05, size=(n, 3)))))

    def test_relative_rotations_near_half_turns(self, name: str) -> None:
        rng = np.random.default_rng(3)
        for off in (0.03, 1e-3):
            axes = rng.normal(size=(8, 3))
            turns = so3.exp((np.pi - off * rng.random((8, 1))) * axes / np.linalg.norm(axes, axis=1, keepdims=True))
            assert_solves(name, problem(rng, np.concatenate([np.eye(3)[None], turns])))

    def test_camera_turned_by_half_a_turn(self, name: str) -> None:
        rng = np.random.default_rng(4)
        A, _, _, Z = problem(rng, so3.random(rng, 10))
        for diagonal in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1, 1, 1]):
            X = se3.make(np.diag(np.array(diagonal, dtype=float)), [0.1, -0.02, 0.05])
            assert_solves(name, (A, se3.inverse(X) @ se3.inverse(A) @ Z, X, Z))

    def test_repeated_poses(self, name: str) -> None:
        rng = np.random.default_rng(5)
        A, B, X, Z = problem(rng, so3.random(rng, 4))
        again = [0, 0, 0, 1, 2, 2, 3, 3, 3, 3]
        assert_solves(name, (A[again], B[again], X, Z))

    def test_target_and_camera_at_their_origins(self, name: str) -> None:
        rng = np.random.default_rng(6)
        A, _, _, _ = problem(rng, so3.random(rng, 6))
        assert_solves(name, (A, se3.inverse(A), np.eye(4), np.eye(4)))

    def test_rotation_without_translation_of_the_robot(self, name: str) -> None:
        rng = np.random.default_rng(7)
        A = se3.make(so3.random(rng, 6), np.zeros(3))
        X, Z = se3.make(so3.random(rng, 2), rng.normal(size=(2, 3)))
        assert_solves(name, (A, se3.inverse(X) @ se3.inverse(A) @ Z, X, Z))

    def test_many_poses_use_a_part_of_the_pairs(self, name: str) -> None:
        rng = np.random.default_rng(8)
        scene = problem(rng, so3.random(rng, 1000))
        started = time.perf_counter()
        assert_solves(name, scene)
        # 0.05 s on an idle core; the bound is the promise (0.2 s) with room for a busy machine.
        assert time.perf_counter() - started < 1.0

    def test_lengths_scale_with_the_unit(self, name: str) -> None:
        """The answer in millimetres is the answer in metres: no method may mix radians and lengths by their numbers."""
        rng = np.random.default_rng(9)
        A, B, _, _ = problem(rng, so3.random(rng, 12))
        A, B = noisy(rng, A, 0.05, 0.2), noisy(rng, B, 0.05, 0.5)
        scale = np.ones((4, 4))
        scale[:3, 3] = 20.0
        metres, other = SOLVERS[name].solve(A, B), SOLVERS[name].solve(A * scale, B * scale)
        np.testing.assert_allclose(other.X, metres.X * scale, atol=1e-7)


@pytest.mark.parametrize("name", NAMES)
class TestRefusals:
    def test_parallel_axes(self, name: str) -> None:
        rng = np.random.default_rng(10)
        axis = np.array([0.02, 0.99, 0.1]) / np.linalg.norm([0.02, 0.99, 0.1])
        A, B, _, _ = problem(rng, so3.exp(rng.uniform(-2, 2, size=(15, 1)) * axis))
        for deg, mm in ((0.0, 0.0), (0.05, 0.3)):
            with pytest.raises(RefusedError, match=r"parallel-axes: .*one axis \(0\.02, 0\.99, 0\.10\)"):
                SOLVERS[name].solve(noisy(rng, A, deg / 5, mm / 5), noisy(rng, B, deg, mm))

    def test_pure_translation(self, name: str) -> None:
        rng = np.random.default_rng(11)
        A, B, _, _ = problem(rng, np.broadcast_to(so3.random(rng, 1), (15, 3, 3)))
        for deg, mm in ((0.0, 0.0), (0.05, 0.3)):
            with pytest.raises(RefusedError, match="pure-translation: the poses do not rotate"):
                SOLVERS[name].solve(noisy(rng, A, deg / 5, mm / 5), noisy(rng, B, deg, mm))

    def test_fewer_than_three_distinct_poses(self, name: str) -> None:
        rng = np.random.default_rng(12)
        A, B, _, _ = problem(rng, so3.random(rng, 2))
        with pytest.raises(RefusedError, match="poses: 2 distinct poses"):
            SOLVERS[name].solve(A, B)
        with pytest.raises(RefusedError, match=r"poses: 2 distinct poses \(6 given"):
            SOLVERS[name].solve(A[[0, 1, 0, 1, 0, 1]], B[[0, 1, 0, 1, 0, 1]])
        with pytest.raises(RefusedError, match="poses: 0 distinct"):
            SOLVERS[name].solve(A[:0], B[:0])

    def test_perpendicular_half_turns_leave_four_answers(self, name: str) -> None:
        rng = np.random.default_rng(13)
        turns = np.array([np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])])
        A, B, _, _ = problem(rng, so3.random(rng, 1) @ turns)
        with pytest.raises(RefusedError, match="half-turns"):
            SOLVERS[name].solve(A, B)

    def test_bad_input_is_named(self, name: str) -> None:
        rng = np.random.default_rng(14)
        A, B, _, _ = problem(rng, so3.random(rng, 5))
        with pytest.raises(InputError, match="5 poses A of the robot but 4 poses B"):
            SOLVERS[name].solve(A, B[:4])
        with pytest.raises(InputError, match="shape"):
            SOLVERS[name].solve(A[0], B[0])
        broken = A.copy()
        broken[2, 0, 3] = np.nan
        with pytest.raises(InputError, match=r"A\[2\] holds NaN"):
            SOLVERS[name].solve(broken, B)
        mirrored = B.copy()
        mirrored[1, :3, 0] *= -1
        with pytest.raises(InputError, match=r"B\[1\].*determinant -1"):
            SOLVERS[name].solve(A, mirrored)


class TestFaultyData:
    """One wrong view, or all of them, must show: in a refusal or in the loop, never as a small number."""

    @pytest.mark.parametrize("name", NAMES)
    def test_shifted_pairs_show_in_the_loop(self, name: str) -> None:
        rng = np.random.default_rng(15)
        A, B, _, _ = problem(rng, so3.random(rng, 15))
        try:
            solution = SOLVERS[name].solve(A, np.roll(B, 1, axis=0))
        except RefusedError:
            return
        assert loop_errors(A, np.roll(B, 1, axis=0), solution.X).rms_deg > 10

    @pytest.mark.parametrize("name", NAMES)
    def test_one_flipped_board_does_not_break_a_method(self, name: str) -> None:
        """One of 15 boards turned by 180 degrees about its normal, 0.3 m off: refused, or near the others."""
        rng = np.random.default_rng(16)
        A, B, X, _ = problem(rng, so3.random(rng, 15))
        B[4] = B[4] @ se3.make(np.diag([-1.0, -1.0, 1.0]), [0.3, 0.2, 0.0])
        try:
            solution = SOLVERS[name].solve(A, B)
        except RefusedError:
            return
        # A fifteenth of the views is wrong by 0.36 m: least squares may be off by some times 0.36 / 15 = 24 mm.
        assert np.linalg.norm(solution.X[:3, 3] - X[:3, 3]) < 0.15

    def test_screw_checks_leave_the_flipped_board_out(self) -> None:
        rng = np.random.default_rng(17)
        A, B, X, _ = problem(rng, so3.random(rng, 15))
        B[4] = B[4] @ se3.make(np.diag([-1.0, -1.0, 1.0]), [0.3, 0.2, 0.0])
        solution = SOLVERS["daniilidis-screw"].solve(A, B)
        np.testing.assert_allclose(solution.X, X, atol=1e-9)  # the other motions are exact


def test_the_linear_system_is_that_of_its_rows() -> None:
    """Triangle and equations have the same normal equations: every least squares with them is the same."""
    rng = np.random.default_rng(23)
    A, B, _, _ = problem(rng, so3.random(rng, 9))
    pairs = PosePairs(A, noisy(rng, B, 2.0, 20.0))
    m, length = pairs.motions, pairs.length
    blocks, known = [], []
    for a, b in zip(m.A, m.B):
        turns = np.hstack([np.eye(9) - np.kron(a[:3, :3], b[:3, :3]), np.zeros((9, 3))])
        moves = np.hstack([np.kron(np.eye(3), b[:3, 3] / length), np.eye(3) - a[:3, :3]])
        blocks += [turns, moves]
        known += [np.zeros(9), a[:3, 3] / length]
    wanted = np.column_stack([np.concatenate(blocks), np.concatenate(known)])
    rows, right = linear_system(pairs)
    found = np.column_stack([rows, right])
    np.testing.assert_allclose(found.T @ found, wanted.T @ wanted, atol=1e-12 * np.sum(wanted**2))


class TestConvex:
    @pytest.mark.parametrize("noise_deg", [0.1, 5.0, 40.0])
    def test_no_start_finds_a_better_rotation(self, noise_deg: float) -> None:
        """Local searches from 30 rotations of the cost that the method claims to minimise globally."""
        rng = np.random.default_rng(18)
        A, B, _, _ = problem(rng, so3.random(rng, 6))
        B = noisy(rng, B, noise_deg, 10 * noise_deg)
        pairs = PosePairs(A, B)
        rows, known = linear_system(pairs)

        def residual(pose: Array, R_start: Array) -> Array:
            R = so3.exp(pose[:3]) @ R_start
            out: Array = rows @ np.concatenate([R.reshape(-1), pose[3:]]) - known
            return out

        starts = so3.random(rng, 30)
        costs = [2 * least_squares(residual, np.zeros(6), args=(R,)).cost for R in starts]
        X = SOLVERS["convex"].estimate(pairs)[0]
        best = np.sum(residual(np.concatenate([np.zeros(3), X[:3, 3] / pairs.length]), X[:3, :3]) ** 2)
        assert best <= min(costs) * (1 + 1e-6)

    def test_unproven_optimum_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A rotation that does not reach the bound is not returned: here because the barrier stops much too early."""
        rng = np.random.default_rng(19)
        A, B, _, _ = problem(rng, so3.random(rng, 10))
        monkeypatch.setattr(convex_module, "BARRIER_END", 1e-2)
        with pytest.raises(RefusedError, match="lower bound"):
            SOLVERS["convex"].solve(A, B)


def opencv_solution(name: str, A: Array, B: Array) -> Array:
    """X by OpenCV's function of the same method."""
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "calibrateHandEye"):
        pytest.skip(f"OpenCV {cv2.__version__} has no calibrateHandEye")
    if name in OPENCV_HAND_EYE:
        method = getattr(cv2, OPENCV_HAND_EYE[name])
        R, t = cv2.calibrateHandEye(A[:, :3, :3], A[:, :3, 3], B[:, :3, :3], B[:, :3, 3], method=method)
        return se3.make(R, t[:, 0])
    method = getattr(cv2, OPENCV_ROBOT_WORLD[name])
    inverse = se3.inverse(A)
    views = [list(T[:, :3, part]) for T in (B, inverse) for part in (slice(3), 3)]
    _, _, R, t = cv2.calibrateRobotWorldHandEye(*views, method=method)
    return se3.inverse(se3.make(R, t[:, 0]))


@pytest.mark.parametrize("name", [*OPENCV_HAND_EYE, *OPENCV_ROBOT_WORLD])
class TestAgainstOpenCV:
    def test_agree_on_clean_data(self, name: str) -> None:
        rng = np.random.default_rng(20)
        A, B, _, _ = problem(rng, so3.exp(rng.normal(scale=0.4, size=(12, 3))))
        np.testing.assert_allclose(SOLVERS[name].solve(A, B).X, opencv_solution(name, A, B), atol=1e-6)

    @pytest.mark.statistics
    @pytest.mark.parametrize(
        ("spread", "robot", "camera"), [(0.4, (0.03, 0.1), (0.05, 0.5)), (0.8, (0.2, 1.0), (0.1, 1.0))]
    )
    def test_no_worse_with_noise(
        self, name: str, spread: float, robot: tuple[float, float], camera: tuple[float, float]
    ) -> None:
        """RMS over 40 problems of 15 poses. 1.05: ratios of RMS errors on the same data scatter by some per cent."""
        rng = np.random.default_rng(21)
        errors: list[tuple[Array, Array]] = []
        for _ in range(40):
            A, B, X, _ = problem(rng, so3.exp(rng.normal(scale=spread, size=(15, 3))))
            A, B = noisy(rng, A, *robot), noisy(rng, B, *camera)
            errors.append((se3.local(X, SOLVERS[name].solve(A, B).X), se3.local(X, opencv_solution(name, A, B))))
        ours, theirs = np.sqrt(np.mean(np.square(errors), axis=0))
        assert np.linalg.norm(ours[:3]) < 1.05 * np.linalg.norm(theirs[:3])
        assert np.linalg.norm(ours[3:]) < 1.05 * np.linalg.norm(theirs[3:])


@pytest.mark.parametrize("name", NAMES)
def test_real_eye_to_hand_poses(name: str, shared_data: Callable[[str], Path]) -> None:
    samples = np.array(json.loads((shared_data("handeye_moveit_poses") / "pose_samples.json").read_text()))
    A, B = se3.inverse(se3.check(samples[:, 0], name="poses")), samples[:, 1]
    solution = SOLVERS[name].solve(A, B)
    # The published figures of Park's method; 1.5 mm is the spread that the data's noise leaves between methods.
    np.testing.assert_allclose(1e3 * solution.X[:3, 3], [659.5, -250.1, 830.3], atol=1.5)
    loop = loop_errors(A, B, solution.X)
    assert loop.rms_mm == pytest.approx(4.6, abs=0.05)
    assert loop.rms_deg == pytest.approx(0.089, abs=0.008)


@pytest.mark.parametrize("name", NAMES)
def test_real_poses_with_the_wrong_setup_do_not_close(name: str, shared_data: Callable[[str], Path]) -> None:
    samples = np.array(json.loads((shared_data("handeye_moveit_poses") / "pose_samples.json").read_text()))
    try:
        solution = SOLVERS[name].solve(samples[:, 0], samples[:, 1])
    except RefusedError:
        return
    assert loop_errors(samples[:, 0], samples[:, 1], solution.X).rms_mm > 100


def test_unknown_solver_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'parc'.*park"):
        get_solver("parc")
    assert get_solver("park") is SOLVERS["park"]


def test_every_solver_names_its_paper() -> None:
    for name, solver in SOLVERS.items():
        assert solver.name == name
        assert any(character.isdigit() for character in solver.paper)
