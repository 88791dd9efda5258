"""Calibrate a camera from points: lists of target points and the pixels where they were seen, a pair a view.

The views here come from a simulated camera, so the truth is known and stands beside every estimate.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import calibrant as cb
from calibrant.simulate.scenes import intrinsics_scene

scene = intrinsics_scene(20, seed=1)  # 20 views of 88 corners, 0.1 px of noise
points = [view.points for view in scene.observations.views]  # (n, 3) metres, target frame
uv = [view.uv for view in scene.observations.views]  # (n, 2) pixels

observations = cb.Observations.from_points(points, uv, image_size=(1280, 1024))
result = cb.calibrate_intrinsics(observations, model="brown")

print(f"verdict {result.verdict}; RMS {result.rms_px:.3f} px, noise {result.sigma_px:.3f} px per axis")
print(f"{'':4} {'truth':>12} {'found':>12} {'sigma':>10}")
for name, truth in scene.camera.parameters.items():
    found, sigma = result.camera.parameters[name], result.camera.sigma[name]
    print(f"{name:4} {truth:12.5f} {found:12.5f} {sigma:10.5f}")
    assert abs(found - truth) < 5 * sigma, f"{name} is further from the truth than it should ever be"

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "camera.json"
    result.write(path)
    again = cb.read(path)
print("read back:", again.camera.parameters["fx"] == result.camera.parameters["fx"])
