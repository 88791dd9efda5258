"""A worn arm is measured by a laser tracker: find its true geometry, and write the corrected URDF."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.formats.robots.read import read_robot
from calibrant.formats.robots.urdf import new_urdf
from calibrant.robots.arms import arm
from calibrant.simulate.robot_errors import measure, simulate_arm

rng = np.random.default_rng(11)
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    (folder / "arm.urdf").write_text(new_urdf(arm("ur5e")), encoding="utf-8")
    nominal = read_robot(folder / "arm.urdf").chain
    worn = simulate_arm(nominal, rng, sigma_mm=0.5, sigma_deg=0.1)  # every length and angle off by so much
    data = measure(worn, worn.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=None)  # positions alone
    lines = ["name,q1,q2,q3,q4,q5,q6,x[mm],y[mm],z[mm]"]
    for label, q, p in zip(data.ids, data.joints, data.positions):
        lines.append(",".join([label, *(f"{v:.9f}" for v in (*q, *(1e3 * p)))]))
    (folder / "tracker.csv").write_text("\n".join(lines), encoding="utf-8")

    result = cb.kinematics(
        robot=folder / "arm.urdf", measurements=folder / "tracker.csv", corrected=folder / "corrected.urdf"
    )
    corrected = read_robot(folder / "corrected.urdf").chain

print(result)

# New poses, in which nothing was measured: where is the tool, and where does the corrected model put it?
q = worn.draw_joints(np.random.default_rng(0), 200)
base, tool = (t.matrix for t in result.transforms)
sigma = max(t.sigma_translation_mm.max() for t in result.transforms)
off = (base @ corrected.forward(q) @ tool - worn.tool(q))[:, :3, 3]
print(f"\ntool off by {1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))):.3f} mm rms in 200 new poses;")
print(f"measured with 0.05 mm per axis; base and tool known to {sigma:.3f} mm (1 sigma, worst axis)")
