"""What the motions can determine, asked before anything is solved.

Per pose, rotation noise sigma (rad, one axis, robot and camera together). With the relative rotation vectors alpha_ij
of all n (n - 1) / 2 pairs, the information about a small turn of X is

    I = 1/n sum_{i<j} (|alpha|^2 I_3 - alpha alpha^T),     Cov(turn of X) = sigma^2 I^-1

(the 1/n because the pairs share n poses). Its smallest eigenvalue, lambda, is the summed square of the rotations off
the dominant axis. When all axes are parallel lambda holds noise alone, 2 (n - 1) sigma^2 on average; when nothing
rotates, all rotation is noise, 3 (n - 1) sigma^2. The translation of X has the information sum (R_i - R_mean)^T
(R_i - R_mean), whose null space is the common axis: the same motions decide both.

Sources: Tsai and Lenz 1989 (two motions with non-parallel axes are needed); Andreff, Horaud, Espiau 2001 (what pure
translations and planar motions leave open); Chen 1991 (the screws of A and B are congruent: equal angle and pitch).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Index
from calibrant.calibrate.solvers import screws
from calibrant.calibrate.solvers.relative import PosePairs, odd_part, pose_pairs, sample
from calibrant.data.results import Check
from calibrant.errors import RefusedError, causes
from calibrant.geometry import se3

SIGMA_ROTATION = (5e-5, np.deg2rad(1.0))
"""Bounds of the rotation noise of a pose, rad. Below: no robot with a camera is better than 0.003 degrees, so data
without noise are not trusted to more. Above: a disagreement of more than a degree is a fault in the data, not noise,
and must not excuse motions."""

NOISE_FACTOR = 9.0
"""Rotations count as seen when their summed square is this many times what noise alone would show (3 sigma). Just there
the closed forms, whose rotations carry the noise on both sides, are biased by 1/9 and good to no more than some
degrees."""

WARN_DILUTION = 5.0
"""Warn when the noise of a single pose comes out this many times larger in X: poses turned well (n = 10, by 30 degrees
about changing axes) give less than 1, so the data are then worth some 25 times fewer poses."""

FEW_POSES = 5
"""Fewer distinct poses give at most 24 equations for the 12 unknowns of X and Z: little is left to check them by."""

FEW_FOR_MEDIAN = 10
"""With fewer poses the median of the differences is itself uncertain by a third and more, and often far too small:
degenerate motions would pass."""

MANY_POSES = 50
"""Distinct poses are counted up to here; nothing depends on more, and comparing all with all takes time."""

SAME_POSE_METRES = 1e-5
"""Poses closer than this, and than the least rotation noise, count once; robots repeat to 0.01 mm at best."""

AGREEMENT_OF_CHANCE = 0.5
"""Screws of A and B that differ by half of what wrongly paired motions differ by do not belong together: noise of a per
cent of the motion gives about 0.01, random pairing gives 1."""

AGREEMENT_AS_A_WHOLE = 0.1
"""Whole translations that agree to a tenth of what chance would give belong together, whatever advances say: no X
brings wrong pairs below 0.38, nor lengths that are wrong by 3 and more below 0.24 (98 of 100 scenes of 6 poses)."""

SAME_NUMBERS = 1e-9
"""Entries that differ by less (metres, or of a rotation matrix) are the same number, read or computed twice."""

DEGENERATE = ("poses", "same-poses", "pure-translation", "parallel-axes", "half-turns")
"""The findings that leave X undetermined when they fail."""


@dataclass(frozen=True)
class MotionFinding(Check):
    """A check of the motions. `direction` (unit vector, frame of the report) is what cannot be observed, or badly."""

    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class MotionReport:
    """What the motions determine.

    sigma_rotation_deg: noise of a pose's rotation that the angles of A and B show (one axis, 1 sigma);
    predicted_rotation_deg: what that noise leaves in X about its worst axis (inf when undetermined).
    """

    findings: tuple[MotionFinding, ...]
    poses: int
    sigma_rotation_deg: float
    predicted_rotation_deg: float

    @property
    def degenerate(self) -> tuple[MotionFinding, ...]:
        """The failed findings that leave X undetermined."""
        return tuple(f for f in self.findings if f.status == "fail" and f.name in DEGENERATE)

    def finding(self, name: str) -> MotionFinding | None:
        """The finding of that name; None when it was not asked, because an earlier one failed or the poses are few."""
        return next((f for f in self.findings if f.name == name), None)

    def require_determined(self) -> None:
        """Raises: RefusedError naming every degeneracy, with the motion that would cure it."""
        if self.degenerate:
            raise RefusedError(causes(f"{f.name}: {f.message}" for f in self.degenerate))


def motion_report(A: ArrayLike, B: ArrayLike, *, frame: str = "gripper") -> MotionReport:
    """What the motions of A_i X B_i = Z can determine.

    Args: A (n, 4, 4), B (n, 4, 4) = T_camera_target, metres; frame, how messages call A's child frame, in which the
    axes are given: "gripper" for eye-in-hand, "base" for eye-to-hand.
    Raises: InputError for shapes that do not match or matrices that are not rigid.
    """
    pairs = pose_pairs(A, B)
    report = report_of(pairs, frame=frame)
    same = _same_poses_finding(pairs)
    return replace(report, findings=(*report.findings[:1], *same)) if same else report


def report_of(pairs: PosePairs, *, frame: str = "gripper") -> MotionReport:
    """`motion_report` of pairs that are checked already, for closed forms: to these a camera in the robot's own frame
    is a place like any other, which no data that were measured would say."""
    distinct = _distinct_poses(pairs)
    poses = _poses_finding(distinct, len(pairs))
    if poses.status == "fail":
        return MotionReport((poses,), distinct, float("nan"), float("inf"))
    sigma = rotation_noise(pairs)
    spectrum = _spectrum(pairs)
    axes = _axes_findings(spectrum, sigma, frame)
    undetermined = any(f.status == "fail" for f in axes)
    predicted = float("inf") if undetermined else float(np.rad2deg(sigma * spectrum.dilution))
    # Motions that are noise, or so few that chance agrees or not, say nothing about the pairing.
    agreement = () if undetermined or distinct < FEW_POSES else _agreement_findings(pairs)
    return MotionReport((poses, *axes, *agreement), distinct, float(np.rad2deg(sigma)), predicted)


@lru_cache(maxsize=4)
def rotation_noise(pairs: PosePairs) -> float:
    """sigma of a pose's rotation about one axis, rad: A and B see the same angle, so the difference is noise alone.

    sigma = spread(angle_A - angle_B) / sqrt(2), the sqrt(2) for the two poses of a pair, kept within SIGMA_ROTATION.
    The spread is 1.4826 median |difference|, which wrong views do not move; with few poses it is the RMS.
    """
    m = pairs.motions
    difference = np.linalg.norm(m.alpha, axis=1) - np.linalg.norm(m.beta, axis=1)
    if len(pairs) < FEW_FOR_MEDIAN:
        spread = float(np.sqrt(np.mean(difference**2)))
    else:
        spread = 1.4826 * float(np.median(np.abs(difference)))
    return float(np.clip(spread / np.sqrt(2), *SIGMA_ROTATION))


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Summed squared rotations of the motions, per pose information (1/n of the sum over all pairs), rad^2.

    total: all; off_axis: off the dominant axis; off_axis_odd: the same of sin(theta) n, which half turns do not feed.
    axis (3,), second (3,): dominant axis and the axis that comes next, in A's child frame.
    """

    n: int
    total: float
    off_axis: float
    off_axis_odd: float
    axis: Array
    second: Array

    @property
    def dilution(self) -> float:
        """sigma of X about its worst axis over sigma of a pose's rotation."""
        return float("inf") if self.off_axis <= 0 else float(1 / np.sqrt(self.off_axis))


@lru_cache(maxsize=4)
def _spectrum(pairs: PosePairs) -> _Spectrum:
    """See _Spectrum. Of robot and camera the one that rotates less counts: noise may hide a robot that cannot tilt."""
    m, scale = pairs.motions, (len(pairs) - 1) / 2

    def moments(vectors: Array) -> tuple[float, float, Array]:
        values, axes = np.linalg.eigh(vectors.T @ vectors / len(vectors) * scale)
        values = np.maximum(values, 0.0)  # rounding makes empty directions slightly negative
        return float(values.sum()), float(values[0] + values[1]), axes

    total_a, off_a, axes = moments(m.alpha)
    total_b, off_b, _ = moments(m.beta)
    odd = [moments(odd_part(T[:, :3, :3]))[1] for T in (m.A, m.B)]
    return _Spectrum(len(pairs), min(total_a, total_b), min(off_a, off_b), min(odd), axes[:, 2], axes[:, 1])


def _poses_finding(distinct: int, n: int) -> MotionFinding:
    """Three distinct poses are two motions, the fewest that determine X."""
    repeated = f" ({n} given, the others repeat them)" if n > distinct else ""
    if distinct < 3:
        message = (
            f"{distinct} distinct poses{repeated}; hand-eye calibration needs at least 3, better 10 to 20: add poses"
        )
        return MotionFinding("poses", "fail", message, distinct)
    if distinct < FEW_POSES:
        message = f"only {distinct} distinct poses{repeated}: little is left to check the result; 10 to 20 are better"
        return MotionFinding("poses", "warn", message, distinct)
    more = " or more" if distinct == MANY_POSES else ""
    return MotionFinding("poses", "ok", f"{distinct}{more} distinct poses{repeated if not more else ''}", distinct)


def _same_poses_finding(pairs: PosePairs) -> tuple[MotionFinding, ...]:
    """Fails when the target's poses are the robot's, or their inverses: X = Z = 1 closes that loop without an error."""
    same = [float(np.abs(A - pairs.B).max(initial=0.0)) for A in (pairs.A, se3.inverse(pairs.A))]
    if not len(pairs) or min(same) > SAME_NUMBERS:
        return ()
    message = (
        f"the {len(pairs)} target poses are the robot's poses once more, or their inverses, number by number: the "
        "camera comes out in the robot's own frame whatever was measured; give the poses of the target in the camera "
        "(T_camera_target)"
    )
    return (MotionFinding("same-poses", "fail", message, min(same)),)


def _axes_findings(s: _Spectrum, sigma: float, frame: str) -> tuple[MotionFinding, ...]:
    """Pure translation, parallel axes, half turns, in this order; the first that fails explains the others."""
    noise_deg = np.rad2deg(sigma)
    spread_deg = float(np.rad2deg(np.sqrt(s.total / s.n)))
    if s.total < NOISE_FACTOR * 3 * (s.n - 1) * sigma**2:
        message = (
            f"the poses do not rotate beyond the noise ({spread_deg:.2g} deg rms about their mean, "
            f"noise {noise_deg:.2g} deg): translations alone leave the camera's position unknown in every direction; "
            f"turn the gripper by 30 deg or more about two different axes of the {frame} frame between poses"
        )
        return (MotionFinding("pure-translation", "fail", message, spread_deg),)
    off_deg = float(np.rad2deg(np.sqrt(s.off_axis / s.n)))
    moving = MotionFinding(
        "pure-translation", "ok", f"the poses rotate by {spread_deg:.3g} deg rms about their mean", spread_deg
    )
    direction = (float(s.axis[0]), float(s.axis[1]), float(s.axis[2]))
    cure = f"tilt the gripper about another axis, {_axis_text(s.second)} for one, by 30 deg or more between poses"
    if s.off_axis < NOISE_FACTOR * 2 * (s.n - 1) * sigma**2:
        message = (
            f"all rotations turn about one axis {_axis_text(s.axis)} in the {frame} frame (rotation off that axis "
            f"{off_deg:.2g} deg rms, noise {noise_deg:.2g} deg): the camera's position along this axis cannot be "
            f"observed; {cure}"
        )
        return moving, MotionFinding("parallel-axes", "fail", message, off_deg, direction)
    if s.off_axis_odd < NOISE_FACTOR * 2 * (s.n - 1) * sigma**2:
        message = (
            "the motions are half turns, or half turns and turns about one axis: a half turn is the same about an axis "
            "and its opposite, so several camera rotations fit equally well; "
            "add poses turned by 30 to 120 deg about two axes"
        )
        return moving, MotionFinding("half-turns", "fail", message, float(np.rad2deg(np.sqrt(s.off_axis_odd / s.n))))
    return moving, *_dilution_findings(s, off_deg, direction, cure, frame)


def _dilution_findings(
    s: _Spectrum, off_deg: float, direction: tuple[float, float, float], cure: str, frame: str
) -> tuple[MotionFinding, ...]:
    """Determined, but how well: the noise of a pose comes out `dilution` times larger in X."""
    parallel = MotionFinding("parallel-axes", "ok", f"rotations off the main axis: {off_deg:.3g} deg rms", off_deg)
    enough = MotionFinding(
        "small-rotations",
        "ok",
        f"an error of one pose's rotation turns the camera by {s.dilution:.2g} times as much about its worst axis",
        s.dilution,
    )
    if s.dilution <= WARN_DILUTION:
        return parallel, enough
    # Evenly spread axes put 2/3 of the rotation off any axis. Below a tenth of that the axes are to blame, not the
    # size.
    if s.off_axis < s.total * (2 / 3) / 10:
        message = (
            f"nearly all rotation is about one axis {_axis_text(s.axis)} in the {frame} frame "
            f"(off it {off_deg:.2g} deg rms): the camera's position along it is poorly known, and an error of one "
            f"pose's rotation turns the camera by {s.dilution:.2g} times as much; {cure}"
        )
        return MotionFinding("parallel-axes", "warn", message, off_deg, direction), enough
    message = (
        f"the poses hardly turn (rotation {off_deg:.2g} deg rms): an error of one pose's rotation turns the camera by "
        f"{s.dilution:.2g} times as much; turn the gripper by 30 deg or more about two axes between poses"
    )
    return parallel, MotionFinding("small-rotations", "warn", message, s.dilution)


@lru_cache(maxsize=4)
def _agreement_findings(pairs: PosePairs) -> tuple[MotionFinding, ...]:
    """Congruence of screws, whatever X is: A_ij and B_ij turn by the same angle and advance as far along their axis."""
    turned, advanced = screws.turns(pairs), screws.advances(pairs)
    angle_text = f"angles differ by {np.rad2deg(turned.median):.2g} deg in the median"
    advance_text = f"advances differ by {1e3 * advanced.median:.2g} mm in the median"
    by_angle = _agreement_finding(
        "rotation-agreement", turned.ratio, angle_text, "is every target pose paired with its own robot pose?"
    )
    if advanced.ratio > AGREEMENT_OF_CHANCE:
        whole = screws.translations(pairs)
        if whole.ratio <= AGREEMENT_AS_A_WHOLE:
            message = (
                "robot and camera see the same motions: their translations differ by "
                f"{1e3 * whole.median:.2g} mm in the median; they turn about one fixed point, so that advances along "
                "the axes vary by no more than the noise and tell nothing, nor whether lengths of robot and target "
                "are in one unit"
            )
            return by_angle, MotionFinding("screw-agreement", "ok", message, whole.ratio)
    return by_angle, _agreement_finding("screw-agreement", advanced.ratio, advance_text, "are pairing and units right?")


def _agreement_finding(name: str, ratio: float, text: str, question: str) -> MotionFinding:
    if ratio > AGREEMENT_OF_CHANCE:
        message = (
            f"robot and camera do not see the same motions ({text}, {ratio:.0%} of what chance would give): {question}"
        )
        return MotionFinding(name, "fail", message, ratio)
    return MotionFinding(name, "ok", f"robot and camera see the same motions: {text}", ratio)


@lru_cache(maxsize=4)
def _distinct_poses(pairs: PosePairs) -> int:
    """Number of distinct poses, a pose and the target seen from it together; counting stops at MANY_POSES."""
    # Of a long session a part usually holds that many.
    for rows in (sample(len(pairs), 2 * MANY_POSES), np.arange(len(pairs))):
        count = _distinct_of(pairs, rows)
        if count >= MANY_POSES or len(rows) == len(pairs):
            break
    return count


def _distinct_of(pairs: PosePairs, rows: Index) -> int:
    """Poses that are counted one by one, each with all that equal it within what robots repeat."""
    # |R - R'|_F = 2 sqrt(2) sin(angle / 2), about sqrt(2) angle.
    parts = [
        part
        for T in (pairs.A[rows], pairs.B[rows])
        for part in (T[:, :3, :3].reshape(-1, 9) / (np.sqrt(2) * SIGMA_ROTATION[0]), T[:, :3, 3] / SAME_POSE_METRES)
    ]
    starts = np.cumsum([0, *(part.shape[1] for part in parts[:-1])])
    left = np.concatenate(parts, axis=1)
    count = 0
    while len(left) and count < MANY_POSES:
        count += 1
        apart = np.add.reduceat((left - left[0]) ** 2, starts, axis=1) >= 1
        left = left[apart.any(axis=1)]
    return count


def _axis_text(axis: Array) -> str:
    """An axis as (x, y, z), its largest component positive, so that the same axis always reads the same."""
    signed = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return "(" + ", ".join(f"{x + 0.0:.2f}" for x in np.round(signed, 2)) + ")"
