"""Checks of a hand-eye calibration that its own figures answer."""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.cell.loop.image_poses import ImagePoses
from calibrant.calibrate.cell.loop.noise import LoopNoise
from calibrant.calibrate.cell.starts.seed import Seed
from calibrant.calibrate.cell.views import HandEyeViews
from calibrant.calibrate.solvers.loop_errors import LoopErrors
from calibrant.calibrate.solvers.motion import MotionReport
from calibrant.calibrate.solvers.setup import SETUPS, Setup
from calibrant.data import Check, HeldOut, SigmaRobot
from calibrant.optimize.solution import Solution

SETUP_RATIO = 3.0
"""The other setup is the right one when its loop is this many times more consistent: noise moves the ratio of two loops
over the same poses by tens of per cent, a wrong setup by factors of ten and more."""
LOOP_WARN, LOOP_FAIL = 0.05, 0.30
"""Loop spread over the size of the motion: 5 % is 10 mm over 200 mm, 30 % is no agreement worth the name."""
SCALE_SIGMAS = 3.0
SCALE_WARN = 0.005
"""A printed board is off by up to 0.5 % (a printer's scaling, paper and humidity); more is a wrong size."""
NOTHING = 0.001
"""Millimetres and degrees: the finest that makers state of a robot's repeatability is ten times that."""
FEW_USED_SHARE = 2 / 3


def setup_check(setup: Setup, seed: Seed, other: Seed | None) -> Check:
    """Does the other setup explain the data better? `other` is None when it has no solution at all."""
    alternative = next(s for s in SETUPS.values() if s.name != setup.name)
    if other is None:
        return Check("setup", "ok", f"only {setup.name} explains the poses")
    ratio = seed.loop.score / max(other.loop.score, 1e-12)
    figures = (
        f"loop {seed.loop.median_mm:.3g} mm / {seed.loop.median_deg:.2g} deg as {setup.name}, "
        f"{other.loop.median_mm:.3g} mm / {other.loop.median_deg:.2g} deg as {alternative.name} (medians)"
    )
    if ratio > SETUP_RATIO:
        message = (
            f"the data fit {alternative.description}, not {setup.name}: {figures}; use --setup {alternative.name}, "
            "or check whether the poses are inverted"
        )
        return Check("setup", "fail", message, float(ratio))
    if ratio > 1 / SETUP_RATIO:
        return Check(
            "setup", "warn", f"both setups fit about equally well, the data do not tell which it is: {figures}", ratio
        )
    return Check("setup", "ok", figures, float(ratio))


def loop_check(seed: Seed, loop: LoopErrors) -> Check:
    """Is the transform that must be constant constant?"""
    text = f"the loop closes to {loop.rms_mm:.3g} mm / {loop.rms_deg:.2g} deg rms over the views used"
    if seed.loop.score > LOOP_FAIL:
        message = (
            f"{text}, {seed.loop.score:.0%} of the motion: robot and camera do not describe the same motion; check "
            "pose convention, units, pairing and the target's size"
        )
        return Check("loop", "fail", message, loop.rms_mm)
    if seed.loop.score > LOOP_WARN:
        return Check(
            "loop", "warn", f"{text}, {seed.loop.score:.0%} of the motion: expect no better accuracy", loop.rms_mm
        )
    return Check("loop", "ok", text, loop.rms_mm)


def views_check(data: HandEyeViews) -> Check:
    """How many poses were used."""
    used, n = int(data.use.sum()), len(data) + len(data.left_out)
    text = f"{used} of {n} poses used"
    if used < n:
        text += f"; left out: {', '.join(name for name, _ in data.missing)}"
    if used < FEW_USED_SHARE * n:
        return Check("views", "warn", f"{text}. More than a third is missing: look for a common cause", float(used))
    return Check("views", "ok", text, float(used))


def motion_checks(report: MotionReport) -> tuple[Check, ...]:
    """The findings about the motions, as checks."""
    return tuple(Check(f.name, f.status, f.message, f.value) for f in report.findings)


def scale_check(size: LoopNoise | None, loop: LoopErrors) -> Check:
    """Does the target's size fit the robot's motion?"""
    if size is None:
        return Check("target-size", "warn", "the motions cannot tell whether the target's size is right")
    scale = size.size
    off = abs(scale.value - 1)
    text = f"the robot's motion says the target is {scale.value:.4f} ± {scale.sigma:.4f} times the size given"
    if off > SCALE_WARN and off > SCALE_SIGMAS * scale.sigma:
        mm, deg = size.rms
        message = (
            f"{text}; at that size the loop closes to {mm:.3g} mm / {deg:.2g} deg instead of {loop.rms_mm:.3g} mm / "
            f"{loop.rms_deg:.2g} deg: measure the target, all distances scale with it"
        )
        return Check("target-size", "warn", message, scale.value)
    return Check("target-size", "ok", text, scale.value)


def image_poses_check(found: ImagePoses | None, robot: SigmaRobot | None) -> tuple[Check, ...]:
    """Whose noise is it: the robot's, or that of target poses from images that err as a whole?"""
    if found is None or robot is None:
        return ()
    ratio = found.px / found.scatter_px
    if not found.evident:
        message = (
            f"what the points' scatter does not explain is the robot's: {robot.mm:.2g} mm / {robot.deg:.2g} deg; "
            f"errors that all points of an image share would show from {found.shows_px:.2g} px on (scatter "
            f"{found.scatter_px:.2g} px); smaller ones are counted as the robot's"
        )
        return (Check("image-poses", "ok", message, ratio),)
    message = (
        f"the target poses from the images err like points of {found.px:.2g} px, {ratio:.2g} times the points' scatter "
        f"({found.scatter_px:.2g} px): all points of an image are off together, by the lens model, a board that is not "
        f"flat, or how its points are found. Beside them the robot errs by {_size(found.robot_mm, 'mm')} / "
        f"{_size(found.robot_deg, 'deg')}; the robot noise stated, {robot.mm:.2g} mm / {robot.deg:.2g} deg, is both. "
        "What they have in common from image to image no sigma knows: try calibrant intrinsics --target-shape "
        "paraboloid, and a camera calibrated from more views (--camera)"
    )
    return (Check("image-poses", "warn", message, ratio),)


def _size(value: float, unit: str) -> str:
    """A noise level; one of nearly nothing is what the fit leaves when the images explain all, no measurement."""
    return f"{value:.2g} {unit}" if value >= NOTHING else f"under {NOTHING} {unit}"


def convergence_check(solution: Solution, settled: bool, rounds: int) -> Check:
    """Did the refinement end at a minimum, and the noise levels settle?"""
    if not solution.converged:
        return Check("convergence", "fail", f"{solution.message} ({solution.iterations} steps)")
    if not settled:
        return Check("convergence", "warn", f"the noise levels had not settled after {rounds} rounds; take more poses")
    return Check("convergence", "ok", f"{solution.message}; noise levels settled in {rounds} rounds", float(rounds))


def held_out_check(held_out: HeldOut, loop: LoopErrors) -> Check:
    """Does the calibration predict poses that it has not seen as well as those it has?"""
    ratio = (held_out.mm or 0.0) / max(loop.rms_mm, 1e-9)
    text = f"a pose left out of the calibration is predicted to {held_out.mm:.3g} mm / {held_out.deg:.2g} deg rms"
    # Leaving one of n poses out inflates the error by about 1 + 6 / n; twofold means single poses carry the result.
    if ratio > 2 and (held_out.mm or 0.0) > 1e-6:
        return Check(
            "held-out", "warn", f"{text}, {ratio:.1f} times the loop: too few poses, or single poses carry it", ratio
        )
    return Check("held-out", "ok", text, ratio)


def sigma_check(sigma_mm: np.ndarray, parent: str) -> Check:
    """How certain is the camera's position?"""
    total = float(np.linalg.norm(sigma_mm))
    axes = ", ".join(f"{s:.2g}" for s in sigma_mm)
    text = f"the camera's position in the {parent} frame is known to ({axes}) mm (1 sigma along x, y, z)"
    return Check("certainty", "ok", text, total)
