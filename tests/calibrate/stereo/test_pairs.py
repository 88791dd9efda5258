"""Points of pairs under a lens model that does not reach them: left out, not an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.calibrate.stereo.edges import triangulated_edges
from calibrant.calibrate.stereo.pairs import seen_by_both, triangulated
from calibrant.simulate.stereo import stereo_scene


def test_points_without_a_ray_are_left_out() -> None:
    """Distortion folds the picture far out: no ray comes to a pixel there. All other points are as they were."""
    scene = stereo_scene(3, sigma_px=(0.0, 0.0))
    left, right = scene.cameras.values()
    views = [scene.observations.of_camera(name).views for name in scene.cameras]
    pair = max(seen_by_both(*views), key=lambda p: len(p.points))
    whole = triangulated(pair, left, right, scene.T_left_right)
    uv = pair.uv_left.copy()
    uv[[0, 7]] = 3000.0
    off = replace(pair, uv_left=uv)
    assert np.isnan(left.unproject(uv[:1])).all()
    found = triangulated(off, left, right, scene.T_left_right)
    kept = np.isfinite(found).all(axis=1)
    assert np.flatnonzero(~kept).tolist() == [0, 7]
    np.testing.assert_allclose(found[kept], whole[kept], rtol=1e-12)
    edges = triangulated_edges([off], left, right, scene.T_left_right)
    assert edges is not None
    assert edges.rms_mm < 1e-4
    uv[:] = 3000.0
    assert triangulated_edges([off], left, right, scene.T_left_right) is None
