"""Movements in words: what moved, and what a person is to do about it."""

from __future__ import annotations

import numpy as np

from calibrant.diagnose.movement import camera_words, guidance, movement, to_wanted, undone
from calibrant.geometry import se3, so3

SURE = 1e-12 * np.eye(6)


def test_a_move_is_told_and_undone_in_the_same_words() -> None:
    D = se3.make(np.eye(3), [0.012, -0.004, 0.0])
    C = np.diag(np.r_[np.full(3, 1e-8), np.full(3, 1e-8)])
    assert camera_words(movement(D, C)) == "moved 12.00 ± 0.10 mm to the right, 4.00 ± 0.10 mm up"
    assert guidance(undone(D, C)) == "move 12.00 ± 0.10 mm to the left, 4.00 ± 0.10 mm down"


def test_turns_are_told_as_one_behind_the_camera_sees_them() -> None:
    turn = se3.make(so3.exp([0, 0, np.deg2rad(0.8)]), np.zeros(3))
    assert guidance(movement(turn, SURE)).endswith("deg clockwise")
    assert guidance(undone(turn, SURE)).endswith("deg anticlockwise")


def test_what_is_not_certain_is_not_asked_for() -> None:
    T = se3.make(np.eye(3), [0.001, 0.0, 0.0])
    assert guidance(to_wanted(np.eye(4), np.diag(np.r_[np.full(3, 1e-6), np.full(3, 1e-6)]), T)) == ""


def test_following_the_guidance_arrives() -> None:
    rng = np.random.default_rng(0)
    T, wanted = (
        se3.make(so3.exp([0.3, -2.0, 0.5]), [1.5, 0.1, 0.8]),
        se3.make(so3.exp([0.5, -1.9, 0.4]), [1.4, 0.2, 0.7]),
    )
    to_go = to_wanted(T, SURE, wanted)
    there = T @ se3.make(so3.exp(np.deg2rad(to_go.deg)), 1e-3 * to_go.mm)
    np.testing.assert_allclose(there, wanted, atol=1e-12)
    # The covariances against differences: both maps are linear in small errors of the camera's place.
    for of, there in (
        (lambda delta: se3.inverse(se3.retract(T, delta)) @ wanted, lambda C: to_wanted(T, C, wanted)),
        (lambda delta: se3.inverse(se3.retract(T, delta)), lambda C: undone(T, C)),
    ):
        step, base = 1e-6, of(np.zeros(6))
        J = np.stack([se3.local(base, of(step * e)) / step for e in np.eye(6)], axis=1)
        A = rng.standard_normal((6, 6))
        C = A @ A.T * 1e-6
        expected = np.sqrt(np.diag(J @ C @ J.T))
        told = there(C)
        np.testing.assert_allclose(np.r_[np.deg2rad(told.deg_sigma), 1e-3 * told.mm_sigma], expected, rtol=1e-4)
