"""What the motions determine: degeneracies named with the axis and the cure, good motions left in peace."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.solvers import SOLVERS
from calibrant.calibrate.solvers.motion import MotionReport, motion_report
from calibrant.calibrate.solvers.relative import MAX_PAIRS, PosePairs, pair_indices
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]


def scene(
    rng: np.random.Generator, R_A: Array, *, robot: float = 0.0, camera: float = 0.0
) -> tuple[Array, Array, Array]:
    """A, B, X with noise of `robot` and `camera` degrees and ten times as many millimetres per axis."""
    n = len(R_A)
    A = se3.make(R_A, rng.normal(scale=0.3, size=(n, 3)))
    X, Z = se3.make(so3.random(rng, 2), rng.normal(scale=0.3, size=(2, 3)))
    B = se3.inverse(X) @ se3.inverse(A) @ Z
    unit = np.array([np.deg2rad(1.0)] * 3 + [1e-2] * 3)
    A = se3.retract(A, robot * unit * rng.normal(size=(n, 6)))
    return A, se3.retract(B, camera * unit * rng.normal(size=(n, 6))), X


def statuses(report: MotionReport) -> dict[str, str]:
    return {f.name: f.status for f in report.findings}


class TestGoodMotions:
    def test_all_ok(self) -> None:
        rng = np.random.default_rng(0)
        report = motion_report(*scene(rng, so3.random(rng, 15), robot=0.02, camera=0.05)[:2])
        assert set(statuses(report).values()) == {"ok"}
        assert report.poses == 15
        report.require_determined()

    def test_noise_is_estimated(self) -> None:
        rng = np.random.default_rng(1)
        report = motion_report(*scene(rng, so3.random(rng, 60), robot=0.03, camera=0.04)[:2])
        # 60 poses give the spread to about 10 %; three times that.
        assert report.sigma_rotation_deg == pytest.approx(0.05, rel=0.3)

    @pytest.mark.statistics
    def test_predicted_error_is_the_error_of_a_solver(self) -> None:
        """Worst-axis sigma of X against the RMS of 100 solutions along that axis."""
        rng = np.random.default_rng(2)
        R_A = so3.exp(rng.normal(size=(12, 3)) * [0.3, 0.1, 0.1])
        predicted, errors = [], []
        for _ in range(100):
            A, B, X = scene(rng, R_A, robot=0.02, camera=0.05)
            predicted.append(motion_report(A, B).predicted_rotation_deg)
            errors.append(np.rad2deg(se3.local(X, SOLVERS["park"].solve(A, B).X)[:3]))
        worst = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(errors).T))[-1])
        # 100 trials give a sigma to 7 %; the median noise of 12 poses adds a bias of up to 20 %.
        assert np.median(predicted) == pytest.approx(worst, rel=0.35)

    def test_real_data(self, shared_data: Callable[[str], Path]) -> None:
        samples = np.array(json.loads((shared_data("handeye_moveit_poses") / "pose_samples.json").read_text()))
        report = motion_report(se3.inverse(se3.check(samples[:, 0], name="poses")), samples[:, 1], frame="base")
        assert set(statuses(report).values()) == {"ok"}


class TestDegenerateMotions:
    @pytest.mark.parametrize("n", [3, 5, 15, 40])
    @pytest.mark.parametrize("noise", [0.0, 0.01, 0.2])
    def test_parallel_axes_name_the_axis(self, n: int, noise: float) -> None:
        rng = np.random.default_rng(n)
        axis = so3.random(rng, 1)[0, 0]
        R_A = so3.random(rng, 1) @ so3.exp(np.linspace(-1.2, 1.0, n)[:, None] * axis)
        report = motion_report(*scene(rng, R_A, robot=noise / 3, camera=noise)[:2])
        finding = report.finding("parallel-axes")
        assert finding is not None
        assert finding.status == "fail"
        assert report.degenerate == (finding,)
        assert finding.direction is not None
        # Noise of 0.2 degrees on turns of a radian tilts the axis by less than a degree.
        assert abs(np.dot(finding.direction, axis)) > np.cos(np.deg2rad(1.0))
        assert "tilt the gripper about another axis" in finding.message
        assert report.predicted_rotation_deg == float("inf")

    @pytest.mark.parametrize("n", [3, 5, 15, 40])
    @pytest.mark.parametrize("noise", [0.0, 0.01, 0.2])
    def test_pure_translation(self, n: int, noise: float) -> None:
        rng = np.random.default_rng(n)
        R_A = np.broadcast_to(so3.random(rng, 1), (n, 3, 3))
        report = motion_report(*scene(rng, R_A, robot=noise / 3, camera=noise)[:2])
        assert [f.name for f in report.degenerate] == ["pure-translation"]
        with pytest.raises(RefusedError, match="unknown in every direction"):
            report.require_determined()

    def test_a_robot_that_cannot_tilt_is_seen_through_a_noisy_camera(self) -> None:
        """Exactly parallel robot axes stay parallel, however much the camera's noise seems to tilt."""
        rng = np.random.default_rng(3)
        R_A = so3.exp(rng.uniform(-1, 1, size=(15, 1)) * np.array([0.0, 0.0, 1.0]))
        finding = motion_report(*scene(rng, R_A, camera=0.5)[:2]).finding("parallel-axes")
        assert finding is not None
        assert finding.status == "fail"

    def test_half_turns(self) -> None:
        rng = np.random.default_rng(4)
        turns = np.array([np.eye(3), np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])])
        for noise in (0.0, 0.02):
            report = motion_report(*scene(rng, np.concatenate([turns, turns]), robot=noise, camera=noise)[:2])
            assert [f.name for f in report.degenerate] == ["half-turns"]

    def test_one_flipped_board_is_no_degeneracy(self) -> None:
        rng = np.random.default_rng(5)
        A, B, _ = scene(rng, so3.exp(rng.normal(scale=0.3, size=(15, 3))), robot=0.02, camera=0.05)
        B[3] = B[3] @ np.diag([-1.0, -1.0, 1.0, 1.0])
        assert motion_report(A, B).degenerate == ()

    def test_threshold_follows_the_noise_not_an_angle(self) -> None:
        """Tilts of half a degree are motion to a precise robot and noise to a poor one."""
        rng = np.random.default_rng(6)
        R_A = so3.exp(rng.uniform(-1, 1, size=(20, 3)) * [1.0, 0.01, 0.01])
        precise = motion_report(*scene(rng, R_A, robot=0.003, camera=0.005)[:2])
        poor = motion_report(*scene(rng, R_A, robot=0.3, camera=0.3)[:2])
        assert statuses(precise)["parallel-axes"] == "warn"
        assert statuses(poor)["parallel-axes"] == "fail"


class TestTheSamePosesTwice:
    """A file named twice by mistake closes the loop without an error, and says nothing about a camera."""

    @pytest.mark.parametrize("again", [lambda A: A, se3.inverse, lambda A: A.round(10)])
    def test_refused_by_name(self, again: Callable[[Array], Array]) -> None:
        rng = np.random.default_rng(31)
        A, _, _ = scene(rng, so3.random(rng, 12))
        report = motion_report(A, again(A))
        assert [f.name for f in report.degenerate] == ["same-poses"]
        with pytest.raises(RefusedError, match="same-poses: the 12 target poses are the robot's poses"):
            report.require_determined()

    def test_poses_that_only_look_alike_are_not(self) -> None:
        """A camera a tenth of a millimetre from the flange's frame, seeing a target as far from the base's."""
        rng = np.random.default_rng(32)
        A, _, _ = scene(rng, so3.random(rng, 12))
        B = se3.inverse(A) @ se3.make(np.eye(3), np.array([1e-4, 0.0, 0.0]))
        assert motion_report(A, B).finding("same-poses") is None


class TestWeakMotions:
    def test_nearly_the_same_poses(self) -> None:
        rng = np.random.default_rng(7)
        report = motion_report(*scene(rng, so3.exp(rng.normal(scale=0.03, size=(10, 3))), camera=0.02)[:2])
        finding = report.finding("small-rotations")
        assert finding is not None
        assert finding.status == "warn"
        assert "hardly turn" in finding.message
        assert report.degenerate == ()

    def test_few_poses_warn(self) -> None:
        rng = np.random.default_rng(8)
        assert statuses(motion_report(*scene(rng, so3.random(rng, 4))[:2]))["poses"] == "warn"

    def test_repeated_poses_count_once(self) -> None:
        rng = np.random.default_rng(9)
        A, B, _ = scene(rng, so3.random(rng, 2))
        report = motion_report(np.repeat(A, 5, axis=0), np.repeat(B, 5, axis=0))
        assert report.poses == 2
        assert [f.name for f in report.degenerate] == ["poses"]


class TestAgreement:
    def test_shifted_pairs_are_named(self) -> None:
        rng = np.random.default_rng(10)
        A, B, _ = scene(rng, so3.random(rng, 15), robot=0.02, camera=0.05)
        found = statuses(motion_report(A, np.roll(B, 1, axis=0)))
        assert found["rotation-agreement"] == "fail"
        assert found["screw-agreement"] == "fail"

    def test_millimetres_on_one_side_are_named(self) -> None:
        rng = np.random.default_rng(11)
        A, B, _ = scene(rng, so3.random(rng, 15), robot=0.02, camera=0.05)
        A[:, :3, 3] *= 1e3
        found = statuses(motion_report(A, B))
        assert found["rotation-agreement"] == "ok"
        assert found["screw-agreement"] == "fail"

    @pytest.mark.parametrize("camera", [0.0, 0.02])
    def test_a_wrist_alone_is_no_disagreement(self, camera: float) -> None:
        """All motions turn about one point: their advances are zero, and what differs is noise."""
        rng = np.random.default_rng(12)
        A, _, X = scene(rng, so3.random(rng, 20))
        A[:, :3, 3] = [0.5, 0.1, 0.6] - A[:, :3, :3] @ [0.0, 0.02, 0.15]
        B = se3.inverse(X) @ se3.inverse(A) @ se3.make(np.eye(3), [0.5, 0.0, 0.0])
        B = se3.retract(B, camera * np.array([np.deg2rad(1.0)] * 3 + [1e-2] * 3) * rng.normal(size=(20, 6)))
        found = motion_report(A, B)
        assert set(statuses(found).values()) == {"ok"}
        wrong = motion_report(A, np.roll(B, 1, axis=0))
        assert statuses(wrong)["rotation-agreement"] == "fail"


class TestPairs:
    def test_all_pairs_up_to_the_cap(self) -> None:
        i, j = pair_indices(100)
        assert len(i) == 4950 <= MAX_PAIRS
        assert len({(min(a, b), max(a, b)) for a, b in zip(i.tolist(), j.tolist(), strict=True)}) == 4950

    @pytest.mark.parametrize("n", [101, 500, 1000, 9000])
    def test_beyond_the_cap_every_pose_occurs_equally_often(self, n: int) -> None:
        i, j = pair_indices(n)
        assert len(i) <= max(MAX_PAIRS, 3 * n)
        counts = np.bincount(np.concatenate([i, j]), minlength=n)
        assert counts.min() == counts.max() >= 6
        assert len({(min(a, b), max(a, b)) for a, b in zip(i.tolist(), j.tolist(), strict=True)}) == len(i)

    def test_branches_match_near_half_turns(self) -> None:
        """Noise pushes half turns across pi and flips their axis; on matching branches alpha stays R_X beta."""
        rng = np.random.default_rng(12)
        R_A = np.concatenate([so3.exp(rng.normal(scale=0.4, size=(5, 3))), so3.exp([[np.pi, 0, 0], [0, np.pi, 0]])])
        A, B, X = scene(rng, R_A, robot=0.1, camera=0.1)
        m = PosePairs(A, B).motions
        # 0.2 degrees of noise a motion, up to 5 sigma, times pi / 2 where a rotation vector of pi turns about its axis.
        assert np.linalg.norm(m.alpha - m.beta @ X[:3, :3].T, axis=1).max() < np.deg2rad(0.2 * 5 * np.pi / 2)
        np.testing.assert_allclose(so3.exp(m.beta), m.B[:, :3, :3], atol=1e-9)
