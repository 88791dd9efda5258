"""Two direct linear transforms beside a calibrated pair: exact on exact points, the pair ahead where lenses bend."""

from __future__ import annotations

import pytest

from calibrant.studies.scenes import Conditions
from calibrant.studies.stereo_pair import DISTANCES, compared_pairs


def test_both_are_exact_on_exact_points_of_lenses_without_distortion() -> None:
    found = compared_pairs(Conditions(noise_px=0.0, lens="pinhole", views=3))
    assert [row.refused for row in found.rows] == [None, None]
    assert max(e for row in found.rows for e in row.error_mm) < 1e-6


@pytest.mark.long
def test_the_calibrated_pair_is_ahead_and_more_so_far_away_and_with_distortion() -> None:
    plain, bent = (compared_pairs(Conditions(lens=lens)) for lens in ("pinhole", "brown:-0.1"))
    for found in (plain, bent):
        dlt, pair = (row.error_mm for row in found.rows)
        assert len(dlt) == len(pair) == len(DISTANCES)
        assert all(p < d for d, p in zip(dlt, pair))
    ratio = [b.error_mm[-1] / b.error_mm[1] for b in plain.rows]
    assert ratio[0] > ratio[1]
    assert bent.rows[0].error_mm[0] > 5 * plain.rows[0].error_mm[0]
    assert bent.rows[1].error_mm[0] < 1.5 * plain.rows[1].error_mm[0]
