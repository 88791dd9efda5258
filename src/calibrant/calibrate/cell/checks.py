"""What a finished cell is asked: each question by figures that its calibration found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.image_poses import ImagePoses
from calibrant.calibrate.cell.starts.handheld import CameraPair
from calibrant.calibrate.intrinsics.shared_errors import SAID
from calibrant.calibrate.review.review import MOMENTS
from calibrant.calibrate.solvers.motion import MotionReport
from calibrant.data import Check, Measured, SigmaRobot, TransformEstimate, ViewResult
from calibrant.data.details import CameraClock, CameraClocks
from calibrant.optimize.clusters import LEAST_CLUSTERS
from calibrant.optimize.solution import Solution

if TYPE_CHECKING:
    from calibrant.calibrate.kinematics.identify import IdentifiedParameter

LOOP_WARN, LOOP_FAIL = 0.05, 0.30
"""Loop spread over the size of the motion: 5 % is 10 mm over 200 mm, 30 % is no agreement worth the name."""
SCALE_SIGMAS = 3.0
SCALE_WARN = 0.005
"""A printed board is off by up to 0.5 % (a printer's scaling, paper and humidity); more is a wrong size."""
SCALE_FAIL = 1.1
"""A page that is fitted to its paper shrinks by up to 6 %; more than a tenth is another target, or of unknown scale."""
NOTHING = 0.001
"""Millimetres and degrees: the finest that makers state of a robot's repeatability is ten times that."""
FEW_USED_SHARE = 2 / 3
STRETCH_CHANCE = 1e-3
"""Chance that views left out for no common reason are the first or the last ones: one set of a thousand."""
HELD_OUT_FACTOR = 2.0
"""Leaving one of n poses out inflates the error by about 1 + 6 / n: below twofold nobody need ask."""
HELD_OUT_CHANCE = 1e-3
"""Of a thousand sets whose errors are noise, one is warned of at most."""
NOTHING_MM = 1e-6
FEW_SHARED_MOMENTS = 5
"""Pairs with fewer common moments rest on single pictures: one blurred board bends the rig."""
TOGETHER_WARN = 1.5
"""Noise of a camera in the common fit over its own: a common pose for all leaves it nearly as it is, a few per cent."""


@dataclass(frozen=True, eq=False)
class LoopDeviations:
    """Distance (n,), mm, and angle (n,), deg, between where views see their target and where the robots put it, and for
    images the pixels (m,), rms of each view, between what it saw and what the robots predict."""

    mm: Array
    deg: Array
    px: Array

    @property
    def rms(self) -> tuple[float, float]:
        """Millimetres and degrees; views weigh alike."""
        return float(np.sqrt(np.mean(self.mm**2))), float(np.sqrt(np.mean(self.deg**2)))

    @property
    def rms_px(self) -> float | None:
        """Pixels; views weigh alike: over all points, full boards would weigh more."""
        return float(np.sqrt(np.mean(self.px**2))) if len(self.px) else None


def loop_check(loop: LoopDeviations, score: float) -> Check:
    """Is the transform that must be constant constant? score: the loop's typical error over the size of the motion."""
    mm, deg = loop.rms
    text = f"the loop closes to {mm:.3g} mm / {deg:.2g} deg rms over the views used"
    if score > LOOP_FAIL:
        message = (
            f"{text}, {score:.0%} of the motion: robot and camera do not describe the same motion; check "
            "pose convention, units, pairing and the target's size"
        )
        return Check("loop", "fail", message, mm)
    if score > LOOP_WARN:
        return Check("loop", "warn", f"{text}, {score:.0%} of the motion: expect no better accuracy", mm)
    return Check("loop", "ok", text, mm)


def loop_score(loop: LoopDeviations, B: Array) -> float:
    """The loop's rms over the size of the motion, by positions of T_camera_target (n, 4, 4); 0 where nothing moves."""
    t = 1e3 * B[:, :3, 3]
    size = float(np.linalg.norm(t - t.mean(axis=0), axis=1).mean())
    return loop.rms[0] / size if size > 0 and len(B) > 1 else 0.0


def through_others_check(reason: str) -> Check:
    """A list that determines nothing by itself: its frames are known through the others."""
    return Check("motion", "ok", f"found through the other pictures; by themselves: {reason}")


def views_check(views: Sequence[ViewResult]) -> Check:
    """How many poses were used."""
    used, n = sum(v.used for v in views), len(views)
    cameras = {v.camera for v in views}
    text = f"{used} of {n} poses used"
    if used < n:
        out = [v.id if len(cameras) == 1 else f"{v.camera}: {v.id}" for v in views if not v.used]
        text += f"; left out: {', '.join(out)}{_as_one_stretch(views) if len(cameras) == 1 else ''}"
    if used < FEW_USED_SHARE * n:
        return Check("views", "warn", f"{text}. More than a third is missing: look for a common cause", float(used))
    stretch = len(cameras) == 1 and _as_one_stretch(views)
    return Check("views", "warn" if stretch else "ok", text, float(used))


def _as_one_stretch(views: Sequence[ViewResult]) -> str:
    """What it means that those left out are the first or the last ones; nothing where they are spread, or may be by
    chance: there are n over k ways to choose k of n, and two are stretches at an end."""
    n, out = len(views), [i for i, v in enumerate(views) if not v.used]
    k = len(out)
    if 2 / comb(n, k) > STRETCH_CHANCE or out not in (list(range(k)), list(range(n - k, n))):
        return ""
    first = k if out[0] == 0 else n - k
    end = "first" if out[0] == 0 else "last"
    return (
        f" (the {end} {k} in one stretch: did the camera, the board or the robot's stand move between "
        f"{views[first - 1].id} and {views[first].id}? Calibrate each part by itself)"
    )


def together_check(camera: str, together: float, own: float) -> Check:
    """Does a camera fit into the whole as well as it fits by itself? Both noise levels in pixels."""
    ratio = together / own
    text = f"{camera}: {together:.3g} px noise together with the others, {own:.3g} px by itself"
    if ratio > TOGETHER_WARN:
        text += (
            ": the cameras moved against each other or against the target, or their photos of one pose were not "
            "taken at one pose"
        )
    return Check(f"together-{camera}", "warn" if ratio > TOGETHER_WARN else "ok", text, ratio)


def shared_moments_check(pairs: Sequence[CameraPair]) -> Check:
    """Is every camera of a rig tied to the others by moments enough?"""
    weakest = min(pairs, key=lambda p: p.shared)
    moments = f"{weakest.shared} common moment{'' if weakest.shared == 1 else 's'}"
    text = f"{weakest.a} and {weakest.b} are tied by {moments}, the fewest of the rig"
    few = weakest.shared < FEW_SHARED_MOMENTS
    if few:
        text += f"; {FEW_SHARED_MOMENTS} or more make it reliable"
    if weakest.shared < LEAST_CLUSTERS:
        text += ", and so few do not tell what the pictures of a moment err alike by: sigma holds nothing of it"
    return Check("shared-moments", "warn" if few else "ok", text, float(weakest.shared))


def second_start_check(camera: str, apart_mm: float, first_px: float, second_px: float) -> Check:
    """Does a fit that starts from other pairs of cameras end elsewhere? The better one is taken."""
    taken, other = sorted((first_px, second_px))
    message = (
        f"a start from other pairs of cameras ends elsewhere: it places {camera} {apart_mm:.3g} mm away; of "
        f"{taken:.3g} and {other:.3g} px noise the former is taken. Pictures of a moment contradict each other, or "
        "too few tie the cameras: look at the other warnings, or add pictures that more cameras share"
    )
    return Check("second-start", "warn", message, apart_mm)


def loose_rig(together: float, own: float) -> bool:
    """Whether a rig errs by more than its cameras by themselves."""
    return together / own > TOGETHER_WARN


def explained_by(level: float, together: float, own: float) -> bool:
    """Whether half of what a rig errs by, beyond its cameras by themselves, is gone at this noise level, squares."""
    return level**2 - own**2 <= EXPLAINED * (together**2 - own**2)


def rigidity_check(together: float, own: float, clocks: CameraClocks | None = None) -> Check:
    """Do the cameras of a rig hold still to each other? Both noise levels in pixels, over all cameras; clocks: what
    offsets of their clocks the residuals show."""
    ratio = together / own
    text = f"{together:.3g} px noise with the cameras fixed to each other, {own:.3g} px each for itself"
    loose = ratio > TOGETHER_WARN
    if loose:
        late = [] if clocks is None else [c for c in clocks.clocks if _late(c)]
        moved = "they moved against each other, or the views of a moment were not taken at once"
        text += f": {_clock_words(late) if late else moved}"
    return Check("rigidity", "warn" if loose else "ok", text, ratio)


EXPLAINED = 0.5
"""What is left of the squares that a rig errs by where clocks are their cause; cameras that moved leave more, with
clocks too."""
CLOCK_SIGMAS = 4.0
"""Of an offset that the residuals show beside all else that disturbs them: one chance in 16,000."""


def _late(clock: CameraClock) -> bool:
    offset, sigma = clock.offset_ms, clock.offset_sigma_ms
    return offset is not None and sigma is not None and abs(offset) > CLOCK_SIGMAS * sigma


def _clock_words(late: Sequence[CameraClock]) -> str:
    said = ", ".join(f"{c.camera} {c.offset_ms:+.1f} ± {c.offset_sigma_ms:.1f} ms" for c in late)
    return f"their residuals follow the target's motion, as if taken late by {said}; --time-offsets finds them"


def clocks_check(found: CameraClocks) -> Check:
    """The clocks that were asked for: their offsets and readout times, in the sigma of all else."""
    said = []
    for clock in found.clocks:
        parts = []
        if clock.offset_ms is not None:
            parts.append(f"late by {clock.offset_ms:+.2f} ± {clock.offset_sigma_ms:.2f} ms")
        if clock.readout_ms is not None:
            parts.append(f"read in {clock.readout_ms:.2f} ± {clock.readout_sigma_ms:.2f} ms")
        said.append(f"{clock.camera} {', '.join(parts)}")
    worst = max((max(c.offset_sigma_ms or 0.0, c.readout_sigma_ms or 0.0) for c in found.clocks), default=0.0)
    return Check("clocks", "ok", f"against {found.reference}: {'; '.join(said)}", worst)


def moments_check(times: float) -> Check:
    """What is told of errors that all pictures of a moment share; sigma holds them, so that nothing is to be done."""
    if times < SAID:
        return Check(MOMENTS, "ok", "moments err independently of each other, as far as they show", times)
    text = "the pictures of a moment err alike: every sigma holds it and is"
    return Check(MOMENTS, "ok", f"{text} {times:.1f} times what independent points would have", times)


def motion_checks(report: MotionReport) -> tuple[Check, ...]:
    """The findings about the motions, as checks."""
    return tuple(Check(f.name, f.status, f.message, f.value) for f in report.findings)


def scale_check(scale: Measured | None, at_that_size: tuple[float, float] | None, loop: LoopDeviations) -> Check:
    """Does the target's size fit the robots' motion? at_that_size: what the loop closes to then, mm and deg."""
    if scale is None:
        return Check("target-size", "warn", "the motions cannot tell whether the target's size is right")
    off = abs(scale.value - 1)
    text = f"the robot's motion says the target is {scale.value:.4f} ± {scale.sigma:.4f} times the size given"
    if off <= SCALE_SIGMAS * scale.sigma:
        return Check("target-size", "ok", text, scale.value)
    text += "; sigma holds the difference"
    if off <= SCALE_WARN:
        return Check("target-size", "ok", text, scale.value)
    if at_that_size is not None:
        (mm, deg), (now_mm, now_deg) = at_that_size, loop.rms
        text += f"; at that size the loop closes to {mm:.3g} mm / {deg:.2g} deg instead of {now_mm:.3g} mm / "
        text += f"{now_deg:.2g} deg"
    if max(scale.value, 1 / scale.value) > SCALE_FAIL:
        message = f"{text}: give its real size, or --target-scale free for one that nobody knows"
        return Check("target-size", "fail", message, scale.value)
    return Check("target-size", "warn", f"{text}: measure the target, all distances scale with it", scale.value)


def image_poses_check(
    found: ImagePoses | None, robot: SigmaRobot | None, *, repeats: bool = True, given: bool = False
) -> tuple[Check, ...]:
    """Whose noise is it: the robot's, or that of target poses from images that err as a whole?

    repeats: whether a cause may stand behind it that all images share (`no_cause_repeats`), which no sigma holds;
    given: the lens came from elsewhere.
    """
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
    text = (
        f"the target poses from the images err like points of {found.px:.2g} px, {ratio:.2g} times the points' scatter "
        f"({found.scatter_px:.2g} px)"
    )
    beside = (
        f"Beside them the robot errs by {_size(found.robot_mm, 'mm')} / {_size(found.robot_deg, 'deg')}; its noise "
        f"stated, {robot.mm:.2g} mm / {robot.deg:.2g} deg, is both"
    )
    if not repeats:
        message = f"{text}: points of an image err alike, anew in each; sigma holds it. {beside}"
        if given:
            message += (
                ". Whether a cause repeats in all images is asked where the lens is found from them, without --camera"
            )
        return (Check("image-poses", "ok", message, ratio),)
    cure = (
        "leave --camera out, so that the lens is found from these images, or give one with its uncertainty"
        if given
        else "try calibrant intrinsics --target-shape paraboloid, and a camera from more views (--camera)"
    )
    message = (
        f"{text}: the lens model, a bent board, or how points are found. {beside}. What all images share no sigma "
        f"knows: {cure}"
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


def held_out_ratio(held: LoopDeviations, loop: LoopDeviations) -> float:
    """How much larger errors in millimetres are where a pose was left out."""
    return held.rms[0] / max(loop.rms[0], 1e-9)


def held_out_check(held: LoopDeviations, loop: LoopDeviations, chance: float | None) -> Check:
    """Does the calibration predict poses that it has not seen as well as those it has?

    chance: at most so often noise alone makes a difference as large (`held_out_chance`); None where that is not known.
    """
    mm, deg = held.rms
    ratio = held_out_ratio(held, loop)
    text = f"a pose left out of the calibration is predicted to {mm:.3g} mm / {deg:.2g} deg rms"
    if ratio <= HELD_OUT_FACTOR or mm <= NOTHING_MM:
        return Check("held-out", "ok", text, ratio)
    text = f"{text}, {ratio:.1f} times the loop"
    if chance is not None and chance > HELD_OUT_CHANCE:
        return Check("held-out", "ok", f"{text}, as noise makes it for so few poses; sigma holds it", ratio)
    message = (
        f"{text}, more than so few poses explain: single poses, the lens or the board carry it. Take more poses, in "
        "all of the workspace, and look at the largest errors in the report"
    )
    return Check("held-out", "warn", message, ratio)


def certainty_check(t: TransformEstimate) -> Check:
    """How certain is the camera's position?"""
    sigma_mm = np.asarray(t.sigma_translation_mm)
    axes = ", ".join(f"{s:.2g}" for s in sigma_mm)
    text = f"the camera's position in the {t.parent} frame is known to ({axes}) mm (1 sigma along x, y, z)"
    return Check("certainty", "ok", text, float(np.linalg.norm(sigma_mm)))


def joints_check(parameters: Sequence[IdentifiedParameter]) -> Check:
    """What was found of a robot's joints, in words."""
    from calibrant.calibrate.kinematics.identify import figure

    found = [p for p in parameters if p.sigma is not None]
    held = [p for p in parameters if p.sigma is None]
    text = "; ".join(
        f"{p.parameter.name} {figure(p.correction, p.parameter.unit)} ± {figure(p.sigma or 0.0, p.parameter.unit)}"
        for p in found
    )
    more = f"; held: {', '.join(f'{p.parameter.name} ({p.reason})' for p in held)}" if held else ""
    if not found:
        return Check("joints", "warn", f"nothing of the robot's joints can be told from these pictures{more}", 0.0)
    return Check("joints", "ok", f"{text}{more}", float(len(found)))
