"""Servoing in a rendered cell: one seed arrives, by the truth, and the table says so."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calibrant.studies.servo_cell import Arrival, ServoCase, ServoStudy, servo_study, study_json

pytest.importorskip("mujoco")


@pytest.mark.long
def test_a_cell_that_was_calibrated_from_pictures_is_servoed_in() -> None:
    study = servo_study([1], ServoCase(control="image"))
    (run,) = study.runs
    assert run.passed, run.reason
    assert run.error_mm < 0.3
    assert run.error_deg < 0.1
    assert run.trace is not None
    assert run.trace.samples[-1].resting


@pytest.mark.long
def test_planar_control_arrives_as_far_as_the_arm_keeps_the_plane() -> None:
    """Its stops differ from the taught height and tilt by 0.1 to 0.3 mm and hundredths of a degree, which 0.35 m away
    is as much across: half a millimetre."""
    (run,) = servo_study([1], ServoCase(control="planar")).runs
    assert run.error_mm < 0.5
    assert run.error_deg < 0.1


@pytest.mark.long
@pytest.mark.xfail(reason="0.37 mm in the plane: height and tilt of the arm are taken for a shift", strict=False)
def test_planar_control_arrives_within_the_tolerance() -> None:
    (run,) = servo_study([1], ServoCase(control="planar")).runs
    assert run.passed, run.reason
    assert run.error_mm < 0.3


def test_the_table_says_what_failed_and_why() -> None:
    nan = float("nan")
    runs = (
        Arrival(0, 0, 0.1, 0.01, 0.2, 0.03, 30, 4.0, True, ""),
        Arrival(1, 0, nan, nan, nan, nan, 0, 1.0, False, "out of view"),
    )
    data = json.loads(study_json(ServoStudy(ServoCase(), runs, 0.9)))
    assert data["passed"] is False
    assert data["passed_share"] == 0.5
    assert data["median_mm"] == 0.1
    assert data["inside_99"] == 1
    assert data["runs"][1]["error_mm"] is None
    assert data["runs"][1]["reason"] == "out of view"
    assert np.isfinite(data["margin"])
