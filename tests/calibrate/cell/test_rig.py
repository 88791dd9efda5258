"""Rigs: exact on exact data, honest on noisy data, clear about what does not hang together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.rig import calibrate_rig
from calibrant.cameras import Camera
from calibrant.data import Observations, View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, standard_camera
from calibrant.simulate.truth import normalised

CAMERA, POINTS = standard_camera(), grid(8, 6, 0.03)
TURNS = [so3.exp([0, 0.1 * (c - 1), 0]) for c in range(3)]
T_CAMERA_RIG = np.stack([se3.make(R, -R @ [0.1 * (c - 1), 0.01 * c, 0]) for c, R in enumerate(TURNS)])
NAMES = ("left", "middle", "right")


def rig_scene(seed: int, *, sigma: float = 0.1, frames: int = 14) -> Observations:
    """Three cameras side by side; each sees the boards that lie wholly in its image."""
    rng = np.random.default_rng(seed)
    views = []
    for m, T in enumerate(look_at_board(CAMERA, POINTS, frames, rng=rng, distance=(0.4, 0.8))):
        for name, M in zip(NAMES, T_CAMERA_RIG):
            uv = CAMERA.project(se3.apply(M @ T, POINTS))
            if np.all(np.isfinite(uv)) and np.all((uv > 0) & (uv < np.array(CAMERA.image_size) - 1)):
                noisy = uv + sigma * rng.normal(size=uv.shape)
                views.append(View(f"{name}-{m}", POINTS, noisy, np.arange(len(POINTS)), name, moment=str(m)))
    return Observations(tuple(views), dict.fromkeys(NAMES, CAMERA.image_size))


def truth(a: int, b: int) -> np.ndarray:
    return T_CAMERA_RIG[a] @ se3.inverse(T_CAMERA_RIG[b])


def test_exact_data_give_the_exact_rig() -> None:
    result = calibrate_rig(rig_scene(0, sigma=0.0))
    for k in (1, 2):
        np.testing.assert_allclose(result.transform("left", NAMES[k]).matrix, truth(0, k), atol=1e-7)
    assert result.rms_px == pytest.approx(0, abs=1e-6)


@pytest.mark.statistics
def test_errors_match_their_covariance() -> None:
    """Normalised error of two transforms over seeds: 6 degrees of freedom each."""
    scores = []
    for seed in range(12):
        result = calibrate_rig(rig_scene(seed))
        for k in (1, 2):
            estimate = result.transform("left", NAMES[k])
            scores.append(normalised(estimate, truth(0, k)))
    # Mean of 24 values of deviation sqrt(12), in pairs correlated: 6 +- 1; three sigmas allowed.
    assert 3.0 < np.mean(scores) < 9.0


def test_the_reference_can_be_any_camera() -> None:
    observations = rig_scene(1)
    result = calibrate_rig(observations, reference="right")
    direct = calibrate_rig(observations).transform("left", "right")
    np.testing.assert_allclose(
        se3.inverse(result.transform("right", "left").matrix), direct.matrix, atol=1e-6
    )  # the solver's stop
    assert result.sigma_px == pytest.approx(0.1, rel=0.05)
    assert result.verdict == "ok"
    assert len(result.views) == len(observations.views)


def test_cameras_without_a_common_moment_are_named() -> None:
    scene = rig_scene(2)
    views = tuple(replace(v, moment=f"alone {v.moment}") if v.camera == "right" else v for v in scene.views)
    with pytest.raises(RefusedError, match="right saw the target at no moment together with left, middle"):
        calibrate_rig(replace(scene, views=views))


def test_a_rig_that_moved_is_refused_with_when() -> None:
    scene = rig_scene(3)
    later = {v.id for v in scene.views if v.camera == "right" and int(v.moment) >= 7}
    views = [replace(v, uv=v.uv + np.array([3.0, 0.0])) if v.id in later else v for v in scene.views]
    with pytest.raises(RefusedError, match=r"right moved against left .* between left-6 and left-7"):
        calibrate_rig(replace(scene, views=tuple(views)))


def test_a_rig_that_is_loose_is_noticed() -> None:
    """It swings: no single move parts the moments."""
    scene = rig_scene(3)
    loose = {v.id for v in scene.views if v.camera == "right" and int(v.moment) % 2}
    views = [replace(v, uv=v.uv + np.array([3.0, 0.0])) if v.id in loose else v for v in scene.views]
    check = calibrate_rig(replace(scene, views=tuple(views))).check("rigidity")
    assert check.status == "warn"
    assert "moved against each other" in check.message


def test_a_rig_is_a_cell_without_robots() -> None:
    """The cell's door and the rig's: the same numbers, checks and verdict."""
    scene = rig_scene(5)
    rig = cb.calibrate_rig(scene)
    cell = cb.calibrate_cell({}, [cb.Pictures(name, "handheld", scene.of_camera(name)) for name in NAMES])
    assert (cell.kind, cell.verdict, cell.checks) == (rig.kind, rig.verdict, rig.checks)
    assert [(t.parent, t.child) for t in rig.transforms] == [("left", "middle"), ("left", "right"), ("middle", "right")]
    for a, b in zip(cell.transforms, rig.transforms, strict=True):
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.covariance, b.covariance)
    assert rig.joint_covariance is not None
    assert rig.joint_covariance.frames == (("left", "middle"), ("left", "right"))
    own = rig.transform("left", "right").covariance
    assert own is not None
    np.testing.assert_allclose(rig.joint_covariance.matrix[6:, 6:], own, rtol=1e-9)
    np.testing.assert_allclose(rig.transform("middle", "right").matrix, truth(1, 2), atol=1e-3)


def test_cameras_with_known_lenses_are_held_to_them() -> None:
    scene = rig_scene(6)
    pictures = [cb.Pictures(name, "handheld", scene.of_camera(name)) for name in NAMES]
    known = Camera(CAMERA.model, CAMERA.image_size, CAMERA.values)
    result = cb.calibrate_cell({}, pictures, cameras=dict.fromkeys(NAMES, known))
    np.testing.assert_array_equal(result.cameras["right"].values, CAMERA.values)
    # Chi-square of 6 degrees of freedom: above 22.5 once in a thousand.
    assert normalised(result.transform("left", "right"), truth(0, 2)) < 22.5


def test_what_is_fixed_stays_fixed_in_the_rig() -> None:
    result = calibrate_rig(rig_scene(7), fix=("aspect", "k3"))
    for camera in result.cameras.values():
        assert camera.parameters["fx"] == pytest.approx(camera.parameters["fy"], rel=1e-12)
        assert camera.parameters["k3"] == 0
    assert result.options == {"model": "brown", "fix": ["aspect", "k3"], "reference": "left"}


def test_a_result_comes_back_from_its_file(tmp_path: Path) -> None:
    result = calibrate_rig(rig_scene(8))
    again = cb.read(result.write(tmp_path / "rig.json"))
    assert again.cell == result.cell
    assert again.summary() == result.summary()
    joint, found = again.joint_covariance, result.joint_covariance
    assert joint is not None
    assert found is not None
    assert joint.cameras == ("left", "middle", "right")
    np.testing.assert_allclose(joint.whole, found.whole, rtol=1e-12)


def test_the_joint_covariance_holds_the_lenses_with_the_places() -> None:
    """How far apart the axes are, and where the centres of the pictures lie, cannot be told one by one."""
    result = calibrate_rig(rig_scene(8))
    joint = result.joint_covariance
    assert joint is not None
    assert joint.lenses is not None
    own = result.cameras["left"].covariance
    assert own is not None
    np.testing.assert_allclose(joint.lenses[: len(own), : len(own)], own, rtol=1e-9)
    sigma = np.sqrt(np.diag(joint.whole))
    cx = 12 + result.cameras["left"].model.index("cx")
    assert abs(joint.whole[1, cx]) / (sigma[1] * sigma[cx]) > 0.3  # turn about y of left -> middle
    assert np.linalg.eigvalsh(joint.whole)[0] > -1e-12 * sigma.max() ** 2


def test_points_beyond_the_noise_are_left_out_of_the_rig() -> None:
    """A point that only the other cameras show to be wrong costs that point, not the view."""
    scene = rig_scene(9)
    spoilt = scene.views[4]
    uv = spoilt.uv.copy()
    uv[10] += 8.0
    views = tuple(replace(v, uv=uv) if v is spoilt else v for v in scene.views)
    view = next(v for v in calibrate_rig(replace(scene, views=views)).views if v.id == spoilt.id)
    assert view.used
    assert view.points == len(POINTS) - 1


def test_handheld_pictures_say_what_they_go_with() -> None:
    scene = rig_scene(4, frames=4)
    left = cb.Pictures("left", "handheld", scene.of_camera("left"))
    poses = cb.RobotPoses.from_matrices(np.stack([np.eye(4)] * 4))
    with pytest.raises(InputError, match="two cameras or more"):
        cb.calibrate_cell({}, [left])
    with pytest.raises(InputError, match="no pictures belong to robot 'robot'"):
        cb.calibrate_cell(poses, [left, cb.Pictures("right", "handheld", scene.of_camera("right"))])
    with pytest.raises(InputError, match="takes views, and no robot"):
        cb.Pictures("left", "handheld", scene.of_camera("left"), robot="a")
    with pytest.raises(InputError, match="without a robot see a target that is handheld"):
        cb.calibrate_cell({}, [cb.Pictures("left", "eye-in-hand", scene.of_camera("left"))])


def test_bad_input() -> None:
    scene = rig_scene(4)
    with pytest.raises(InputError, match="two cameras or more"):
        calibrate_rig(scene.of_camera("left"))
    with pytest.raises(InputError, match="no camera 'top'"):
        calibrate_rig(scene, reference="top")


# Two kinds of eyes: each camera has its own size and model, is known, guessed or found, and is held in part.

LENS = {"fx": 300.0, "fy": 300.0, "cx": 322.0, "cy": 238.0, "k1": 0.02, "k2": -0.01}
WIDE = Camera.create("kannala_brandt", LENS, image_size=(640, 480))


def mixed_scene(seed: int, *, sigma: float) -> Observations:
    """A long lens and a wide one at half the resolution, turned by a quarter about the optical axis."""
    rng = np.random.default_rng(seed)
    views = []
    for m, T in enumerate(look_at_board(CAMERA, POINTS, 14, rng=rng, distance=(0.4, 0.6))):
        for name, camera, M in (("long", CAMERA, np.eye(4)), ("wide", WIDE, T_WIDE_LONG)):
            uv = camera.project(se3.apply(M @ T, POINTS))
            inside = np.all((uv > 0) & (uv < np.array(camera.image_size) - 1), axis=1)
            noisy = uv[inside] + sigma * rng.normal(size=(int(inside.sum()), 2))
            views.append(View(f"{name}-{m}", POINTS[inside], noisy, np.flatnonzero(inside), name, moment=str(m)))
    return Observations(tuple(views), {"long": CAMERA.image_size, "wide": WIDE.image_size})


T_WIDE_LONG = se3.make(so3.exp([0.02, 0.1, np.pi / 2]), [0.05, -0.02, 0.01])


@pytest.mark.parametrize("known", ["found", "given", "guessed"])
def test_cameras_of_two_models_and_sizes_are_exact_on_exact_data(known: str) -> None:
    near = replace(WIDE, values=WIDE.values * 1.001)
    given = {"given": {"cameras": {"wide": WIDE}}, "guessed": {"initial": {"wide": near}}}.get(known, {})
    result = calibrate_rig(mixed_scene(3, sigma=0.0), model={"wide": "kannala_brandt"}, **given)  # type: ignore[arg-type]
    np.testing.assert_allclose(result.transform("long", "wide").matrix, se3.inverse(T_WIDE_LONG), atol=1e-6)
    assert {n: c.model.name for n, c in result.cameras.items()} == {"long": "brown", "wide": "kannala_brandt"}
    np.testing.assert_allclose(result.cameras["wide"].values, WIDE.values, rtol=1e-5, atol=1e-5)


def test_what_is_held_of_one_camera_is_free_in_the_other() -> None:
    result = calibrate_rig(rig_scene(7), fix={"left": ("k3",), "right": ("focal",)}, initial={"right": CAMERA})
    left, middle, right = (result.cameras[n].sigma for n in NAMES)
    assert left["k3"] == 0
    assert left["fx"] > 0
    assert min(middle.values()) > 0
    assert right["fx"] == right["fy"] == 0
    assert right["k3"] > 0
    assert result.cameras["right"].parameters["fx"] == CAMERA.parameters["fx"]
    assert result.options["fix"] == {"left": ["k3"], "right": ["focal"]}


def test_a_camera_known_better_than_its_photos_say_tightens_where_it_is() -> None:
    scene = rig_scene(9)
    alone = calibrate_rig(scene)
    held = calibrate_rig(scene, cameras=dict.fromkeys(NAMES, CAMERA))
    assert normalised(held.transform("left", "right"), truth(0, 2)) < 23  # chi-square of 6, 99.9 %
    smaller = np.diag(held.transform("left", "right").covariance) / np.diag(alone.transform("left", "right").covariance)
    assert np.all(smaller < 1)


def test_cameras_that_are_not_there_or_given_twice_are_named() -> None:
    with pytest.raises(InputError, match="intrinsics of camera 'top', which has no pictures; there are left, middle"):
        calibrate_rig(rig_scene(1), cameras={"top": CAMERA})
    with pytest.raises(InputError, match="`fix` of camera 'top'"):
        calibrate_rig(rig_scene(1), fix={"top": ("k3",)})
    with pytest.raises(InputError, match="'left' is given twice"):
        calibrate_rig(rig_scene(1), cameras={"left": CAMERA}, initial={"left": CAMERA})
