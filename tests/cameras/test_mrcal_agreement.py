"""Agreement with mrcal's own projections, where it has the model: an independent implementation, to 1e-9 px.

mrcal is Debian's python3-mrcal, which lives with the system's Python: it runs there, in a process of its own.
"""

from __future__ import annotations

import json

import numpy as np
from tests.peers import MRCAL

from calibrant.cameras import Camera, camera_model

SIZE = (1280, 1024)
PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
TERMS = dict(
    zip(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
        (-0.28, 0.09, 8e-4, -1.1e-3, -0.012, 0.01, 0.02, -0.005, 1e-3, -1e-3, 2e-3, 5e-4),
    )
)
SCRIPT = """
import json, sys
import numpy, mrcal
out = []
for model, values, points, pixels in json.load(sys.stdin):
    projected = mrcal.project(numpy.array(points), model, numpy.array(values))
    rays = mrcal.unproject(numpy.array(pixels), model, numpy.array(values), normalize=True)
    out.append([projected.tolist(), rays.tolist()])
json.dump(out, sys.stdout)
"""
GRID = "splined:16x12:120deg"


def ask(*questions: tuple[str, list[float], np.ndarray, np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """mrcal's pixels of points and unit rays of pixels, for each (model, intrinsics, points, pixels)."""
    given = json.dumps([[m, list(v), p.tolist(), uv.tolist()] for m, v, p, uv in questions])
    return [(np.array(q), np.array(v)) for q, v in json.loads(MRCAL.ask(SCRIPT, given.encode()))]


def points(reach_deg: float) -> np.ndarray:
    """Points (300, 3) up to an angle from the axis."""
    rng = np.random.default_rng(91)
    angle, around = np.deg2rad(reach_deg) * np.sqrt(rng.uniform(0, 1, 300)), rng.uniform(0, 2 * np.pi, 300)
    d = np.stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=-1)
    return d * rng.uniform(0.3, 3, (300, 1))


def compared(cases: list[tuple[str, list[float], Camera, np.ndarray]]) -> None:
    """Pixels to 1e-9, and the rays back."""
    pixels = [camera.project(p) for _, _, camera, p in cases]
    answers = ask(*((model, values, p, uv) for (model, values, _, p), uv in zip(cases, pixels)))
    for (model, _, camera, p), uv, (projected, rays) in zip(cases, pixels, answers):
        assert np.isfinite(uv).all(), model
        np.testing.assert_allclose(uv, projected, atol=1e-9, rtol=0, err_msg=model)
        # mrcal's search for the ray ends within 2e-11 rad of ours (measured): 2e-8 px.
        np.testing.assert_allclose(camera.unproject(uv), rays, atol=1e-10, rtol=0, err_msg=model)
        np.testing.assert_allclose(camera.unproject(uv), p / np.linalg.norm(p, axis=1)[:, None], atol=1e-11)


def test_opencvs_models() -> None:
    cases = []
    for ours, theirs, count in (
        ("pinhole", "LENSMODEL_PINHOLE", 0),
        ("brown", "LENSMODEL_OPENCV4", 4),
        ("brown", "LENSMODEL_OPENCV5", 5),
        ("rational", "LENSMODEL_OPENCV8", 8),
        ("thin_prism", "LENSMODEL_OPENCV12", 12),
    ):
        terms = dict(list(TERMS.items())[:count])
        camera = Camera.create(ours, {**PIXELS, **terms}, image_size=SIZE)
        cases.append((theirs, [*PIXELS.values(), *terms.values()], camera, points(35)))
    compared(cases)


def test_stereographic() -> None:
    """mrcal's u = 2 tan(theta / 2): the unified model with xi = 1 and twice the focal length; division l1 = -1/4."""
    values = [400.0, 401.0, 645.0, 507.0]
    double = Camera.create("unified", {**PIXELS, "fx": 800.0, "fy": 802.0, "xi": 1.0}, image_size=SIZE)
    division = Camera.create("division", {**PIXELS, "fx": 400.0, "fy": 401.0, "l1": -0.25}, image_size=SIZE)
    compared([("LENSMODEL_STEREOGRAPHIC", values, camera, points(120)) for camera in (double, division)])


def test_splined_stereographic() -> None:
    """Same grid, same surface; mrcal's control points alternate x and y, and go on beyond the grid, where ours ends."""
    kind = camera_model(GRID)
    rng = np.random.default_rng(92)
    values = kind.starting_values(400.0, np.array([645.0, 507.0]))
    values[4:] += rng.normal(0, 0.02, len(values) - 4)
    nodes = (len(values) - 4) // 2
    theirs = np.stack([values[4 : 4 + nodes], values[4 + nodes :]], axis=-1).ravel()
    model = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=12_fov_x_deg=120"
    p = points(58)
    p = p[kind.valid(values, p)]
    assert len(p) > 200
    compared([(model, [*values[:4], *theirs], Camera(kind, SIZE, values), p)])
