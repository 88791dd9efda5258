"""The simulator of benchmarks/what_users_have.py is right by itself: its equations, its draws, its least sigma."""

from __future__ import annotations

import sys
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from users import cell, hand_eye, intrinsics, photos, rigid, robot


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


def test_an_arm_reaches_where_it_is_sent_and_turns_about_its_joints(rng: np.random.Generator) -> None:
    arm = robot.draw_arm(rng)
    q = robot.HOME + 0.3 * rng.standard_normal((20, 6))
    found, reached = arm.reach(arm.poses(q), np.tile(robot.HOME, (20, 1)))
    assert reached.sum() > 15
    np.testing.assert_allclose(arm.poses(found)[reached], arm.poses(q)[reached], atol=1e-8)
    turned = arm.poses(q + np.array([0.1, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(turned, rigid.rigid(rigid.turn([0, 0, 0.1]), np.zeros(3)) @ arm.poses(q), atol=1e-13)


@pytest.mark.parametrize("setup", [cell.IN_HAND, cell.TO_HAND])
def test_what_moves_base_and_flange_is_in_the_averaged_truth(setup: str) -> None:
    session = cell.draw_session(3, cell.CellDraw(setup=setup))
    dB, dF = rigid.moved(np.eye(4), np.full(6, 1e-4)), rigid.moved(np.eye(4), np.full(6, -2e-4))
    reported = session.true
    cell.misled(session, lambda arm, q, rng: lambda q: dB @ arm.poses(q) @ dF, average=True)
    X = session.truths[0]
    loop = reported @ X @ session.photos.T if setup == cell.IN_HAND else rigid.back(reported) @ X @ session.photos.T
    assert np.abs(loop - loop[0]).max() < 1e-7
    assert session.off < 1e-7


@cache
def drawn(draw: cell.CellDraw) -> cell.Session:
    return cell.draw_session(1, draw)


@pytest.mark.parametrize("condition", hand_eye.conditions(), ids=lambda c: c.name)
def test_every_session_closes_its_loop_but_for_what_is_wrong(condition: hand_eye.Condition) -> None:
    session = deepcopy(drawn(condition.draw))
    for edit in condition.edits:
        edit(session)
    chain = (session.true @ session.X) if session.setup == cell.IN_HAND else rigid.back(session.true) @ session.X
    loop = chain @ session.photos.T
    moves = "nudged" in condition.name or "misnumbered" in condition.name
    assert moves == bool(np.abs(loop - loop[0]).max() > 1e-9)
    assert np.isfinite(session.photos.take()).all()
    assert len(session.reported) == len(session.photos) >= 4


def test_a_robot_without_a_fault_finds_its_camera() -> None:
    run = hand_eye.run(hand_eye.conditions()[0], 0)
    assert run.verdict == "ok"
    assert run.error < 40  # of 6; above it once in 10^6
    assert 0.6 < run.growth < 2
