"""How the poses are written, where the camera is, and in which order they stand: what must be known before all else.

`diagnose.conventions` decides among notations by the loop. Where no notation closes it, the poses may stand in another
order, or, in the setup that was said, the target poses may be inverted: then these are tried with every notation.
Where still nothing closes it, up to half of the views may be wrong: the notation is taken that closes the loop for the
larger half, and the search for faults says what is wrong with the rest.

Target poses that are inverted close the loop in the other setup. Where the setup was said, the loop decides; where it
was not and the poses are not those of a target in front of a camera, a person is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibrant.arrays import Array, Index
from calibrant.calibrate.cell.starts.robust import log_misfit, robust_fit
from calibrant.calibrate.solvers.loop_errors import loop_consistency
from calibrant.cancel import checkpoint
from calibrant.data import Check
from calibrant.diagnose.conventions.decide import CLEAR_RATIO, EQUAL_P, ConventionDecision, decide, loop_f_test
from calibrant.diagnose.conventions.hypotheses import CONSISTENT, SETUPS, Alternative, Setup
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence, Loop
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.diagnose.doctor.evidence.target_frame import is_track, look_inverted, other_axis
from calibrant.diagnose.doctor.faults.pairing import Order, congruent_orders
from calibrant.diagnose.doctor.faults.size import WRONG_LENGTH
from calibrant.errors import RefusedError
from calibrant.formats.poses.notations import PoseNotation
from calibrant.geometry import se3

ORDERS_TRIED = 2
"""Orders whose notations are solved, the most congruent ones."""
LEAST_FOR_SCALE = 4
"""Three poses close the loop of many notations, and more so with one unknown more."""
ALTERNATIVES_TRIED = 6
"""Notations fitted robustly when none closes the loop."""


@dataclass(frozen=True, eq=False)
class PoseDecision:
    """What was decided, with every pose of the file: notation, setup, and the order of the rows if it is not theirs.

    fits: False when no notation closes the loop for most of the views. scale: what the target's lengths must be
    multiplied by for it to close, where that was free or is the cause of a loop that does not close.
    """

    decision: ConventionDecision
    notation: PoseNotation
    setup: Setup
    order: Order | None
    inverted_targets: bool
    fits: bool
    findings: tuple[Finding, ...]
    scale: float = 1.0


def decide_poses(
    complete: Sequence[PoseNotation],
    B: Array,
    rows: Index,
    *,
    setup: Setup | Literal["auto"] = "auto",
    measured: bool = False,
    free_scale: bool = False,
) -> PoseDecision:
    """Decide how n poses are to be read from m target poses.

    Args: complete, notations of all n poses, in the order of the images; B (m, 4, 4) = T_camera_target of the rows
    `rows`; measured, the target poses were measured elsewhere, in a direction that was not said;
    free_scale, the target's lengths are in an unknown unit.
    Raises: RefusedError when the motions determine nothing, or two notations fit equally well.
    """
    plain = _decided(complete, B, rows, None, setup, free_scale=free_scale)
    if plain.ok:
        found = replace(_decision(plain, complete, None), scale=_chosen(plain).scale)
        return _noted(found, B, asked=measured and setup == "auto")
    if measured:
        plain = _with_target_direction(plain)
    if measured and setup != "auto" and (is_track(B) or look_inverted(complete[0].T_base_gripper, B)):
        turned = _decided(complete, se3.inverse(B), rows, None, setup, free_scale=free_scale)
        if turned.ok:
            return replace(_inverted(_decision(turned, complete, None)), scale=_chosen(turned).scale)
    scaled = None if free_scale else _scaled(plain, complete, B, rows, setup)
    if scaled is not None:
        return scaled
    trials = []
    for order in _orders(complete, B, rows):
        checkpoint()
        try:
            decision = _decided(complete, B, rows, order, setup)
        except RefusedError:  # in this order two notations fit equally well: it is not the right one
            continue
        if decision.ok:
            trials.append((decision, order))
    if trials:
        decision, order = min(trials, key=lambda t: _alternative_misfit(_chosen(t[0])))
        return _decision(decision, complete, order)
    return _by_halves(plain, complete, B, setup)


def _decided(
    complete: Sequence[PoseNotation],
    B: Array,
    rows: Index,
    order: Order | None,
    setup: Setup | Literal["auto"],
    *,
    free_scale: bool = False,
) -> ConventionDecision:
    """The decision about the poses in an order (None: as they stand)."""
    taken = rows if order is None else order.rows[rows]
    return decide([r.take(taken.tolist()) for r in complete], B, setup=setup, free_scale=free_scale)


def _scaled(
    plain: ConventionDecision,
    complete: Sequence[PoseNotation],
    B: Array,
    rows: Index,
    setup: Setup | Literal["auto"],
) -> PoseDecision | None:
    """The decision with a target of another size, where that and nothing else closes the loop; else None."""
    if len(B) < LEAST_FOR_SCALE:
        return None
    try:
        free = _decided(complete, B, rows, None, setup, free_scale=True)
    except RefusedError:  # with one unknown more two notations fit equally well
        return None
    best = _chosen(free)
    ratio, p = loop_f_test(best, _chosen(plain))
    if not free.ok or p > EQUAL_P or ratio < CLEAR_RATIO or max(best.scale, 1 / best.scale) < WRONG_LENGTH:
        return None
    return replace(_decision(free, complete, None), scale=best.scale)


def _orders(complete: Sequence[PoseNotation], B: Array, rows: Index) -> list[Order]:
    """The most congruent other orders, over all notations."""
    found: list[tuple[float, Order]] = []
    seen = set()
    for notation in complete:
        if notation.rotation_notation in seen:
            continue
        seen.add(notation.rotation_notation)
        found += congruent_orders(notation.T_base_gripper, B, rows, notation.ids)[:ORDERS_TRIED]
    found.sort(key=lambda item: item[0])
    return [order for _, order in found[:ORDERS_TRIED]]


def _chosen(decision: ConventionDecision) -> Alternative:
    return next(a for a in decision.alternatives if a.notation is decision.notation and a.setup == decision.setup)


def _alternative_misfit(a: Alternative) -> float:
    """Sum of ln distance + ln angle over all views: orders that differ in two views have the same median."""
    Z = loop_consistency(a.A, a.T_camera_target, a.X).Z
    return float(log_misfit(se3.local(Z, a.A @ a.X @ a.T_camera_target)).sum())


def _by_halves(
    plain: ConventionDecision,
    complete: Sequence[PoseNotation],
    B: Array,
    setup: Setup | Literal["auto"],
) -> PoseDecision:
    """The notation that closes the loop for the larger half of the views."""
    distinct: dict[tuple[float, float], Alternative] = {}
    for a in plain.alternatives:
        if setup in ("auto", a.setup):
            distinct.setdefault((a.loop_rms_mm, a.loop_rms_deg), a)
    best: tuple[float, Alternative, bool] | None = None
    for a in list(distinct.values())[:ALTERNATIVES_TRIED]:
        robust = robust_fit(a.A, B)
        half = np.argsort(log_misfit(robust.fit.deviation))[: len(B) // 2 + 1]
        value = float(log_misfit(robust.fit.deviation)[half].sum())
        closes = loop_consistency(a.A[half], B[half], robust.X).score <= CONSISTENT / 2
        if best is None or value < best[0]:
            best = value, a, closes
    if best is None or not best[2]:
        return _decision(plain, complete, None)
    a = best[1]
    chosen = ConventionDecision(
        a.notation,
        a.setup,
        plain.confidence,
        f"poses read as {a.description}: the loop closes for the larger half of the views only",
        plain.alternatives,
        tuple(f for f in plain.findings if f.name != "no-reading-fits"),
    )
    return _decision(chosen, complete, None)


def _with_target_direction(decision: ConventionDecision) -> ConventionDecision:
    """Measured target poses that are inverted close the loop in the other setup as well: then that is a way out too."""
    more = ", or --target-pose-direction target-camera if the target poses are T_target_camera"
    findings = [
        replace(f, message=f"{f.message}{more}") if f.name == "setup-mismatch" else f for f in decision.findings
    ]
    return replace(decision, findings=tuple(findings))


def _decision(
    decision: ConventionDecision,
    complete: Sequence[PoseNotation],
    order: Order | None,
) -> PoseDecision:
    """The decision about all poses, with the findings in words."""
    r = decision.notation
    key = (r.units, r.rotation_notation, r.direction)
    full = next(c for c in complete if (c.units, c.rotation_notation, c.direction) == key)
    findings = [*_conventions(decision, complete[0]), *(_as_finding(f, decision) for f in decision.findings)]
    if order is not None:
        findings.insert(0, _order_finding(order, decision))
        full = full.take(order.rows.tolist(), full.ids)
    return PoseDecision(decision, full, decision.setup, order, False, decision.ok, tuple(findings))


def _inverted(found: PoseDecision) -> PoseDecision:
    """The decision with inverted target poses, which close the loop in the setup that was said."""
    message = (
        "the target poses are inverted, T_target_camera where T_camera_target is documented: inverted, the loop closes "
        f"to {_chosen(found.decision).loop_text} as {found.setup}, as they stand it does not"
    )
    proposal = "invert the target poses (--target-pose-direction target-camera)"
    finding = Finding("target-pose-direction", "fail", message, found.decision.confidence, proposal=proposal)
    return replace(found, inverted_targets=True, findings=(finding, *found.findings))


def _noted(found: PoseDecision, B: Array, *, asked: bool) -> PoseDecision:
    """The decision with what the target poses do not tell of their own frames; asked: nor was the setup said."""
    other = next(s for s in SETUPS if s != found.setup)
    way_out = "the loop closes either way: say --setup, or --target-pose-direction camera-target or target-camera"
    axis = other_axis(B)
    if asked and look_inverted(found.notation.T_base_gripper, B):
        message = (
            f"the targets are not ahead of the camera (z), inverted they are. Either the poses are T_target_camera, "
            f"which makes it {other}, or the camera's frame has {axis or 'another axis'} ahead, which makes it "
            f"{found.setup}; {way_out}"
        )
    elif asked and is_track(B) and found.setup == "eye-to-hand":
        message = (
            "the target poses are a track in the frame of one of its own poses, as odometry and SLAM give it. Either "
            f"they are T_target_camera (a moving camera in its map), which makes it {other}, or T_camera_target, which "
            f"makes it {found.setup}; {way_out}"
        )
    else:
        if axis is None:
            return found
        message = (
            f"the camera looks along {axis} of its own frame, not along z: the frame of the poses is kept, and the "
            "camera's transform is that of this frame"
        )
        return replace(found, findings=(*found.findings, Finding("camera-frame", "ok", message)))
    return replace(found, findings=(Finding("target-pose-direction", "fail", message), *found.findings))


def _conventions(decision: ConventionDecision, first: PoseNotation) -> list[Finding]:
    """What differs from the native form, T_base_gripper in metres and quaternions x y z w or matrices."""
    r = decision.notation
    chosen = next(
        (a for a in decision.alternatives if a.notation is r and a.setup == decision.setup), decision.alternatives[0]
    )
    found = []
    if r.units != "m":
        plain = _loop_of(decision, chosen, units=first.units) if first.units != r.units else None
        found.append(_convention("pose-units", f"positions are in {r.units}, read so", r, chosen, plain, decision))
    if r.rotation not in ("quat-xyzw", "matrix"):
        other = (first.rotation, first.angle) != (r.rotation, r.angle)
        plain = _loop_of(decision, chosen, rotation=first.rotation, angle=first.angle) if other else None
        words = f"rotations are {r.rotation_words}, read so"
        found.append(_convention("pose-rotation", words, r, chosen, plain, decision))
    return found


def _loop_of(decision: ConventionDecision, chosen: Alternative, **changed: str) -> Loop | None:
    """The loop of the notation that differs from the chosen one in this only, where it was tried."""
    wanted = {key: getattr(chosen.notation, key) for key in ("units", "rotation", "angle", "direction")} | changed
    for a in decision.alternatives:
        if a.setup == chosen.setup and all(getattr(a.notation, key) == value for key, value in wanted.items()):
            return Loop.of(a)
    return None


def _convention(
    name: str,
    words: str,
    notation: PoseNotation,
    chosen: Alternative,
    plain: Loop | None,
    decision: ConventionDecision,
) -> Finding:
    after = Loop.of(chosen)
    evidence = None if plain is None else Evidence(plain, after)
    text = words if evidence is None else f"{words}: {evidence.text}"
    against = "; ".join(notation.contradicts)
    status: Literal["ok", "warn"] = "warn" if against else "ok"
    return Finding(name, status, f"{text} ({against})" if against else text, decision.confidence, evidence)


def _as_finding(check: Check, decision: ConventionDecision) -> Finding:
    return Finding(check.name, check.status, check.message, decision.confidence)


def _order_finding(order: Order, decision: ConventionDecision) -> Finding:
    chosen = _chosen(decision)
    message = f"{order.words}: paired rightly, the loop closes to {chosen.loop_text}"
    return Finding(order.name, "fail", message, confidence(1 - decision.confidence), proposal=order.proposal)
