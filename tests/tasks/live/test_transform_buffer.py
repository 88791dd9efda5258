"""What tf said lately, along any chain and between two messages."""

from __future__ import annotations

import numpy as np

from calibrant.geometry import se3, so3
from calibrant.tasks.live.transform_buffer import TransformBuffer

A = se3.make(so3.exp([0.1, 0.2, -0.3]), [0.5, 0.1, 0.4])
B = se3.make(so3.exp([-0.4, 0.0, 0.2]), [0.0, 0.3, 0.1])
C = se3.make(so3.exp([0.0, 0.0, 0.6]), [0.1, 0.0, 0.0])


def buffer() -> TransformBuffer:
    tf = TransformBuffer()
    tf.add("base", "arm", A, 10.0, static=False)
    tf.add("base", "arm", A, 10.2, static=False)
    tf.add("arm", "tool", B, 0.0, static=True)
    tf.add("base", "camera", C, 0.0, static=True)
    return tf


def test_a_chain_goes_up_and_down_the_tree() -> None:
    tf = buffer()
    np.testing.assert_allclose(tf.pose("base", "tool", 10.1), A @ B, atol=1e-15)
    np.testing.assert_allclose(tf.pose("camera", "tool", 10.1), se3.inverse(C) @ A @ B, atol=1e-15)
    np.testing.assert_allclose(tf.pose("tool", "base", 10.1), se3.inverse(A @ B), atol=1e-15)
    np.testing.assert_array_equal(tf.pose("tool", "tool", 10.1), np.eye(4))
    assert tf.root_of("tool") == "base"


def test_between_two_messages_half_the_way_is_half_the_turn() -> None:
    tf = TransformBuffer()
    tf.add("base", "tool", np.eye(4), 1.0, static=False)
    tf.add("base", "tool", se3.make(so3.exp([0, 0, 0.8]), [0.2, 0, 0]), 2.0, static=False)
    np.testing.assert_allclose(tf.pose("base", "tool", 1.5), se3.make(so3.exp([0, 0, 0.4]), [0.1, 0, 0]), atol=1e-15)
    mm, deg = tf.moved("base", "tool", 2.0, 0.5)
    np.testing.assert_allclose((mm, deg), (100, np.rad2deg(0.4)))


def test_what_is_not_known_is_none() -> None:
    tf = buffer()
    assert tf.pose("base", "tool", 10.3) is None
    assert tf.pose("base", "tool", 9.9) is None
    assert tf.pose("base", "elsewhere", 10.1) is None
    assert tf.moved("base", "tool", 10.2, 0.5) is None


def test_a_clock_that_jumps_back_begins_anew_and_old_times_are_forgotten() -> None:
    tf = buffer()
    tf.add("base", "arm", B, 3.0, static=False)
    assert tf.pose("base", "arm", 10.1) is None
    np.testing.assert_array_equal(tf.pose("base", "arm", 3.0), B)
    tf.add("base", "arm", A, 20.0, static=False)
    assert tf.pose("base", "arm", 3.0) is None


def test_a_frame_that_is_its_own_ancestor_ends_nothing() -> None:
    tf = TransformBuffer()
    tf.add("a", "b", A, 1.0, static=True)
    tf.add("b", "a", B, 1.0, static=True)
    assert tf.pose("a", "c", 1.0) is None
