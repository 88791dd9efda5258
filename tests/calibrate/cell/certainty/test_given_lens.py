"""A lens that was given as exact and is not: named, in a cell of one camera or several, and held by sigma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibrant as cb
from calibrant.calibrate.cell.certainty import given_lens
from calibrant.calibrate.cell.certainty.doubts import doubted
from calibrant.cameras import Camera
from calibrant.data import Observations
from calibrant.geometry import se3
from calibrant.simulate.cell import Cell, make_cell, observe_cell
from calibrant.simulate.stereo import stereo_scene
from calibrant.simulate.truth import chi_square


@pytest.fixture(scope="module")
def cell() -> Cell:
    return make_cell(4, setup="eye-to-hand", views=25)


def _lens(cell: Cell, px: float) -> Camera:
    """The camera without its sigma, its principal point this far off."""
    values = np.array(cell.camera.values)
    values[cell.camera.model.parameter_names.index("cy")] += px
    return Camera(cell.camera.model, cell.camera.image_size, values)


@pytest.mark.long
def test_a_right_lens_is_not_named_and_costs_little(cell: Cell) -> None:
    seen = observe_cell(cell, sigma_px=0.1)
    result = cb.calibrate_hand_eye(cell.robot_poses, seen, setup="eye-to-hand", camera=_lens(cell, 0.0))
    assert "given-lens" not in {c.name for c in result.checks}
    camera = result.transforms[0]
    assert chi_square(se3.local(cell.X, camera.matrix), camera.covariance) < 22.5


@pytest.mark.long
def test_a_wrong_one_is_named_and_sigma_holds_it(cell: Cell) -> None:
    seen = observe_cell(cell, sigma_px=0.1)
    result = cb.calibrate_hand_eye(cell.robot_poses, seen, setup="eye-to-hand", camera=_lens(cell, 8.0))
    check = result.check("given-lens")
    assert check.status == "warn"
    assert "cy is 515.9 as given" in check.message
    camera = result.transforms[0]
    assert chi_square(se3.local(cell.X, camera.matrix), camera.covariance) < 22.5


def test_of_several_cameras_the_wrong_one_is_named(cell: Cell) -> None:
    pictures, lenses = [], {}
    for k, name in enumerate(("left", "right")):
        seen = observe_cell(replace(cell, seed=cell.seed + k), sigma_px=0.1)
        pictures.append(cb.Pictures(name, "eye-to-hand", seen.of_camera("camera")))
        lenses[name] = _lens(cell, 3.0 * k)
    result = cb.calibrate_cell(cell.robot_poses, pictures, cameras=lenses)
    # The other one sees the same board on the same robot, and is pulled along.
    found = {c.name: c.value or 0.0 for c in result.checks if c.name.startswith("given-lens")}
    assert max(found, key=lambda name: found[name]) == "given-lens-right"


def test_a_lens_that_is_off_by_little_is_doubted_by_that() -> None:
    """A centre two sigma off is beyond no test's threshold: what the cell cannot tell of it is in sigma."""
    names = ("fx", "fy", "cx", "cy")
    groups = given_lens.lens_groups(names)
    off, right, wrong = (
        doubted(0.25 * np.eye(4), np.array([0.0, 0.0, px, 0.0]), groups, given_lens.SPREADS).off
        for px in (1.0, 0.0, 10.0)
    )
    assert 0.1 < off[2, 2] < 0.6
    assert off[0, 0] < 0.5 * off[2, 2]
    assert 0 < np.max(np.diag(right)) < 0.25 * 0.25
    assert wrong[2, 2] == pytest.approx(100, rel=0.2)


def _pair(seed: int, px: float = 0.0) -> tuple[Observations, dict[str, Camera], np.ndarray]:
    """What a stereo pair saw, its lenses as exact with the left centre this far off, and where the right one is."""
    scene = stereo_scene(seed)
    lenses = {name: replace(camera, covariance=None) for name, camera in scene.cameras.items()}
    values = np.array(lenses["left"].values)
    values[lenses["left"].model.parameter_names.index("cx")] += px
    return scene.observations, lenses | {"left": replace(lenses["left"], values=values)}, scene.T_left_right


def test_lenses_of_a_rig_that_agree_cost_nothing() -> None:
    """With lenses known to next to nothing, which nobody doubts, the sigma is the same."""
    seen, lenses, _ = _pair(1)
    known = {
        name: replace(camera, covariance=np.diag(np.full(len(camera.values), 1e-14))) for name, camera in lenses.items()
    }
    results = [cb.calibrate_rig(seen, cameras=cameras) for cameras in (lenses, known)]
    exact, undoubted = (result.transform("left", "right") for result in results)
    assert exact.covariance is not None
    assert undoubted.covariance is not None
    assert np.sqrt(np.diag(exact.covariance)) == pytest.approx(np.sqrt(np.diag(undoubted.covariance)), rel=0.03)
    said, *others = [c for result in results for c in result.checks if c.name == "exact-lenses"]
    assert not others
    assert said.status == "ok"
    assert 1e-3 * (said.value or 0.0) > np.sqrt(np.trace(exact.covariance[3:, 3:]))


def test_a_wrong_lens_of_a_rig_is_named_and_sigma_holds_it() -> None:
    seen, lenses, T = _pair(1, px=4.0)
    result = cb.calibrate_rig(seen, cameras=lenses)
    assert {c.status for c in result.checks if c.name.startswith("given-lens")} == {"warn"}
    right = result.transform("left", "right")
    assert chi_square(se3.local(T, right.matrix), right.covariance) < 22.5
