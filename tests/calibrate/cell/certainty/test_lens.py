"""A lens that the robot's poses bend is named and held by sigma; one that they help stays as certain as that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import CellFit, fit_cell
from calibrant.calibrate.cell.certainty.checks import lens_shift_check
from calibrant.calibrate.cell.certainty.lens import LensShift, lens_shift
from calibrant.calibrate.cell.problem.groups import lens_variable
from calibrant.calibrate.cell.problem.layout import Pictures, variable
from calibrant.cameras import Camera
from calibrant.simulate.cell import make_cell, observe_cell

LENS = lens_variable("camera")


@pytest.fixture(scope="module")
def fit() -> CellFit:
    cell = make_cell(5, views=12)
    return fit_cell(cell.robot_poses, [Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.2))])


def _photos_had_it(fit: CellFit, sigmas: float, *, smooth: float = 0.5) -> LensShift:
    """The shift where the photos alone put cy this many of their sigmas away."""
    role, solution = fit.cell.roles["camera"], replace(fit.noise.solution, beside=None)
    values = solution.value(LENS)[0].copy()
    values[3] -= sigmas * role.camera.sigma["cy"]
    camera = Camera(role.camera.model, role.camera.image_size, values, role.camera.covariance)
    found = lens_shift(solution, LENS, replace(role, camera=camera), smooth=smooth)
    assert found is not None
    return found


def test_where_robot_and_photos_agree_little_is_added(fit: CellFit) -> None:
    solution, found = replace(fit.noise.solution, beside=None), _photos_had_it(fit, 0.0)
    i = solution.problem.structure.placements[solution.problem.variable_index(LENS)]
    assert i is not None
    rows = i.offset[0] + np.arange(i.dim)
    added = np.diag(found.covariance)[rows] / np.diag(solution.shared_covariance)[rows]
    assert added.max() < 0.5
    assert not found.bent
    assert not lens_shift_check(fit.cell.roles["camera"].camera, found)


def test_an_arm_whose_poses_show_no_smooth_errors_is_believed_of_the_lens(fit: CellFit) -> None:
    added = [np.trace(_photos_had_it(fit, 1.0, smooth=chance).covariance) for chance in (0.0, 0.1, 0.5, 0.9)]
    assert added[0] == 0
    assert all(np.diff(added) > 0)


def test_a_lens_that_the_robot_bends_is_named_and_held(fit: CellFit) -> None:
    found = _photos_had_it(fit, 8.0)
    assert found.bent
    (check,) = lens_shift_check(fit.cell.roles["camera"].camera, found)
    assert check.status == "warn"
    assert "cy" in check.message
    assert check.name == "lens-by-robot"
    (of_rig,) = lens_shift_check(fit.cell.roles["camera"].camera, found, rig=True)
    assert of_rig.name == "lens-by-others"
    assert of_rig.message.startswith("the other cameras bend the lens")
    solution = replace(fit.noise.solution, beside=found.covariance)
    # As far off as it is, or more.
    assert np.sqrt(solution.covariance(LENS)[3, 3]) > 0.7 * abs(found.moved[3])
    frame = fit.cell.layout.unknown[0]
    name = variable(frame)
    more, plain = (np.trace(s.covariance(name)) for s in (solution, replace(solution, beside=None)))
    assert more > 1.5 * plain
