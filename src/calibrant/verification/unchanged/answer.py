"""The answer in words: unchanged, or what moved, by how much against what it is known to, and what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.diagnose.movement import (
    AtWork,
    camera_words,
    figure,
    guidance,
    movement,
    of_camera,
    of_target,
    side_words,
    target_words,
    undone,
)
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import chi2_tail, f_tail
from calibrant.verification.unchanged.compare import Compared
from calibrant.verification.unchanged.consensus import Motion
from calibrant.verification.unchanged.decide import (
    BOTH,
    CAMERA,
    CAMERA_MOVED,
    CHANCE,
    LENS_CHANGED,
    QUESTIONS,
    TARGET,
    TARGET_MOVED,
    Hypothesis,
)
from calibrant.verification.unchanged.model import CHANGE, Fit

SURE = 3.0
"""Sigmas by which a change must stay below a tolerance to count as none."""
POWER = 2.33
"""Sigmas beyond the limit at which 99 of 100 changes are named."""


@dataclass(frozen=True)
class Tolerance:
    """Changes that certainly stay below count as none: metres at the workpiece, or pixels. None asks for neither."""

    metres: float | None = None
    px: float | None = None

    def allows(self, mm: tuple[float, float] | None, px: tuple[float, float]) -> bool:
        """Whether a change, value and 1 sigma, certainly stays below."""
        if self.px is not None and px[0] + SURE * px[1] < self.px:
            return True
        return self.metres is not None and mm is not None and mm[0] + SURE * mm[1] < 1e3 * self.metres


ANY_CHANGE = Tolerance()
"""No change is small enough to be none."""


@dataclass(frozen=True, eq=False)
class Answer:
    """changed or not, in words, with the chance of as much where nothing changed, and what to do.

    figures: (value, sigma, unit) by name; possible: what each hypothesis amounts to, by its name; doubts: what these
    photos cannot tell.
    """

    changed: bool
    words: str
    advice: str
    chance: float
    figures: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)
    possible: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


def answer_of_both(compared: Compared | None, picture: Answer | None, tolerance: Tolerance) -> Answer:
    """The answer of all there is. Raises: InputError for nothing."""
    if compared is None:
        if picture is None:
            raise InputError("nothing to compare: give photos of the target, or a reference picture")
        return picture
    target = answer_of_target(compared, picture, tolerance)
    if compared.way != "lens" or picture is None:
        return target
    # A target that may be anywhere tells of the lens alone, the scene of where the camera looks.
    changed = [a for a in (target, picture) if a.changed]
    words = "; ".join(a.words for a in changed or (target, picture))
    advice = " ".join(a.advice for a in changed)
    figures = {**picture.figures, **target.figures}
    chance = min(1.0, 2 * min(target.chance, picture.chance))
    return Answer(bool(changed), words, advice, chance, figures, target.possible)


def answer_of_target(compared: Compared, picture: Answer | None, tolerance: Tolerance) -> Answer:
    """The answer of photos that show the target. Args: picture, the answer of the scene around it, where a reference
    picture shows that."""
    decision = compared.decision
    camera = decision.named(CAMERA)
    if compared.way == "lens" or camera is None:
        return _of_lens(compared)
    possible = {h.what: _words(compared, h) for h in decision.hypotheses}
    target = decision.named(TARGET)
    alone = target if decision.changed and target is not None and _names(compared, picture)[0][:1] == [TARGET] else None
    work = _at_work(compared, camera) if alone is None else _target_at_work(compared, alone)
    figures = _work_figures(work)
    if not decision.changed or tolerance.allows(work.size, work.size_px):
        text = _unchanged_words(compared, work)
        if decision.changed:
            text = f"changed by less than the tolerance: {_size_words(work)}; {possible[CAMERA]} would explain it"
        return Answer(False, text, "", decision.chance, figures, possible)
    names, doubts = _names(compared, picture)
    if compared.way == "standing" and TARGET in names:
        possible[TARGET] = (
            f"moved {figure(*work.size)} mm {side_words(work.mm, work.mm_covariance)} as the camera sees it"
        )
    moved = "; or ".join(_told(name, possible) for name in names) if names else NOTHING_FITS
    words = f"changed: {moved}; {_size_words(work) if alone is None else _target_size_words(work)}"
    return Answer(True, words, _advice(names, compared), decision.chance, figures, possible, doubts)


NOTHING_FITS = (
    "something changed that neither a camera nor a target that moved, nor another lens, explains: the photos differ "
    "from each other"
)


def _told(name: str, possible: Mapping[str, str]) -> str:
    if name == BOTH:
        return f"camera and target both moved: {possible[BOTH]}"
    return f"the {name} {possible.get(name) or possible.get(CAMERA, '')}"


def _names(compared: Compared, picture: Answer | None) -> tuple[list[str], tuple[str, ...]]:
    """What explains the photos, the best first, and what cannot be told.

    Of a camera and a target that explain them alike, a picture of the scene around the target tells which one moved. A
    lens is named beside them where its own question, which no pose has a say in, was answered by yes.
    """
    decision = compared.decision
    names = [h.what for h in decision.explaining]
    lens = decision.named(LENS_CHANGED)
    if len(names) > 1 and lens is not None and lens.chance > CHANCE:
        names = [n for n in names if n != LENS_CHANGED]
    alike = CAMERA in names and (compared.way == "standing" or TARGET in names)
    if not alike:
        return names, ()
    if picture is not None:
        return [CAMERA if picture.changed else TARGET], ()
    if compared.way == "standing":
        return names, (
            "a camera and a target that both stand still are not told apart by the target alone: the camera moved, or "
            "the target did the other way; a reference photo that shows more of the scene tells (--reference)",
        )
    return names, (
        "these photos do not tell a camera that moved from a target that did: take two or three from robot poses that "
        "are turned by 30 deg or more against each other",
    )


def _advice(names: Sequence[str], compared: Compared) -> str:
    first = names[0] if names else ""
    if first == CAMERA:
        where = "in the hand" if compared.frame == "base" else "where it stands"
        camera = compared.decision.named(CAMERA)
        way = "" if camera is None else guidance(undone(camera.fit.place[CAMERA_MOVED], camera.fit.of(CAMERA_MOVED)))
        how = f": {way}, as it looks now" if way else " by as much"
        return (
            f"Push the camera back {where}{how}; tighten it and verify again, or calibrate again: until then every "
            "point it gives is off by the figure above."
        )
    if first == TARGET:
        if compared.frame == "base":
            return (
                "The target, or the robot's base or its zero, moved; the camera on the robot still holds. If the "
                "target was moved on purpose, nothing needs to be done; if not, look at the base and the robot's zero."
            )
        if compared.frame == "gripper":
            return "The target in the gripper moved (or the flange's zero); the camera's place still holds."
        return "The target moved, the camera did not: put the target back, or keep a new reference."
    if first == LENS_CHANGED:
        return "Focus or zoom was turned: calibrate the lens again, and what rests on it; fix its rings."
    if first == BOTH:
        return "Calibrate again."
    return (
        "Check that each pose belongs to its photo and that the robot knows its zero; then take the photos again. If "
        "it stays, calibrate again."
    )


def _at_work(compared: Compared, camera: Hypothesis) -> AtWork:
    places = [se3.apply(T, compared.middle) for T in compared.expected]
    return of_camera(compared.camera, camera.fit.place[CAMERA_MOVED], camera.fit.of(CAMERA_MOVED), places)


def _target_at_work(compared: Compared, target: Hypothesis) -> AtWork:
    """What a target's own movement is: of its middle, millimetres, and in the photo that shows it most, pixels."""
    D, C = target.fit.place[TARGET_MOVED], target.fit.of(TARGET_MOVED)
    J = np.concatenate([-so3.hat(D[:3, :3] @ compared.middle), np.eye(3)], axis=1)
    after = se3.apply(D, compared.middle)
    shifts = []
    for T in compared.expected:
        p = se3.apply(T, np.stack([compared.middle, after]))
        uv, J_point, _ = compared.camera.model.project_with_jacobians(compared.camera.values, p)
        K = J_point[1] @ T[:3, :3] @ J
        shifts.append((uv[1] - uv[0], K @ C @ K.T))
    px, of_px = max(shifts, key=lambda s: float(np.linalg.norm(s[0])))
    return AtWork(1e3 * (after - compared.middle), 1e6 * J @ C @ J.T, px, of_px)


def _work_figures(work: AtWork) -> dict[str, tuple[float, float, str]]:
    sigma = np.sqrt(np.diag(work.px_covariance))
    return {
        "at the workpiece": (*work.size, "mm"),
        "in the picture": (*work.size_px, "px"),
        "to the right": (float(work.px[0]), float(sigma[0]), "px"),
        "down": (float(work.px[1]), float(sigma[1]), "px"),
    }


def _size_words(work: AtWork) -> str:
    return (
        f"points at the workpiece are seen {figure(*work.size)} mm, {figure(*work.size_px)} px, "
        f"{side_words(work.mm, work.mm_covariance)} of where they should be"
    )


def _target_size_words(work: AtWork) -> str:
    return (
        f"it is {figure(*work.size)} mm from where it was, {figure(*work.size_px)} px in the photo that shows it most"
    )


def _unchanged_words(compared: Compared, work: AtWork) -> str:
    n = len(compared.seen.views)
    least = work.across[1] * _limit(compared.decision.below)
    many = f"{n} photos show" if n > 1 else "the photo shows"
    return (
        f"unchanged: {many} the target where the calibration puts it, within "
        f"{figure(*work.size_px)} px, at the workpiece {figure(*work.across)} mm across the line of sight and "
        f"{figure(*work.along)} mm along it; {least:.2g} mm across would have been named"
    )


def _limit(below: float) -> float:
    """Sigmas of a shift at which 99 of 100 are named: the root of the limit of its chi-square of 3, and 2.33."""
    low, high = 1.0, 60.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        square = middle**2
        tail = chi2_tail(3, square) if below == inf else float(f_tail(3, below, square / 3))
        low, high = (middle, high) if tail > CHANCE / QUESTIONS else (low, middle)
    return high + POWER


UNTOLD = "moved or was turned; these photos tell what became of the picture, not which of the two it was"


def _words(compared: Compared, h: Hypothesis) -> str:
    """What a hypothesis amounts to."""
    parts = []
    if CAMERA_MOVED in h.fit.model.free:
        parts.append(camera_words(movement(h.fit.place[CAMERA_MOVED], h.fit.of(CAMERA_MOVED))) or UNTOLD)
    if TARGET_MOVED in h.fit.model.free and compared.T_frame_target is not None:
        moved = of_target(h.fit.place[TARGET_MOVED], h.fit.of(TARGET_MOVED), compared.T_frame_target, compared.middle)
        parts.append(target_words(moved, compared.frame))
    if h.what == BOTH and len(parts) == 2:
        return f"the target {parts[1]}" + ("" if parts[0] == UNTOLD else f", the camera {parts[0]}")
    if h.fit.model.free_lens:
        parts.append(lens_words(h.fit, compared.decision.lens_factor))
    return ", ".join(parts)


def lens_words(fit: Fit, factor: float) -> str:
    """The change of the lens: focal length in per cent, principal point in pixels. Args: factor, on its variance."""
    value, sigma = _lens_change(fit, factor)
    return (
        f"changed: focal length {figure(100 * value[0], 100 * sigma[0])} %, principal point "
        f"{figure(value[1], sigma[1])} px to the right, {figure(value[2], sigma[2])} px down"
    )


def _lens_change(fit: Fit, factor: float) -> tuple[Array, Array]:
    camera, off = fit.model.camera, fit.lens_now - fit.lens
    at = [camera.model.index(name) for name in ("fx", "cx", "cy")]
    value = np.array([off[at[0]] / camera.values[at[0]], off[at[1]], off[at[2]]])
    return value, np.sqrt(factor * np.maximum(np.diag(fit.of(CHANGE)), 0.0))


def _of_lens(compared: Compared) -> Answer:
    decision = compared.decision
    h = decision.hypotheses[0]
    value, sigma = _lens_change(h.fit, decision.lens_factor)
    figures = {
        "focal length": (100 * float(value[0]), 100 * float(sigma[0]), "%"),
        "principal point, right": (float(value[1]), float(sigma[1]), "px"),
        "principal point, down": (float(value[2]), float(sigma[2]), "px"),
    }
    words = lens_words(h.fit, decision.lens_factor)
    n = len(compared.seen.views)
    if not decision.changed:
        text = f"unchanged: the lens explains {n} photo{'s' if n > 1 else ''} as it did at calibration; if it is free, "
        text += words.removeprefix("changed: ")
        return Answer(False, text, "", decision.chance, figures, {LENS_CHANGED: words})
    return Answer(
        True, f"changed: the lens {words}", _advice([LENS_CHANGED], compared), decision.chance, figures,
        {LENS_CHANGED: words},
    )  # fmt: skip


def answer_of_picture(
    moved: Sequence[Motion], camera: Camera | None, distance: float | None, tolerance: Tolerance
) -> Answer | None:
    """The answer of pictures beside a reference; None of no picture."""
    if not moved:
        return None
    worst = min(moved, key=lambda m: (m.chance, -float(np.linalg.norm(m.shift))))
    chance = min(1.0, len(moved) * worst.chance)
    C = worst.covariance
    right, down = (float(v) for v in worst.shift)
    size = float(np.hypot(right, down))
    along = worst.shift / size if size else np.array([1.0, 0.0])
    sigma = float(np.sqrt(along @ C[:2, :2] @ along))
    figures = {
        "in the picture": (size, sigma, "px"),
        "to the right": (right, float(np.sqrt(C[0, 0])), "px"),
        "down": (down, float(np.sqrt(C[1, 1])), "px"),
        "turned clockwise": (float(np.rad2deg(worst.turn)), float(np.rad2deg(np.sqrt(C[2, 2]))), "deg"),
        "larger": (100 * (worst.scale - 1), 100 * float(np.sqrt(C[3, 3])), "%"),
    }
    mm = None
    if camera is not None and distance is not None:
        per_px = 1e3 * distance / float(camera.parameters["fx"])
        mm = (size * per_px, sigma * per_px)
        figures["at the workpiece"] = (*mm, "mm")
    changed = chance < CHANCE and not tolerance.allows(mm, (size, sigma))
    there = "" if mm is None else f", {figure(*mm)} mm at the workpiece"
    if not changed:
        below = "within the tolerance: " if chance < CHANCE else ""
        text = f"unchanged: {below}the picture is where it was, within {figure(size, sigma)} px{there}"
        return Answer(False, text, "", chance, figures)
    text = f"changed: the picture moved {figure(size, sigma)} px {side_words(worst.shift)}{there}"
    text += _turn_words(worst, figures)
    back = f"{abs(right):.1f} px {'left' if right > 0 else 'right'}, {abs(down):.1f} px {'up' if down > 0 else 'down'}"
    advice = (
        f"{_as_camera(worst.shift, camera)}To bring it back by hand, turn the camera until the picture has moved "
        f"{back} (--overlay draws both), then verify again with a target."
    )
    return Answer(True, text, advice, chance, figures)


def _turn_words(m: Motion, figures: Mapping[str, tuple[float, float, str]]) -> str:
    parts = []
    turn, turn_sigma, _ = figures["turned clockwise"]
    if abs(turn) > SURE * turn_sigma:
        parts.append(f"turned {figure(abs(turn), turn_sigma)} deg {'clockwise' if turn > 0 else 'anticlockwise'}")
    scale, scale_sigma, _ = figures["larger"]
    if abs(scale) > SURE * scale_sigma:
        parts.append(f"became {figure(abs(scale), scale_sigma)} % {'larger' if scale > 0 else 'smaller'}")
    return f"; it {' and '.join(parts)}" if parts else ""


def _as_camera(shift: Array, camera: Camera | None) -> str:
    """What a shift of the picture is, of a camera that was turned."""
    if camera is None or not isfinite(camera.parameters["fx"]):
        return f"The camera was turned or moved {side_words(-shift)}. "
    deg = np.rad2deg(np.arctan(np.linalg.norm(shift) / camera.parameters["fx"]))
    return f"The camera was turned {deg:.2g} deg {side_words(-shift)}, or moved that way. "
