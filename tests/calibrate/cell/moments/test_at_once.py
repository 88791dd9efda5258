"""Views of one moment: numbered alike, of one board, by cameras that stand still; what is none is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.moments.moved import move_between
from calibrant.calibrate.cell.moments.numbering import which_turns
from calibrant.calibrate.cell.moments.reflected import reflections
from calibrant.calibrate.cell.moments.sightings import pose_errors
from calibrant.calibrate.pose.target_poses import poses_from
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, standard_camera
from calibrant.simulate.stereo import standard_pair, stereo_scene
from calibrant.simulate.truth import normalised

BOARD = "chessboard:9x7:25mm"
"""As many corners one way as the other, modulo two: turned by half, it looks the same."""


@pytest.fixture(scope="module")
def seen() -> Observations:
    return stereo_scene(0).observations


def on_the_right(seen: Observations, change: Callable[[View], View]) -> Observations:
    return replace(seen, views=tuple(change(v) if v.camera == "right" else v for v in seen.views))


def test_a_pair_that_is_none_is_left_out_by_name(seen: Observations) -> None:
    """The right camera's image of moment 05 is of another board pose: it counts for the lens alone."""
    elsewhere = next(v for v in stereo_scene(77).observations.views if v.camera == "right" and len(v) == 54)
    spoilt = on_the_right(seen, lambda v: replace(elsewhere, id=v.id, moment=v.moment) if v.moment == "05" else v)
    found = cb.calibrate_stereo(spoilt)
    check = found.check("at-once")
    assert check.status == "warn"
    assert "1 of 14 pairs" in check.message
    assert "left05 and right05" in check.message
    out = {v.id: v for v in found.views if not v.used}
    assert list(out) == ["right05"]
    assert "counts for the lens of right alone" in (out["right05"].reason or "")
    assert found.rms_px == pytest.approx(cb.calibrate_stereo(seen).rms_px, rel=0.05)


def test_the_image_that_a_stray_one_belongs_to_is_named(seen: Observations) -> None:
    """Two images of the right camera exchanged: each fits the other's moment."""
    other = {"03": "06", "06": "03"}
    found = cb.calibrate_stereo(on_the_right(seen, lambda v: replace(v, moment=other.get(v.moment, v.moment))))
    message = found.check("at-once").message
    assert "left03 and right06; it fits left06" in message
    assert "left06 and right03; it fits left03" in message


def test_images_that_are_all_one_late_are_refused_with_the_shift(seen: Observations) -> None:
    late = on_the_right(seen, lambda v: replace(v, moment=f"{int(v.moment) + 1:02d}"))
    with pytest.raises(RefusedError, match=r"right is 1 image late: left01 goes with right01"):
        cb.calibrate_stereo(late)
    early = on_the_right(seen, lambda v: replace(v, moment=f"{int(v.moment) - 1:02d}"))
    with pytest.raises(RefusedError, match="right is 1 image early"):
        cb.calibrate_stereo(early)


def numbered_in_the_mirror(v: View) -> np.ndarray:
    """Rows of a view's points as a detector numbers the mirrored board, whose rows run the other way."""
    x, y = v.points[:, 0], v.points[:, 1].max() + v.points[:, 1].min() - v.points[:, 1]
    return np.array([int(np.argmin(np.hypot(v.points[:, 0] - a, v.points[:, 1] - b))) for a, b in zip(x, y)])


def flipped(v: View, width: int) -> View:
    uv = v.uv * [-1, 1] + [width - 1, 0]
    return replace(v, uv=uv[numbered_in_the_mirror(v)])


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_camera_that_delivers_mirror_images_is_named(seen: Observations, side: str) -> None:
    whole = replace(seen, views=tuple(v for v in seen.views if len(v) == 54))
    width = whole.image_sizes[side][0]
    mirrored = replace(whole, views=tuple(flipped(v, width) if v.camera == side else v for v in whole.views))
    with pytest.raises(RefusedError, match=rf"of \d+ do when the images of one camera .* Give mirror_{side}"):
        cb.calibrate_stereo(mirrored)


def test_a_board_seen_from_behind_is_said(seen: Observations) -> None:
    whole = replace(seen, views=tuple(v for v in seen.views if len(v) == 54))
    behind = on_the_right(whole, lambda v: replace(v, uv=v.uv[numbered_in_the_mirror(v)]))
    with pytest.raises(RefusedError, match="when one of them sees the board from behind"):
        cb.calibrate_stereo(behind)


@pytest.mark.parametrize("how", ["mirrored", "behind"])
def test_what_reflected_poses_are_off_by_against_differences(how: str) -> None:
    rng = np.random.default_rng(3)
    T, middle, h = se3.make(so3.exp([0.3, -0.2, 0.5]), [0.1, -0.05, 0.6])[None], np.array([0.1, 0.06, 0.0]), 1e-6
    L = rng.normal(size=(1, 6, 1))
    for mine, moved in zip(
        reflections(T, np.eye(6)[None], L, middle),
        reflections(se3.retract(T, h * L[:, :, 0]), np.eye(6)[None], L, middle),
        strict=True,
    ):
        if mine.how == how:
            np.testing.assert_allclose(se3.local(mine.T, moved.T) / h, mine.L[:, :, 0], atol=1e-5)


def test_an_image_that_was_lost_is_dated(seen: Observations) -> None:
    """The right camera dropped image 08: from there on its images come one early."""
    views = tuple(v for v in seen.views if (v.camera, v.moment) != ("right", "08"))
    lost = on_the_right(
        replace(seen, views=views),
        lambda v: replace(v, moment=f"{int(v.moment) - 1:02d}") if int(v.moment) > 8 else v,
    )
    message = cb.calibrate_stereo(lost).check("at-once").message
    assert "from left08 on, right is 1 image early" in message


def lost_from(seen: Observations, first: int) -> Observations:
    """As after an image of the right camera that was lost: from `first` on its images come one early."""
    views = tuple(v for v in seen.views if (v.camera, int(v.moment)) != ("right", first))
    return on_the_right(
        replace(seen, views=views),
        lambda v: replace(v, moment=f"{int(v.moment) - 1:02d}") if int(v.moment) > first else v,
    )


def test_half_of_the_pairs_that_are_none_do_not_move_the_place(seen: Observations) -> None:
    """Seven pairs and seven that are none: their mean is no place of the camera, and the noise of all no scale."""
    found = cb.calibrate_stereo(lost_from(seen, 7))
    check, whole = found.check("at-once"), cb.calibrate_stereo(seen)
    assert "from left07 on, right is 1 image early" in check.message
    d = 1e3 * (found.transform("left", "right").matrix - whole.transform("left", "right").matrix)[:3, 3]
    assert np.all(np.abs(d) < 4 * found.transform("left", "right").sigma_translation_mm)


def test_images_that_are_out_of_step_from_an_early_one_on_are_refused_with_where(seen: Observations) -> None:
    with pytest.raises(RefusedError, match=r"do when from left03 on, right is 1 image early: left04 goes with right04"):
        cb.calibrate_stereo(lost_from(seen, 3))


@pytest.mark.parametrize(("turn", "shift"), [(0.01, 2e-3), (0.0015, 3e-4)])
def test_cameras_that_moved_are_refused_with_when(turn: float, shift: float) -> None:
    T = standard_pair() @ se3.make(so3.exp([0, turn, 0]), [shift, 0, 0])
    before, after = stereo_scene(0).observations, stereo_scene(0, T_left_right=T).observations
    views = [v for v in before.views if v.moment < "07"] + [v for v in after.views if v.moment >= "07"]
    with pytest.raises(RefusedError, match=r"right moved against left by .* between left06 and left07"):
        cb.calibrate_stereo(replace(before, views=tuple(views)))


@pytest.mark.parametrize("seed", range(4))
def test_cameras_that_stood_still_are_not_accused(seed: int) -> None:
    names = {c.name for c in cb.calibrate_stereo(stereo_scene(10 + seed).observations).checks}
    assert names.isdisjoint({"cameras-moved", "at-once", "board-numbering"})


@pytest.mark.long
def test_both_eyes_number_a_board_alike() -> None:
    """Turned by half, the board looks the same: the right camera numbers some of its views from the other end."""
    scene = stereo_scene(5, target=BOARD)
    last = scene.points.max(axis=0)

    def turned(v: View) -> View:
        if v.moment not in ("01", "04", "09"):
            return v
        return replace(v, points=last - v.points, point_ids=len(scene.points) - 1 - v.point_ids)

    given = cb.calibrate_stereo(scene.observations)
    found = cb.calibrate_stereo(on_the_right(scene.observations, turned))
    check = found.check("board-numbering")
    assert check.status == "ok"
    assert "3 of 14 views were numbered again" in check.message
    np.testing.assert_allclose(
        found.transform("left", "right").matrix, given.transform("left", "right").matrix, atol=1e-7
    )
    assert found.figures["epipolar RMS"].value == pytest.approx(given.figures["epipolar RMS"].value, rel=1e-4)


def test_turns_that_nothing_tells_stay_as_given() -> None:
    F = np.stack([np.eye(4), se3.make(so3.exp([0, 0, np.pi]), [0, 0, 0])])
    R = so3.random(np.random.default_rng(0), 5)
    np.testing.assert_array_equal(which_turns(R[:1], R[1:2], F), [0])
    D = so3.exp([0.1, 0.2, 0.3])
    R_b = np.swapaxes(D, 0, 1) @ R
    np.testing.assert_array_equal(which_turns(R, R_b, F), np.zeros(5))
    mixed = R_b.copy()
    mixed[[1, 3]] = mixed[[1, 3]] @ F[1, :3, :3]
    np.testing.assert_array_equal(which_turns(R, mixed, F), [0, 1, 0, 1, 0])


def test_what_a_pose_is_off_by_against_differences() -> None:
    """A lens off by one sigma of one parameter moves the view's own pose by the column of L."""
    camera = standard_camera()
    scene = stereo_scene(2, sigma_px=(0.0, 0.0))
    view, T = scene.observations.views[0], scene.T_left_target[0]
    for k, step in enumerate([0.1] * 4 + [1e-4] * 4 + [1e-3]):
        covariance = np.zeros((9, 9))
        covariance[k, k] = step**2
        known = Camera(camera.model, camera.image_size, camera.values, covariance)
        ((_,), (L,)) = pose_errors(known, [view], T[None], np.array([0.1]))
        moved = camera.values.copy()
        moved[k] += step
        (other,) = poses_from(Camera(camera.model, camera.image_size, moved), [view], T[None])
        d = se3.local(T, other)
        # The sign of a column means nothing.
        np.testing.assert_allclose(L @ L.T, np.outer(d, d), rtol=0.05, atol=0.02 * float(d @ d))


@pytest.mark.statistics
def test_moves_are_claimed_as_often_as_said() -> None:
    """Noise and a shared error of its own covariance: of 2000 sessions one in ten thousand is accused; and steps of
    known size come back."""
    rng = np.random.default_rng(4)
    claims = 0
    for _ in range(2000):
        n, p = int(rng.integers(5, 20)), 3
        C = np.stack([(A := rng.normal(size=(6, 6))) @ A.T + 0.1 * np.eye(6) for _ in range(n)])
        L = rng.normal(size=(n, 6, p))
        d = np.einsum("nij,nj->ni", np.linalg.cholesky(C), rng.normal(size=(n, 6))) + L @ rng.normal(size=p)
        claims += move_between(d, C, L) is not None
        step = 100 * rng.normal(size=6)
        d[n // 2 :] += step
        move = move_between(d, C, L)
        assert move is not None
        assert move.first == n // 2
    assert claims <= 3  # 0.2 expected at most


def test_a_move_is_that_of_the_whole_covariance() -> None:
    """Step and what it explains, against least squares with the covariance of all moments laid out."""
    rng = np.random.default_rng(9)
    n, k, p = 9, 5, 3
    C = np.stack([(A := rng.normal(size=(6, 6))) @ A.T + 0.1 * np.eye(6) for _ in range(n)])
    L = rng.normal(size=(n, 6, p))
    d = np.einsum("nij,nj->ni", np.linalg.cholesky(C), rng.normal(size=(n, 6))) + L @ rng.normal(size=p)
    d[k:] += 100 * rng.normal(size=6)
    rows = L.reshape(6 * n, p)
    whole = rows @ rows.T
    for m in range(n):
        whole[6 * m : 6 * m + 6, 6 * m : 6 * m + 6] += C[m]
    weight = np.linalg.inv(whole)
    A = np.zeros((n, 6, 12))
    A[:, :, :6] = np.eye(6)
    A[k:, :, 6:] = np.eye(6)
    A = A.reshape(6 * n, 12)
    V = np.linalg.inv(A.T @ weight @ A)
    found = V @ (A.T @ weight @ d.ravel())
    move = move_between(d, C, L)
    assert move is not None
    assert move.first == k
    np.testing.assert_allclose(move.step, found[6:], rtol=1e-7)
    assert move.z == pytest.approx(found[6:] @ np.linalg.solve(V[6:, 6:], found[6:]), rel=1e-7)
    assert move.total == pytest.approx(d.ravel() @ weight @ d.ravel(), rel=1e-7)


def test_a_third_camera_numbers_alike_what_it_shares_with_one_that_is_not_its_pair() -> None:
    """Left and right see the board without middle once, each from its own end: middle ties them at the others."""
    camera, points = standard_camera(), grid(8, 6, 0.03)
    turns = {n: so3.exp([0, 0.1 * c, 0]) for c, n in enumerate(("left", "middle", "right"))}
    places = {n: se3.make(R, -R @ [0.1 * c, 0, 0]) for c, (n, R) in enumerate(turns.items())}
    boards = look_at_board(camera, points, 40, rng=np.random.default_rng(3), distance=(0.6, 0.9))
    views, n = [], 0
    for T in boards:
        uv = {name: camera.project(se3.apply(M @ T, points)) for name, M in places.items()}
        if n == 12 or not all(np.all((u > 0) & (u < np.array(camera.image_size) - 1)) for u in uv.values()):
            continue
        # Middle shares the most moments with both, left and right the one that it has not.
        names = ("left", "right") if n == 0 else ("left", "middle") if n % 2 else ("middle", "right")
        views += [View(f"{name}-{n}", points, uv[name], np.arange(48), name, moment=str(n)) for name in names]
        n += 1
    other = replace(views[1], points=points.max(axis=0) - points, point_ids=47 - np.arange(48))
    sizes, spec = dict.fromkeys(places, camera.image_size), "chessboard:8x6:30mm"
    result = cb.calibrate_rig(Observations((views[0], other, *views[2:]), sizes, spec))
    assert result.rms_px == pytest.approx(0, abs=1e-6)
    truth = places["left"] @ se3.inverse(places["right"])
    np.testing.assert_allclose(result.transform("left", "right").matrix, truth, atol=1e-6)
    assert "of right, 1 of 6 views were numbered again" in result.check("board-numbering").message


def test_one_picture_a_camera_of_lenses_given_as_exact_has_a_sigma_of_its_own_size() -> None:
    """A flat board in one picture tells nothing of a lens: that is no doubt of kilometres."""
    scene = stereo_scene(1)
    one = tuple(v for v in scene.observations.views if v.moment == "03")
    exact = {n: Camera(c.model, c.image_size, c.values) for n, c in scene.cameras.items()}
    result = cb.calibrate_rig(replace(scene.observations, views=one), cameras=exact)
    T = result.transform("left", "right")
    assert T.covariance is not None
    assert 1e-5 < np.sqrt(T.covariance[3, 3]) < 0.02
    assert normalised(T, scene.T_left_right) < 22.5
