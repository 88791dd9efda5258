"""Tools in a cell: touching a point finds what `tool touch` does, touched corners tie robot and target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import calibrate_cell
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.cell.problem.touches import Touches, TouchFactor
from calibrant.calibrate.tool.tip import tip_by_touch
from calibrant.cameras import Camera
from calibrant.data import Observations, RobotPoses, View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.noise import noisy_poses
from calibrant.simulate.scenes import grid, gripper_poses, look_at_board, standard_camera, standard_mounting
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(9, 7, 0.02)
KNOWN = replace(CAMERA, covariance=np.diag(np.full(len(CAMERA.values), 1e-12)))
X, Z = standard_mounting("eye-in-hand")
TIP = np.array([0.03, -0.02, 0.18])
MARK = np.array([0.45, -0.1, 0.02])
CORNERS = POINTS[[0, 8, 54, 62, 31]]
T_SIDE_TARGET = se3.make(so3.exp([0.3, -0.4, 0.2]), [-0.08, -0.06, 0.6])


def touching(points: np.ndarray, rng: np.random.Generator, *, touch: float) -> np.ndarray:
    """T_base_gripper (n, 4, 4) at which the tip is on points (n, 3), root, to `touch` metres an axis."""
    R = so3.exp(0.5 * rng.normal(size=(len(points), 3))) @ so3.exp([np.pi, 0.0, 0.0])
    at = points + touch * rng.normal(size=points.shape)
    return se3.make(R, at - np.einsum("nij,j->ni", R, TIP))


def hand_eye(seed: int, *, noise: float = 1.0) -> tuple[np.ndarray, Pictures, np.random.Generator]:
    rng = np.random.default_rng(seed)
    B = look_at_board(CAMERA, POINTS, 12, rng=rng, distance=(0.4, 0.7), tilt_deg=35)
    views = []
    for k, M in enumerate(B):
        uv = CAMERA.project(se3.apply(M, POINTS)) + 0.1 * noise * rng.normal(size=(len(POINTS), 2))
        inside = np.all((uv > 0) & (uv < np.array(CAMERA.image_size) - 1), axis=1)
        views.append(View(str(k), POINTS[inside], uv[inside], np.flatnonzero(inside), "camera", moment=str(k)))
    T = noisy_poses(gripper_poses("eye-in-hand", X, Z, B), sigma_mm=0.2 * noise, sigma_deg=0.03 * noise, rng=rng)
    return T, Pictures("camera", "eye-in-hand", Observations(tuple(views), {"camera": CAMERA.image_size})), rng


def with_touches(T: np.ndarray, *parts: tuple[str, np.ndarray]) -> RobotPoses:
    ids = [str(k) for k in range(len(T))] + [f"{name}{k}" for name, more in parts for k in range(len(more))]
    return RobotPoses(tuple(ids), np.concatenate([T, *(more for _, more in parts)]))


def ids(name: str, n: int) -> tuple[str, ...]:
    return tuple(f"{name}{k}" for k in range(n))


def side(rng: np.random.Generator, *, noise: float = 1.0, camera: Camera = KNOWN) -> Pictures:
    """One picture of the board by a camera that stands beside the robot."""
    uv = camera.project(se3.apply(T_SIDE_TARGET, POINTS)) + 0.1 * noise * rng.normal(size=(len(POINTS), 2))
    view = View("side", POINTS, uv, np.arange(len(POINTS)), "side", moment="side")
    return Pictures("side", "standing", Observations((view,), {"side": camera.image_size}))


def test_jacobians() -> None:
    rng = np.random.default_rng(0)
    values = [se3.exp(rng.normal(size=6)) for _ in range(3)] + [np.array([0.02])]
    values[0][:3, :3] = np.eye(3)
    said, q = se3.exp(rng.normal(size=(4, 6))), rng.normal(size=(4, 3))
    factor = TouchFactor("t", said, q, tip="tip", touched="board", noise="n", base="base", scale="scale")

    def at(moved: list[np.ndarray]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        return factor.linearize(*(np.broadcast_to(v, (4, *v.shape)) for v in moved))

    _, J = at(values)
    for slot, size in enumerate((6, 6, 6, 1)):
        for k in range(3 if slot == 0 else 0, size):
            step = 1e-6 * np.eye(size)[k]
            ends = []
            for sign in (1, -1):
                moved = list(values)
                moved[slot] = values[slot] + sign * step if size == 1 else se3.retract(values[slot], sign * step)
                ends.append(at(moved)[0])
            np.testing.assert_allclose(J[slot][:, :, k], (ends[0] - ends[1]) / 2e-6, atol=1e-8)


def test_a_point_touched_is_what_tool_touch_finds() -> None:
    T, pictures, rng = hand_eye(1)
    touched = touching(np.tile(MARK, (10, 1)), rng, touch=2e-4)
    poses = with_touches(T, ("m", touched))
    whole = calibrate_cell(poses, [pictures], cameras={"camera": KNOWN}, touches=[Touches(ids("m", 10))])
    apart = tip_by_touch(touched)
    found = whole.transform("gripper", "tip")
    # What the pictures say is of other poses: both are the same least squares, solved to its end.
    np.testing.assert_allclose(found.matrix[:3, 3], apart.tip, atol=1e-9)
    np.testing.assert_allclose(whole.transform("base", "point").matrix[:3, 3], apart.point, atol=1e-9)
    # Sigma: that of Student's t there, of an average over the level here.
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)[3:]), np.sqrt(np.diag(apart.covariance)), rtol=0.02)
    assert not found.covariance[:3].any()
    assert whole.check("touches-tip").value == pytest.approx(apart.sigma, rel=1e-3)
    before = calibrate_cell(poses.only(ids("", 12)), [pictures], cameras={"camera": KNOWN})
    np.testing.assert_allclose(
        whole.transform("gripper", "camera").matrix, before.transform("gripper", "camera").matrix, atol=1e-7
    )


def test_exact_without_noise() -> None:
    T, pictures, rng = hand_eye(2, noise=0.0)
    corners = touching(se3.apply(Z, CORNERS), rng, touch=0.0)
    touches = [Touches(ids("c", 5), target="target", points=CORNERS, tool="probe")]
    result = calibrate_cell(with_touches(T, ("c", corners)), [pictures], cameras={"camera": KNOWN}, touches=touches)
    np.testing.assert_allclose(result.transform("gripper", "probe").matrix[:3, 3], TIP, atol=1e-7)
    np.testing.assert_allclose(result.transform("gripper", "camera").matrix, X, atol=1e-7)


def test_touched_corners_place_a_board_and_the_camera_that_sees_it() -> None:
    """No hand-eye at all: one picture, a mark and the corners of the board touched."""
    rng = np.random.default_rng(3)
    mark = touching(np.tile(MARK, (8, 1)), rng, touch=1e-4)
    corners = touching(se3.apply(Z, CORNERS), rng, touch=1e-4)
    touches = [Touches(ids("m", 8)), Touches(ids("c", 5), target="target", points=CORNERS)]
    poses = with_touches(mark[:0], ("m", mark), ("c", corners))
    result = calibrate_cell(poses, [side(rng)], cameras={"side": KNOWN}, touches=touches)
    truth = Z @ se3.inverse(T_SIDE_TARGET)
    assert normalised(result.transform("base", "side"), truth) / 6 < 4
    assert result.joint_covariance is not None
    assert ("gripper", "tip") in result.joint_covariance.frames


@pytest.mark.statistics
def test_errors_match_their_covariance() -> None:
    scores: dict[str, list[float]] = {"camera": [], "tip": [], "target": [], "side": []}
    for seed in range(15):
        T, pictures, rng = hand_eye(100 + seed)
        corners = touching(se3.apply(Z, CORNERS), rng, touch=1e-4)
        mark = touching(np.tile(MARK, (6, 1)), rng, touch=1e-4)
        touches = [Touches(ids("m", 6)), Touches(ids("c", 5), target="target", points=CORNERS)]
        poses = with_touches(T, ("m", mark), ("c", corners))
        cameras = {"camera": KNOWN, "side": KNOWN}
        result = calibrate_cell(poses, [pictures, side(rng)], cameras=cameras, touches=touches)
        truths = {"camera": ("gripper", X), "target": ("base", Z), "side": ("base", Z @ se3.inverse(T_SIDE_TARGET))}
        for name, (parent, truth) in truths.items():
            scores[name].append(normalised(result.transform(parent, name), truth) / 6)
        t = result.transform("gripper", "tip")
        d = t.matrix[:3, 3] - TIP
        scores["tip"].append(float(d @ np.linalg.solve(t.covariance[3:, 3:], d)) / 3)
    # Means of 15 values of mean 1 and deviation sqrt(2 / 6) or sqrt(2 / 3): three sigmas and the noise levels' own.
    assert {k: np.mean(v) for k, v in scores.items() if not 0.4 < np.mean(v) < 1.8} == {}


def test_touched_corners_tighten_what_the_camera_says_of_the_board() -> None:
    T, pictures, rng = hand_eye(4)
    mark = touching(np.tile(MARK, (8, 1)), rng, touch=1e-4)
    corners = touching(se3.apply(Z, CORNERS), rng, touch=1e-4)
    poses = with_touches(T, ("m", mark), ("c", corners))
    mine = [Touches(ids("m", 8))]
    board = Touches(ids("c", 5), target="target", points=CORNERS)
    without, whole = (
        calibrate_cell(poses, [pictures], cameras={"camera": KNOWN}, touches=t) for t in (mine, [*mine, board])
    )
    sigma = [np.linalg.norm(r.transform("base", "target").sigma_translation_mm) for r in (without, whole)]
    assert sigma[1] < 0.8 * sigma[0]
    assert whole.check("touches-tip").status == "ok"
    assert "gripper → tip, position" in str(whole)
    assert whole.options["touches"] == ["Touches(8 of point with tip)", "Touches(5 of target with tip)"]


def test_touches_that_say_nothing_or_do_not_fit_are_named() -> None:
    T, pictures, rng = hand_eye(5)
    still = touching(np.tile(MARK, (6, 1)), rng, touch=0.0)
    still[:, :3, :3] = still[0, :3, :3]
    known = {"camera": KNOWN}
    with pytest.raises(RefusedError, match="the touches do not tell where point is in base"):
        calibrate_cell(with_touches(T, ("m", still)), [pictures], cameras=known, touches=[Touches(ids("m", 6))])
    poses = with_touches(T, ("m", touching(rng.normal(size=(6, 3)), rng, touch=0.0)))
    with pytest.raises(RefusedError, match="are these the poses of the touches"):
        calibrate_cell(poses, [pictures], cameras=known, touches=[Touches(ids("m", 6))])
    with pytest.raises(InputError, match="no pose of robot 'robot' for 1 of 1"):
        calibrate_cell(poses, [pictures], cameras=known, touches=[Touches(("x",))])
    with pytest.raises(InputError, match="no pictures show target 'other' standing still"):
        calibrate_cell(poses, [pictures], touches=[Touches(("m0",), target="other", points=np.zeros((1, 3)))])
    with pytest.raises(InputError, match="1 touches and 0 points of target"):
        Touches(("m0",), target="target")
    with pytest.raises(InputError, match="has the name of another frame"):
        calibrate_cell(poses, [pictures], touches=[Touches(("m0",), tool="camera")])
