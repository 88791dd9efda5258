"""What a rig is asked as a whole: another start, moments left out, who saw what together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.calibrate.cell.test_rig import CAMERA, NAMES, rig_scene, truth

from calibrant.calibrate.cell.calibrate import CellFit
from calibrant.calibrate.cell.fitted import fitted_places
from calibrant.calibrate.cell.problem.problem import cell_problem
from calibrant.calibrate.cell.rig import calibrate_rig, fit_rig
from calibrant.calibrate.cell.rig_checks import better_start
from calibrant.calibrate.cell.starts.handheld import fewest, handheld_start
from calibrant.data.details import SharedMoments
from calibrant.geometry import se3, so3
from calibrant.optimize.levenberg_marquardt import SolverOptions, solve


def fitted(seed: int) -> CellFit:
    return fit_rig(rig_scene(seed, frames=24), cameras=dict.fromkeys(NAMES, CAMERA))


def test_another_tree_starts_at_the_same_rig() -> None:
    fit = fit_rig(rig_scene(0, sigma=0.0, frames=24), cameras=dict.fromkeys(NAMES, CAMERA))
    layout, data = fit.cell.layout, fit.cell.data
    places, pairs = handheld_start(layout, data, rank=fewest)
    first, usual = handheld_start(layout, data)
    assert [p.shared for p in pairs] <= [p.shared for p in usual]
    for frame in layout.unknown:
        np.testing.assert_allclose(places[frame], first[frame], atol=1e-6)


def test_a_fit_that_ended_elsewhere_is_left_for_the_better_one() -> None:
    """A solve that stopped with a camera half a metre off is as one that ended in another valley."""
    fit = fitted(1)
    at = fitted_places(fit.cell, fit.noise.solution)
    frame = ("left", "right")
    wrong = {**at, frame: at[frame] @ se3.make(so3.exp([0.0, 0.5, 0.0]), [-0.5, 0.1, 0.1])}
    problem = cell_problem(fit.cell, wrong, dict(fit.noise.solution.sigmas))
    there = solve(problem, options=SolverOptions(max_iterations=0))
    level = replace(fit.noise.levels["pixel"], sigma=5.0)
    stopped = replace(fit.noise, solution=there, levels={"pixel": level})
    better, _, checks = better_start(fit.cell, stopped, fit.cell)
    assert [c.name for c in checks] == ["second-start"]
    np.testing.assert_allclose(better.solution.value("T_left_right")[0], at[frame], atol=1e-4)


def test_a_good_fit_is_not_fitted_twice() -> None:
    fit = fitted(2)
    noise, cell, checks = better_start(fit.cell, fit.noise, fit.cell)
    assert noise is fit.noise
    assert cell is fit.cell
    assert checks == ()


def test_moments_left_out_say_what_the_fit_hides() -> None:
    result = calibrate_rig(rig_scene(3, frames=40), cameras=dict.fromkeys(NAMES, CAMERA))
    held, there = (result.figures[k].value for k in ("held-out RMS", "RMS there in the fit"))
    assert there <= held < 1.1 * there
    assert "held-out RMS" not in calibrate_rig(rig_scene(3, frames=12)).figures


def test_who_saw_the_board_together() -> None:
    scene = rig_scene(4)
    shared = calibrate_rig(scene).detail(SharedMoments)
    assert shared is not None
    assert shared.cameras == NAMES
    moments = [{v.moment for v in scene.views if v.camera == name} for name in NAMES]
    assert shared.counts == tuple(tuple(len(a & b) for b in moments) for a in moments)


def test_a_camera_that_lies_about_its_lens_is_no_other_end() -> None:
    """Data that are off have one best end from wherever: nothing is said of a second one."""
    scene = rig_scene(5)
    loose = {v.id for v in scene.views if v.camera == "right" and int(v.moment) % 2}
    views = tuple(replace(v, uv=v.uv + np.array([3.0, 0.0])) if v.id in loose else v for v in scene.views)
    result = calibrate_rig(replace(scene, views=views))
    assert result.check("rigidity").status == "warn"
    assert "second-start" not in {c.name for c in result.checks}
    assert result.transform("left", "middle").matrix == pytest.approx(truth(0, 1), abs=0.02)
