"""Clocks of a rig's cameras: exact without noise, their sigma true with it, and said where nobody asked."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.problem.clocks import Motion, _moved, motion_of
from calibrant.data import Observations, View
from calibrant.data.details import CameraClocks
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, standard_camera
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(8, 6, 0.03)
NAMES = ("left", "middle", "right")
T_CAMERA_RIG = [
    se3.make(R, -R @ [0.25 * (c - 1), 0.01 * c, 0])
    for c, R in enumerate(so3.exp([0, 0.3 * (c - 1), 0]) for c in range(3))
]
FRAME_S = 1 / 30
LATE_S = {"left": 0.0, "middle": 0.012, "right": -0.007}


def pose_at(t: float) -> np.ndarray:
    """A board waved before the cameras, about half a metre and half a radian per second."""
    w = np.array([0.35 * np.sin(1.3 * t), 0.4 * np.cos(0.9 * t), 0.3 * np.sin(0.7 * t + 1)])
    p = np.array([0.10 * np.sin(1.9 * t), 0.07 * np.cos(2.3 * t), 0.8 + 0.12 * np.sin(0.6 * t)])
    return np.asarray(se3.make(so3.exp(w), p - so3.exp(w) @ POINTS.mean(axis=0)))


def waved(
    seed: int,
    *,
    late: Mapping[str, float] = LATE_S,
    readout: float = 0.0,
    sigma: float = 0.1,
    jitter: float = 0.0,
    frame_s: float = 2 * FRAME_S,
    lost: tuple[str, int, int] = ("", 0, 0),
    moved: tuple[str, int, Sequence[float]] = ("", 0, ()),
) -> tuple[Observations, dict[str, float]]:
    """What the rig sees of it in 40 pictures; sigma px, jitter s of every single picture's time; lost: a camera, the
    picture before which its recorder lost frames, and how many; moved: a camera, from which picture on, and how."""
    rng = np.random.default_rng(seed)
    views: list[View] = []
    times = {f"{m:03d}": m * frame_s for m in range(40)}
    for k, (moment, t) in enumerate(times.items()):
        for name, M in zip(NAMES, T_CAMERA_RIG):
            when = t + late[name] + jitter * rng.normal()
            when += lost[2] * frame_s if name == lost[0] and k >= lost[1] else 0.0
            M = se3.retract(M, np.array(moved[2])) if name == moved[0] and k >= moved[1] else M
            uv = CAMERA.project(se3.apply(M @ pose_at(when), POINTS))
            for _ in range(8 if readout else 0):  # the row a point is seen in says when
                rows = when + readout * (uv[:, 1] / CAMERA.image_size[1] - 0.5)
                uv = np.stack([CAMERA.project(se3.apply(M @ pose_at(s), p)) for s, p in zip(rows, POINTS)])
            uv = uv + sigma * rng.normal(size=uv.shape)
            views.append(View(f"{name}-{moment}", POINTS, uv, np.arange(len(POINTS)), name, moment=moment))
    return Observations(tuple(views), dict.fromkeys(NAMES, CAMERA.image_size)), times


def clocks_of(result: cb.CalibrationResult) -> CameraClocks:
    found = result.detail(CameraClocks)
    assert found is not None
    return found


def test_speed_of_a_moved_point_against_differences() -> None:
    rng = np.random.default_rng(0)
    T = np.stack([pose_at(0.1), pose_at(0.2)])
    motion = Motion(("a", "b"), T, rng.normal(size=(2, 6)), rng.normal(size=(2, 6)), np.ones(2, dtype=bool))
    row, p, dt, h = np.array([0, 1, 1]), POINTS[:3], np.array([0.02, -0.03, 0.0]), 1e-6
    _, speed = _moved(motion, row, p, dt)
    ahead, behind = _moved(motion, row, p, dt + h)[0], _moved(motion, row, p, dt - h)[0]
    np.testing.assert_allclose(speed, (ahead - behind) / (2 * h), atol=1e-8)


def test_motion_is_exact_for_uniform_acceleration() -> None:
    times = {"a": 0.0, "b": 0.1, "c": 0.25}
    v, a = np.array([0, 0, 0, 0.1, -0.2, 0.3]), np.array([0, 0, 0, 1.0, 0.5, -0.4])
    T = np.stack([se3.retract(np.eye(4), v * t + a * t * t / 2) for t in times.values()])
    motion = motion_of(tuple(times), T, times)
    for k, t in enumerate(times.values()):  # between its neighbours, and at either end
        np.testing.assert_allclose(motion.velocity[k], v + t * a, atol=1e-12)
        np.testing.assert_allclose(motion.acceleration[k], a, atol=1e-12)


def test_a_gap_tells_nothing_of_the_motion() -> None:
    times = {str(k): float(t) for k, t in enumerate((0, 1, 2, 3, 50, 100, 101))}
    motion = motion_of(tuple(times), np.tile(np.eye(4), (7, 1, 1)), times)
    assert motion.known.tolist() == [True, True, True, True, False, False, False]


def test_offsets_without_noise() -> None:
    observations, times = waved(0, sigma=0.0)
    result = cb.calibrate_rig(observations, times=times, time_offsets=True)
    for clock in clocks_of(result).clocks:
        # What a polynomial through pictures 67 ms apart leaves of the motion.
        assert clock.offset_ms == pytest.approx(1e3 * LATE_S[clock.camera], abs=0.003)
    assert result.rms_px == pytest.approx(0, abs=1e-4)


def test_views_are_not_left_out_for_a_clock_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board that stops and goes, a camera nearly a step late: pairs on the move contradict those that stand still."""
    waving = pose_at
    monkeypatch.setitem(waved.__globals__, "pose_at", lambda t: waving(t - 0.98 * np.sin(5.236 * t) / 5.236))
    observations, times = waved(0, late={"left": 0.0, "middle": 0.06, "right": -0.007})
    result = cb.calibrate_rig(observations, times=times, time_offsets=True)
    assert all(v.used for v in result.views)
    assert not any(c.name.startswith("at-once") for c in result.checks)
    middle = next(c for c in clocks_of(result).clocks if c.camera == "middle")
    assert middle.offset_ms == pytest.approx(60, abs=0.5)


@pytest.mark.statistics
def test_offsets_and_places_match_their_sigma() -> None:
    scores, places = [], []
    for seed in range(10):
        observations, times = waved(seed)
        result = cb.calibrate_rig(observations, times=times, time_offsets=True)
        for clock in clocks_of(result).clocks:
            assert clock.offset_ms is not None
            assert clock.offset_sigma_ms is not None
            scores.append((clock.offset_ms - 1e3 * LATE_S[clock.camera]) / clock.offset_sigma_ms)
        for k in (1, 2):
            truth = T_CAMERA_RIG[0] @ se3.inverse(T_CAMERA_RIG[k])
            places.append(normalised(result.transform("left", NAMES[k]), truth))
        assert all(c.status == "ok" for c in result.checks if c.name == "rigidity" or c.name.startswith("together"))
    assert 0.5 < np.mean(np.square(scores)) < 1.8  # 20 squares, in pairs correlated
    assert 3.0 < np.mean(places) < 9.0


@pytest.mark.statistics
def test_clocks_that_jitter_are_in_sigma() -> None:
    """Pictures taken 4 ms off at random are off by pixels alike in a moment: the places' sigma holds it."""
    places = []
    for seed in range(8):
        observations, times = waved(seed, late=dict.fromkeys(NAMES, 0.0), jitter=0.004)
        result = cb.calibrate_rig(observations, times=times)
        places += [
            normalised(result.transform("left", NAMES[k]), T_CAMERA_RIG[0] @ se3.inverse(T_CAMERA_RIG[k]))
            for k in (1, 2)
        ]
    assert np.mean(places) < 9.0


@pytest.mark.long
def test_readout_time_is_found() -> None:
    observations, times = waved(1, late=dict.fromkeys(NAMES, 0.0), readout=0.02)
    result = cb.calibrate_rig(observations, times=times, readout=True, cameras=dict.fromkeys(NAMES, CAMERA))
    for clock in clocks_of(result).clocks:
        assert clock.readout_ms is not None
        assert clock.readout_sigma_ms is not None
        assert abs(clock.readout_ms - 20) < 4 * clock.readout_sigma_ms + 0.1
        assert clock.readout_sigma_ms < 2


def test_offsets_that_nobody_asked_for_are_said() -> None:
    observations, times = waved(2)
    checks = {c.name: c for c in cb.calibrate_rig(observations, times=times).checks}
    assert checks["rigidity"].status == "warn"
    assert "middle +1" in checks["rigidity"].message
    assert "--time-offsets" in checks["rigidity"].message


def test_pictures_with_times_of_their_own_are_taken_when_they_say() -> None:
    observations, times = waved(4, sigma=0.0)
    own = {name: {m: t + LATE_S[name] for m, t in times.items()} for name in NAMES}
    result = cb.calibrate_rig(observations, times=own)
    assert result.rms_px == pytest.approx(0, abs=2e-4)
    for k in (1, 2):
        truth = T_CAMERA_RIG[0] @ se3.inverse(T_CAMERA_RIG[k])
        np.testing.assert_allclose(result.transform("left", NAMES[k]).matrix, truth, atol=1e-5)


def test_bad_input_is_said() -> None:
    observations, times = waved(3)
    with pytest.raises(InputError, match="the time of moment"):
        cb.calibrate_rig(observations, times={"000": 0.0}, time_offsets=True)
    with pytest.raises(InputError, match=r"by camera \(left\) and without one"):
        cb.calibrate_rig(observations, times={"left": {"000": 0.0}, "001": 1.0})
    with pytest.raises(InputError, match="'000' is nan"):
        cb.calibrate_rig(observations, times=times | {"000": float("nan")})
    far = {m: 101.0 * (k // 2) + k % 2 for k, m in enumerate(times)}  # pairs, far apart
    with pytest.raises(RefusedError, match="follow each other closely enough"):
        cb.calibrate_rig(observations, times=far, time_offsets=True)


@pytest.mark.parametrize(("loser", "count"), [("middle", 1), pytest.param("left", 3, marks=pytest.mark.long)])
def test_frames_that_a_video_lost_are_dated(loser: str, count: int) -> None:
    observations, times = waved(5, late=dict.fromkeys(NAMES, 0.0), lost=(loser, 22, count))
    result = cb.calibrate_rig(observations, times=times)
    check = result.check("at-once-middle")
    frames = "1 frame" if count == 1 else f"{count} frames"
    assert check.status == "warn"
    assert f"{loser} lost {frames} between left-021 and left-022" in check.message
    assert result.rms_px == pytest.approx(0.14, abs=0.02)
    assert result.check("rigidity").status == "ok"
    truth = T_CAMERA_RIG[0] @ se3.inverse(T_CAMERA_RIG[1])
    assert normalised(result.transform("left", "middle"), truth) < 20  # of 6 degrees of freedom, once in 400


@pytest.mark.statistics
def test_gaps_are_claimed_where_there_are_some() -> None:
    for seed in range(6):
        for frame_s in (1 / 6, 1 / 15):
            still = dict.fromkeys(NAMES, 0.0)
            clean, times = waved(seed, frame_s=frame_s, late=still)
            assert not any("lost" in c.message for c in cb.calibrate_rig(clean, times=times).checks)
            gone, times = waved(seed, frame_s=frame_s, late=still, lost=("right", 15, 2))
            assert "right lost 2 frames" in cb.calibrate_rig(gone, times=times).check("at-once-right").message


@pytest.mark.parametrize("late_s", [0.05, pytest.param(0.15, marks=pytest.mark.long)])
def test_clocks_are_named_before_the_lenses_that_they_bend(late_s: float) -> None:
    """At 6 pictures a second, 9 px and more: what is asked of lenses then answers for the clocks."""
    observations, times = waved(0, frame_s=1 / 6, late={"left": 0.0, "middle": late_s, "right": 0.0})
    try:
        check = cb.calibrate_rig(observations, times=times).checks[0]
        assert (check.name, check.status) == ("rigidity", "warn")
        message = check.message
    except RefusedError as error:
        message = str(error)
        assert message.startswith("rigidity")
    found = re.search(r"middle ([+-][0-9.]+) ± ([0-9.]+) ms", message)
    assert found is not None
    value, sigma = map(float, found.groups())
    assert abs(value - 1e3 * late_s) < 3 * sigma + 0.05
    assert re.search("time.offsets", message)


def test_cameras_that_moved_in_a_video_are_not_laid_on_their_clocks() -> None:
    still = dict.fromkeys(NAMES, 0.0)
    observations, times = waved(0, late=still, moved=("middle", 22, (0, 0.004, 0, 0.003, 0, 0)))
    checks = {c.name: c for c in cb.calibrate_rig(observations, times=times).checks}
    assert "late" not in checks["rigidity"].message
    assert "middle moved against left by" in checks["cameras-moved-middle"].message
    assert "between left-021 and left-022" in checks["cameras-moved-middle"].message


@pytest.mark.long
def test_a_clock_that_leaves_a_fit_without_an_answer_is_named() -> None:
    observations, times = waved(0, frame_s=1 / 6, late={"left": 0.0, "middle": 0.25, "right": -0.05})
    with pytest.raises(RefusedError, match=r"(clocks|rigidity): .*time.offsets"):
        cb.calibrate_rig(observations, times=times)
