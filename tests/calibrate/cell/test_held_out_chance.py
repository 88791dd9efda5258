"""Held-out errors and errors of whole images: warned of only where noise and what sigma holds do not explain them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrant.calibrate.cell.calibrate import fit_cell, judged_cell
from calibrant.calibrate.cell.certainty.image_causes import ASKED, no_cause_repeats
from calibrant.calibrate.cell.checks import LoopDeviations, held_out_check
from calibrant.calibrate.cell.held_out_chance import above_zero, held_out_chance
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.review.board_shape import SQUARES_UNTOLD
from calibrant.data import Check
from calibrant.simulate.cell import make_cell, observe_cell


def test_the_bound_holds_and_is_close() -> None:
    weights = np.array([1.0, 0.5, -2.0, -3.0, -1.0])
    x = np.random.default_rng(0).standard_normal((200_000, 5))
    share = np.mean(x**2 @ weights > 0)
    assert share < above_zero(weights) < 6 * share
    assert above_zero(-np.ones(3)) == 0.0
    assert above_zero(np.ones(3)) == 1.0


def test_few_poses_make_a_ratio_by_chance_and_no_more() -> None:
    cell = make_cell(3, views=9)
    fit = fit_cell(cell.robot_poses, [Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.1))])
    chances = [held_out_chance(fit.cell, fit.noise.solution, r) for r in (1.0, 3.0, 10.0, 100.0)]
    assert chances[0] == 1.0
    assert chances[-1] is not None
    assert chances[-1] < 1e-3
    assert sorted(chances, reverse=True) == chances


@pytest.mark.parametrize(("chance", "status"), [(0.5, "ok"), (1e-4, "warn"), (None, "warn")])
def test_the_check_follows_the_chance(chance: float | None, status: str) -> None:
    def all_at(mm: float) -> LoopDeviations:
        return LoopDeviations(np.full(5, mm), np.full(5, 0.1), np.zeros(0))

    check = held_out_check(all_at(2.5), all_at(1.0), chance)
    assert check.status == status
    assert "2.5 times the loop" in check.message


def test_images_are_excused_only_where_every_cause_was_asked() -> None:
    cell = make_cell(3, views=9)
    fit = fit_cell(cell.robot_poses, [Pictures("camera", "eye-in-hand", observe_cell(cell, sigma_px=0.1))])
    result = judged_cell(fit, {})
    fine = tuple(Check(name, "ok", "asked") for name in ASKED)
    assert no_cause_repeats(replace(result, checks=fine))
    # Of a lens that was given with its uncertainty nothing is asked, and what contradicts it counts all the same.
    assert no_cause_repeats(replace(result, checks=()), ["camera"])
    assert not no_cause_repeats(replace(result, checks=(Check("given-lens", "warn", "off"),)), ["camera"])
    assert not no_cause_repeats(replace(result, checks=fine[1:]))
    assert not no_cause_repeats(replace(result, checks=(*fine, Check("lens-model", "warn", "off"))))
    assert not no_cause_repeats(replace(result, checks=(*fine[1:], replace(fine[0], status="warn"))))
    assert not no_cause_repeats(replace(result, checks=(*fine, Check("board-squares", "ok", SQUARES_UNTOLD))))
