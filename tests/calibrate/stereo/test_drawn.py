"""Pairs drawn with epipolar lines: curves that pass through the partners, of points that are spread out."""

from __future__ import annotations

import numpy as np

import calibrant as cb
from calibrant.calibrate.stereo.drawn import POINTS, drawn_pairs, spread_out
from calibrant.reports.html import report_page
from calibrant.simulate.stereo import stereo_scene


def test_curves_pass_through_the_partners() -> None:
    """Exact points: the polyline, whose pieces are some pixels long, misses the partner by its sagitta alone."""
    result = cb.calibrate_stereo(stereo_scene(1, sigma_px=(0.0, 0.0)).observations)
    pairs = drawn_pairs(result)
    assert len(pairs) >= 13
    for pair in pairs:
        assert len(pair.uv_left) <= POINTS
        for points, curves in ((pair.uv_left, pair.curves_left), (pair.uv_right, pair.curves_right)):
            for p, curve in zip(points, curves):
                assert len(curve) > 1
                assert to_polyline(p, curve) < 0.2
    rms = [pair.rms_px for pair in pairs]
    assert rms == sorted(rms, reverse=True)


def to_polyline(p: np.ndarray, curve: np.ndarray) -> float:
    a, d = curve[:-1], np.diff(curve, axis=0)
    along = np.clip(np.sum((p - a) * d, axis=1) / np.maximum(np.sum(d * d, axis=1), 1e-12), 0, 1)
    return float(np.linalg.norm(a + along[:, None] * d - p, axis=1).min())


def test_points_are_spread_out() -> None:
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [100.0, 0.0], [0.0, 100.0], [99.0, 1.0]])
    assert spread_out(uv, 3) == [0, 2, 3]
    assert len(spread_out(uv, 9)) == 5


def test_the_page_shows_pairs_and_a_rig_has_none() -> None:
    scene = stereo_scene(2)
    page = report_page(cb.calibrate_stereo(scene.observations))
    assert page.count('<svg class="pair"') == 12
    assert "polyline" in page
    rig = cb.calibrate_rig(scene.observations)
    assert drawn_pairs(rig) == ()
    assert '<svg class="pair"' not in report_page(rig)
