"""How well does kinematic calibration identify an arm? Simulated UR5e arms with errors, against their own truth.

    python benchmarks/kinematics.py                    20 arms a row
    python benchmarks/kinematics.py --arms 5

Each arm has errors of 0.5 mm and 0.1 degrees (1 sigma) in every geometric parameter, an unknown base and tool, and is
measured in random poses with 0.05 mm of noise an axis. The error is the distance of the predicted tool from the true
one in 300 new poses, rms; the target is 0.08 mm from 40 poses. The last column is the squared error of a predicted
position in units of its own covariance, 3 when the covariance tells the truth.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import numpy as np

from calibrant.calibrate.kinematics.identify import calibrate_kinematics
from calibrant.robots.arms import arm
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.links import as_links
from calibrant.simulate.robot_errors import measure, simulate_arm
from calibrant.simulate.truth import chi_square

SIGMA_MM = 0.05
REQUIRED_MM = 0.08


@dataclass(frozen=True)
class Trial:
    """Errors in new poses before and after, mm rms; normalised squared error of one position; parameters fitted."""

    before: float
    after: float
    normalised: float
    fitted: int


def run_trial(nominal: ParametricChain, seed: int, poses: int, sigma_deg: float | None) -> Trial:
    """One arm."""
    rng = np.random.default_rng(seed)
    simulated = simulate_arm(nominal, rng, sigma_mm=0.5, sigma_deg=0.1)
    data = measure(simulated, simulated.draw_joints(rng, poses), rng, sigma_mm=SIGMA_MM, sigma_deg=sigma_deg)
    calibration = calibrate_kinematics(data, nominal)
    q = simulated.draw_joints(rng, 300)
    truth = simulated.tool(q)[:, :3, 3]

    def rms(model_tool: np.ndarray) -> float:
        return 1e3 * float(np.sqrt(np.mean(np.sum((model_tool[:, :3, 3] - truth) ** 2, axis=1))))

    T, J = calibration.model.linearize(q[:1])
    C = J[0, 3:] @ calibration.covariance @ J[0, 3:].T
    e = T[0, :3, 3] - truth[0]
    return Trial(
        rms(calibration.nominal.predict(q)),
        rms(calibration.model.predict(q)),
        chi_square(e, C),
        len(calibration.fitted),
    )


def main() -> int:
    """Print the table; returns 1 when 40 poses do not reach what is required in the median."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=20)
    arms = parser.parse_args().arms
    ur = arm("ur5e")
    assert isinstance(ur, ParametricChain)
    passed = True
    print("model  measured             poses  fitted  before mm  after mm (median, worst)  normalised")
    for name, nominal in (("DH", ur), ("URDF", as_links(ur))):
        for sigma_deg in (None, 0.005):
            for poses in (20, 40, 80):
                trials = [run_trial(nominal, seed, poses, sigma_deg) for seed in range(arms)]
                after = np.array([t.after for t in trials])
                what = "positions" if sigma_deg is None else f"poses, {sigma_deg} deg"
                print(
                    f"{name:5s}  {what:19s}  {poses:5d}  {trials[0].fitted:6d}  "
                    f"{np.median([t.before for t in trials]):9.2f}  {np.median(after):8.3f}  {after.max():8.3f}"
                    f"          {np.mean([t.normalised for t in trials]):10.2f}"
                )
                passed &= poses != 40 or bool(np.median(after) <= REQUIRED_MM)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
