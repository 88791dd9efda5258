"""The simulator of benchmarks/what_users_have.py is right by itself: its equations, its draws, its least sigma."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from users import intrinsics, photos, rigid


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def test_turns_are_rotations_and_come_back(rng: np.random.Generator) -> None:
    w = rng.normal(0, 0.8, (50, 3))
    R = rigid.turn(w)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (50, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(rigid.turned_by(R), w, atol=1e-12)
    np.testing.assert_allclose(rigid.turn([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_a_step_is_the_way_between_two_poses(rng: np.random.Generator) -> None:
    T = rigid.rigid(rigid.turn(rng.normal(0, 1, (9, 3))), rng.normal(0, 1, (9, 3)))
    step = rng.normal(0, 0.5, (9, 6))
    np.testing.assert_allclose(rigid.step_between(T, rigid.moved(T, step)), step, atol=1e-12)
    np.testing.assert_allclose(T @ rigid.back(T), np.tile(np.eye(4), (9, 1, 1)), atol=1e-14)


def test_a_point_on_the_axis_is_seen_at_the_centre() -> None:
    K, D = np.array([[900.0, 910.0, 320.0, 240.0]]), np.array([[-0.2, 0.1, 1e-3, -1e-3, 0.01]])
    uv = photos.project(np.array([[0.0, 0.0, 2.0], [0.2, 0.0, 2.0]]), np.eye(4)[None], K, D)
    np.testing.assert_allclose(uv[0, 0], [320, 240])
    g = 1 - 0.2 * 0.01 + 0.1 * 1e-4 + 0.01 * 1e-6
    np.testing.assert_allclose(uv[0, 1], [320 + 900 * (0.1 * g - 3e-5), 240 + 910 * 1e-5])


@pytest.mark.parametrize("condition", intrinsics.conditions(), ids=lambda c: c.name)
def test_every_condition_gives_observations(condition: intrinsics.Condition) -> None:
    shot = photos.draw_photos(1, condition.draw)
    for edit in condition.edits:
        edit(shot)
    seen = intrinsics.observed(shot, shot.take())
    assert len(seen.views) == len(shot)
    assert condition.clean <= (len(shot.truths) == 1)


def test_without_a_fault_the_camera_is_found_and_sigma_is_the_least() -> None:
    clean = intrinsics.conditions()[0]
    found = [intrinsics.run(clean, seed) for seed in range(6)]
    assert {r.verdict for r in found} <= {"ok", "warn"}
    assert np.mean([r.error for r in found]) < 12  # of 4; above it once in 10^8
    assert 0.9 < np.median([r.growth for r in found]) < 1.25
