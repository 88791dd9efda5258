"""The error of a pose that was left out is that of any new pose, by a camera that has seen neither."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import CellFit, fit_cell
from calibrant.calibrate.cell.fitted import Value
from calibrant.calibrate.cell.held_out import fit_without, folds, leave_out
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.cell import Cell, make_cell, observe_cell

VIEWS, NEW = 5, 12


def fitted(seed: int) -> tuple[Cell, CellFit, list[View], list[View]]:
    """A cell calibrated from five views, these, and twelve others."""
    cell = make_cell(seed, views=VIEWS + NEW)
    seen = observe_cell(cell, sigma_px=0.3)
    order = np.random.default_rng(seed).permutation(VIEWS + NEW)
    some, new = ([seen.views[k] for k in part] for part in (order[:VIEWS], order[VIEWS:]))
    fit = fit_cell(cell.robot_poses, [Pictures("camera", "eye-in-hand", replace(seen, views=tuple(some)))])
    return cell, fit, some, new


def errors(cell: Cell, fit: CellFit, value: Value, views: list[View]) -> Array:
    """How far the views see their target, by this lens, from where the robot puts it, mm."""
    lens = fit.cell.roles["camera"].camera
    camera = Camera(lens.model, lens.image_size, value("lens of camera")[0])
    rows = [cell.robot_poses.ids.index(v.id) for v in views]
    A = cell.robot_poses.T_base_gripper[rows]
    predicted = se3.inverse(value("T_gripper_camera")[0]) @ se3.inverse(A) @ value("T_base_target")[0]
    return se3.mm_and_deg(se3.local(predicted, target_poses(camera, views).T_camera_target))[0]


def test_a_view_left_out_is_seen_by_the_lens_of_the_others() -> None:
    cell, fit, some, _ = fitted(1)
    solution, (fold,) = fit.noise.solution, folds(fit.cell)
    held = leave_out(fit.cell, solution)
    assert held is not None
    focal = solution.value("lens of camera")[0, 0]
    values = [fit_without(fit.cell, solution, [fold == k]) for k in range(VIEWS)]
    assert np.ptp([value("lens of camera")[0, 0] for value in values]) > 1e-3 * focal
    for k, (value, mm) in enumerate(zip(values, held.mm)):
        np.testing.assert_allclose(errors(cell, fit, value, some)[k], mm, rtol=1e-3)


@pytest.mark.statistics
def test_a_free_lens_is_not_counted_twice() -> None:
    ratios = []
    for seed in range(15):
        cell, fit, _, new = fitted(seed)
        solution, (fold,) = fit.noise.solution, folds(fit.cell)
        held = leave_out(fit.cell, solution)
        assert held is not None
        squares = [np.inf]
        with contextlib.suppress(InputError):  # a lens from four views that the picture's corner is outside of
            squares = [errors(cell, fit, fit_without(fit.cell, solution, [fold == k]), new) ** 2 for k in range(VIEWS)]
        ratios.append(held.rms[0] / float(np.sqrt(np.mean(squares))))
    # Fifteen sets of five errors each: the median is known to 0.13. By the lens of all five poses it was 1.5.
    assert 0.65 < np.median(ratios) < 1.25
