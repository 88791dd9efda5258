"""The offset between two clocks, from simulated continuous motion."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.clocks.offset import LOOP_ROTATION, LOOP_TRANSLATION, _LoopFactor, estimate_time_offset
from calibrant.calibrate.clocks.start import PoseSpline
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

X = se3.exp([0.3, -0.2, 0.5, 0.03, -0.05, 0.1])
Z = se3.exp([2.9, 0.1, 0.2, 0.6, 0.1, 0.0])


def gripper(t: np.ndarray) -> np.ndarray:
    """A smooth sweep about all axes: up to a radian a second and half a metre a second."""
    w = np.stack([0.5 * np.sin(1.3 * t) + 0.1 * t, 0.4 * np.sin(0.9 * t + 1), 0.5 * np.cos(1.7 * t)], axis=-1)
    p = np.stack([0.5 + 0.15 * np.sin(1.1 * t), 0.2 * np.cos(0.8 * t), 0.4 + 0.1 * np.sin(1.9 * t)], axis=-1)
    return se3.make(so3.exp(w), p)


def recording(
    offset: float, *, setup: str = "eye-in-hand", seed: int = 0, mm: float = 0.2, deg: float = 0.02
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Robot at 125 Hz, camera at 30 frames a second for 8 s, its clock behind by `offset`."""
    rng = np.random.default_rng(seed)
    t_robot = np.arange(-1.0, 10.0, 0.008)
    t_true = np.arange(0.5, 8.5, 1 / 30) + rng.uniform(0, 1e-3)
    A = gripper(t_true)
    A = A if setup == "eye-in-hand" else se3.inverse(A)
    B = se3.inverse(X) @ se3.inverse(A) @ Z
    noise = rng.normal(size=(len(B), 6)) * np.repeat([np.deg2rad(deg), 1e-3 * mm], 3)
    return t_robot, gripper(t_robot), t_true - offset, se3.retract(B, noise)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("offset", [0.0, 0.0431, -0.731])
def test_the_offset_is_found(offset: float, setup: str) -> None:
    found = estimate_time_offset(*recording(offset, setup=setup), setup=setup)
    assert abs(found.offset - offset) < 4 * found.sigma
    assert found.sigma < 1e-3
    delta = se3.local(X, found.camera.matrix)
    assert np.linalg.norm(delta[3:]) < 1e-3
    if offset:
        assert found.at_zero_mm > 3 * found.rms_mm


def test_without_noise_it_is_exact() -> None:
    found = estimate_time_offset(*recording(0.1234, mm=0, deg=0))
    # The spline's own error: fourth derivatives of size 10 times (8 ms)^4 / 100.
    assert abs(found.offset - 0.1234) < 1e-6


@pytest.mark.statistics
@pytest.mark.parametrize(("robot_hz", "camera_hz"), [(125, 30), (25, 50)])
def test_the_sigma_tells_the_truth(robot_hz: float, camera_hz: float) -> None:
    # Where the robot reports less often than the camera sees, neighbouring residuals share the robot's noise.
    squares = []
    for seed in range(16):
        rng = np.random.default_rng([seed, 5])
        t_robot, t = np.arange(-1.0, 7.0, 1 / robot_hz), np.arange(0.5, 5.5, 1 / camera_hz) + rng.uniform(0, 0.02)
        B = se3.inverse(X) @ se3.inverse(gripper(t)) @ Z
        B = se3.retract(B, rng.normal(size=(len(t), 6)) * [1e-3, 1e-3, 2e-4, 1e-4, 1e-4, 5e-4])
        reported = se3.retract(gripper(t_robot), 3e-4 * rng.normal(size=(len(t_robot), 6)))
        found = estimate_time_offset(t_robot, reported, t - 0.05, B, largest=0.3)
        squares.append(((found.offset - 0.05) / found.sigma) ** 2)
    # 16 degrees of freedom: 0.1 % lie outside on either side, with room for the estimated sigma's own scatter.
    assert 0.2 < np.mean(squares) < 2.6


def recorded(rotation: np.ndarray, position: np.ndarray, t_robot: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """A recording of the motion given by rotation vectors and positions at all times, the camera 50 ms behind."""
    A = se3.make(so3.exp(rotation), position)
    n = len(t_robot)
    rng = np.random.default_rng(0)
    B = se3.retract(se3.inverse(X) @ se3.inverse(A[n:]) @ Z, 2e-4 * rng.standard_normal((len(t), 6)))
    return t_robot, A[:n], t - 0.05, B


def test_motions_that_do_not_tell_are_refused_by_name() -> None:
    t_robot, t = np.arange(0, 8, 0.01), np.arange(1, 7, 0.033)
    s = np.concatenate([t_robot, t])
    zero, still = np.zeros_like(s), np.tile([0.5, 0.0, 0.4], (len(s), 1))
    even = np.stack([0.4 * np.sin(2 * s), 0.4 * np.cos(2 * s), zero], axis=-1)
    with pytest.raises(RefusedError, match=r"the gripper turns evenly, at .* speeds up and slows down"):
        estimate_time_offset(*recorded(even, still, t_robot, t))
    w = 2 * np.pi * s
    again = 0.4 * np.stack([np.sin(w), np.cos(w), np.sin(w + 1)], axis=-1)
    round_ = still + 0.1 * np.stack([np.sin(w), np.cos(w), zero], axis=-1)
    with pytest.raises(RefusedError, match=r"the motion repeats: offsets of .* fit alike; .*--largest 500ms"):
        estimate_time_offset(*recorded(again, round_, t_robot, t))
    # The speed repeats twice as often as the motion: the loop tells the right half.
    found = estimate_time_offset(*recorded(again, round_, t_robot, t), largest=0.6)
    assert abs(found.offset - 0.05) < 1e-3
    one = np.stack([zero, zero, 0.5 * np.sin(1.3 * s) + 0.2 * np.sin(2.9 * s)], axis=-1)
    with pytest.raises(RefusedError, match="all rotations turn about one axis"):
        estimate_time_offset(*recorded(one, round_, t_robot, t))


@pytest.mark.long
@pytest.mark.parametrize(("setup", "other"), [("eye-in-hand", "eye-to-hand"), ("eye-to-hand", "eye-in-hand")])
def test_a_loop_that_does_not_close_is_refused(setup: str, other: str) -> None:
    with pytest.raises(RefusedError, match=f"does not close: .* mounted otherwise .--setup {setup}"):
        estimate_time_offset(*recording(0.05, setup=setup), setup=other)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("noise", [LOOP_ROTATION, LOOP_TRANSLATION])
def test_derivatives_are_differences(noise: str, inverted: bool) -> None:
    t_robot, T, t, B = recording(0.02, mm=5, deg=1)
    factor = _LoopFactor("loop", PoseSpline(t_robot, T), t[:5], B[:5], inverted=inverted, noise=noise)
    values = [np.tile(X, (5, 1, 1)), np.tile(Z, (5, 1, 1)), np.full((5, 1), 0.02)]
    if inverted:
        values[1] = np.tile(se3.inverse(gripper(t[:1] + 0.02))[0] @ X @ B[0], (5, 1, 1))
    J = factor.linearize(*values)[1]
    step = 1e-6
    for slot, columns in enumerate((6, 6, 1)):
        for k in range(columns):
            d = step * np.eye(columns)[k]
            ends = []
            for sign in (1, -1):
                moved = list(values)
                moved[slot] = se3.retract(values[slot], sign * d) if columns == 6 else values[slot] + sign * d
                ends.append(factor.residuals(*moved))
            # Products of lengths near 1 with second derivatives of a few: step^2 and 1e-16 / step.
            assert np.allclose(J[slot][:, :, k], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("noise", [LOOP_ROTATION, LOOP_TRANSLATION])
def test_derivatives_by_the_robot_are_differences(noise: str, inverted: bool) -> None:
    t_robot, T, t, B = recording(0.02)
    spline = PoseSpline(t_robot, T)

    class Moved(PoseSpline):
        """The same poses, turned and shifted."""

        def __init__(self, by: np.ndarray) -> None:
            self.__dict__.update(spline.__dict__, by=by)

        def pose(self, t: np.ndarray) -> np.ndarray:
            return se3.retract(spline.pose(t), np.broadcast_to(self.by, (len(t), 6)))

    def factor(by: np.ndarray) -> _LoopFactor:
        return _LoopFactor("loop", Moved(by), t[:5], B[:5], inverted=inverted, noise=noise)

    target = se3.inverse(gripper(t[:1] + 0.02))[0] @ X @ B[0] if inverted else Z
    values = [np.tile(X, (5, 1, 1)), np.tile(target, (5, 1, 1)), np.full((5, 1), 0.02)]
    J, step = factor(np.zeros(6)).by_robot(X, target, 0.02), 1e-6
    for k in range(6):
        ends = [factor(sign * step * np.eye(6)[k]).residuals(*values) for sign in (1, -1)]
        # Products of lengths near 1 with second derivatives of a few: step^2 and 1e-16 / step.
        assert np.allclose(J[:, :, k], (ends[0] - ends[1]) / (2 * step), atol=1e-8)


@pytest.mark.statistics
def test_the_samples_noise_is_known_and_passed_on() -> None:
    """Against recordings drawn anew: the level of each, and the spread of a weighted sum over the spline's poses."""
    rng = np.random.default_rng(4)
    t_robot, t = np.arange(0, 6, 0.02), np.arange(1, 5, 0.1)
    weights = rng.standard_normal((len(t), 1, 6)) * [0, 0, 0, 1, 1, 1] * np.sin(t)[:, None, None] ** 2
    sums, levels, predicted = [], [], []
    for _ in range(200):
        noise = rng.standard_normal((len(t_robot), 6)) * [1e-3, 1e-3, 1e-3, 5e-4, 5e-4, 5e-4]
        spline = PoseSpline(t_robot, se3.retract(gripper(t_robot), noise))
        d = spline.pose(t)[:, :3, 3] - gripper(t)[:, :3, 3]
        sums.append(float(np.einsum("nk,nk->", weights[:, 0, 3:], d)))
        levels.append(spline.sigma)
        predicted.append(float(spline.spread(t, weights)[0, 0]))
    # A level is of 300 samples less some 40 knots, three axes: 2.5 %, the mean over 200 a tenth of that.
    assert np.mean(levels, axis=0) == pytest.approx([1e-3, 5e-4], rel=0.03)
    # A variance of 200 sums has a standard deviation of 10 %.
    assert np.mean(np.square(sums)) == pytest.approx(np.mean(predicted), rel=0.3)


def test_what_tells_nothing_is_refused() -> None:
    t_robot, T, t, B = recording(0.0)
    with pytest.raises(InputError, match="do not increase at sample 4"):
        estimate_time_offset(t_robot, T, np.concatenate([t[:4], t[2:]])[: len(t)], B)
    with pytest.raises(InputError, match="the camera has 5 samples"):
        estimate_time_offset(t_robot, T, t[:5], B[:5])
    with pytest.raises(RefusedError, match="too slow to tell an offset"):
        estimate_time_offset(t_robot, T, t, np.repeat(B[:1], len(t), axis=0))
    other = se3.make(
        so3.exp(np.cumsum(np.random.default_rng(1).normal(scale=0.05, size=(len(t), 3)), axis=0)), B[:, :3, 3]
    )
    with pytest.raises(RefusedError, match="no offset within 2 s brings the two motions together"):
        estimate_time_offset(t_robot, T, t, other)
    with pytest.raises(RefusedError, match=r"edge of the search|no offset within"):
        estimate_time_offset(*recording(0.5), largest=0.2)


def test_clocks_of_other_zeros_are_said_to_be() -> None:
    robot, A, camera, B = recording(0.05)
    for moved in (1.7e9, -1.7e9):
        with pytest.raises(RefusedError, match=r"the times do not overlap: the (camera|robot)'s recording ends 1.7e"):
            estimate_time_offset(robot + moved, A, camera, B, largest=100.0)
