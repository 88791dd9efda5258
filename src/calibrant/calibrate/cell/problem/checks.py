"""Checks of a calibration of several cameras and robots that its own figures answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.checks import LOOP_WARN, SCALE_SIGMAS, SCALE_WARN, convergence_check
from calibrant.calibrate.cell.problem.layout import STANDING
from calibrant.calibrate.cell.problem.problem import Several, geometry_variable, pixel_group
from calibrant.data import Check, Measured, TransformEstimate, ViewResult
from calibrant.optimize.noise import NoiseEstimate
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]

HELD_OUT_FACTOR = 2.0
"""Leaving one of n poses out inflates the error by about 1 + 6 / n; twofold means single poses carry the result."""

TOGETHER_WARN = 1.5
"""Noise of a camera in the joint fit over its own: a common pose for all leaves it nearly as it is, a few per cent."""


@dataclass(frozen=True, eq=False)
class LoopDeviations:
    """Distance (mm) and angle (deg) between where each used view sees its target and where the robot puts it, and the
    pixels (rms) between what it saw and what the robot predicts."""

    mm: Array
    deg: Array
    px: Array

    @property
    def rms(self) -> tuple[float, float]:
        """Millimetres and degrees."""
        return float(np.sqrt(np.mean(self.mm**2))), float(np.sqrt(np.mean(self.deg**2)))

    @property
    def rms_px(self) -> float:
        """Pixels; views weigh alike."""
        return float(np.sqrt(np.mean(self.px**2)))


def several_checks(
    several: Several,
    noise: NoiseEstimate,
    loop: LoopDeviations,
    held: LoopDeviations | None,
    views: Sequence[ViewResult],
    transforms: Sequence[TransformEstimate],
    scales: Mapping[str, Measured],
) -> tuple[Check, ...]:
    """Everything that is asked of the result."""
    checks = [_views_check(views), _loop_check(several, loop), *_pixel_checks(several, noise)]
    if held is not None:
        checks.append(_held_out_check(loop, held))
    checks += _scale_checks(several, scales)
    checks += [_certainty_check(t) for t in transforms if t.child in several.layout.cameras]
    checks += [_joints_check(several, robot, noise.solution) for robot in several.free]
    return (*checks, convergence_check(noise.solution, noise.settled, noise.rounds))


def _views_check(views: Sequence[ViewResult]) -> Check:
    used = sum(v.used for v in views)
    out = [f"{v.camera}: {v.id}" for v in views if not v.used]
    text = f"{used} of {len(views)} views used" + (f"; left out: {', '.join(out[:8])}" if out else "")
    return Check("views", "warn" if used < len(views) * 2 / 3 else "ok", text, float(used))


def _loop_check(several: Several, loop: LoopDeviations) -> Check:
    """Are robots and cameras of one opinion?"""
    mm, deg = loop.rms
    motion = [d.B[d.use][:, :3, 3] for p, d in zip(several.layout.pictures, several.data) if p.setup != STANDING]
    size = max((1e3 * float(np.linalg.norm(t - t.mean(axis=0), axis=1).mean()) for t in motion if len(t)), default=0.0)
    text = f"cameras and robots agree on the targets to {mm:.3g} mm / {deg:.2g} deg rms"
    if size > 0 and mm > LOOP_WARN * size:
        return Check("loop", "warn", f"{text}, {mm / size:.0%} of the motion: expect no better accuracy", mm)
    return Check("loop", "ok", text, mm)


def _pixel_checks(several: Several, noise: NoiseEstimate) -> list[Check]:
    """Does every camera fit into the whole as well as it fits by itself? Only where others could contradict it."""
    if len(several.layout.cameras) < 2:
        return []
    out = []
    for camera in several.layout.cameras:
        own = max(d.sigma_px for p, d in zip(several.layout.pictures, several.data) if p.camera == camera)
        together = noise.levels[pixel_group(camera)].sigma
        ratio = together / own
        text = f"{camera}: {together:.3g} px noise together with the others, {own:.3g} px by itself"
        if ratio > TOGETHER_WARN:
            text += (
                ": the cameras moved against each other or against the target, or their photos of one pose were not "
                "taken at one pose"
            )
        out.append(Check(f"together-{camera}", "warn" if ratio > TOGETHER_WARN else "ok", text, ratio))
    return out


def _held_out_check(loop: LoopDeviations, held: LoopDeviations) -> Check:
    (mm, deg), ratio = held.rms, held.rms[0] / max(loop.rms[0], 1e-9)
    text = f"views left out of the calibration are predicted to {mm:.3g} mm / {deg:.2g} deg rms"
    if ratio > HELD_OUT_FACTOR and mm > 1e-6:
        return Check("held-out", "warn", f"{text}, {ratio:.1f} times the loop: single poses carry the result", ratio)
    return Check("held-out", "ok", text, ratio)


def _scale_checks(several: Several, scales: Mapping[str, Measured]) -> list[Check]:
    """Does every target's size fit the robots' motion?"""
    targets = list(dict.fromkeys(p.target for p in several.layout.pictures))
    out = [_scale_check(scales.get(t)) for t in targets]
    if len(targets) == 1:
        return out
    return [replace(c, name=f"{c.name}-{t}", message=f"{t}: {c.message}") for c, t in zip(out, targets)]


def _scale_check(scale: Measured | None) -> Check:
    if scale is None:
        return Check("target-size", "warn", "the motions cannot tell whether the target's size is right")
    text = f"the robots' motion says the target is {scale.value:.4f} ± {scale.sigma:.4f} times the size given"
    off = abs(scale.value - 1)
    if off > SCALE_WARN and off > SCALE_SIGMAS * scale.sigma:
        return Check("target-size", "warn", f"{text}: measure it, all distances scale with it", scale.value)
    return Check("target-size", "ok", text, scale.value)


def _certainty_check(t: TransformEstimate) -> Check:
    sigma = np.asarray(t.sigma_translation_mm)
    axes = ", ".join(f"{s:.2g}" for s in sigma)
    text = f"{t.child} in the frame of {t.parent} is known to ({axes}) mm (1 sigma along x, y, z)"
    return Check(f"certainty-{t.parent}-{t.child}", "ok", text, float(np.linalg.norm(sigma)))


def _joints_check(several: Several, robot: str, solution: Solution) -> Check:
    """What was found of a robot's joints, in words."""
    from calibrant.calibrate.kinematics.identify import figure

    rows = several.free[robot].parameters(solution, geometry_variable(robot))
    found = [p for p in rows if p.sigma is not None]
    held = [p for p in rows if p.sigma is None]
    text = "; ".join(
        f"{p.parameter.name} {figure(p.correction, p.parameter.unit)} ± {figure(p.sigma or 0.0, p.parameter.unit)}"
        for p in found
    )
    more = f"; held: {', '.join(f'{p.parameter.name} ({p.reason})' for p in held)}" if held else ""
    if not found:
        return Check("joints", "warn", f"nothing of the robot's joints can be told from these pictures{more}", 0.0)
    return Check("joints", "ok", f"{text}{more}", float(len(found)))
