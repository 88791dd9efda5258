"""Figures and sentences that several kinds of result have at their head."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.reports.parts.figures import JOINT, Fact, camera_figures, is_point, noise_facts, translation_figures
from calibrant.reports.parts.numbers import plain, sigma_text
from calibrant.reports.parts.rows import view_rows

_FOCAL = ("fx", "fy", "f")
OWN_OPTIONS = {"pose_reading": "poses read as"}
"""Decisions whose key is not their word."""


def decisions(result: CalibrationResult) -> str:
    """What was chosen where the request left it open."""
    return "; ".join(f"{OWN_OPTIONS.get(name, name)}: {words}" for name, words in result.decided.items())


def first_transform(result: CalibrationResult) -> str:
    """How well the first transform is known, which is what was asked for; empty where that is not stated."""
    return known(result.transforms[:1])


def known(transforms: Iterable[TransformEstimate]) -> str:
    """Where transforms place things and how well that is known, in one sentence; empty where none states it."""
    asked = tuple(transforms)
    texts = [text for text in (_known_to(t, placed=len(asked) == 1) for t in asked) if text]
    return f"{', '.join(texts)} (1σ, worst axis)." if texts else ""


def _known_to(estimate: TransformEstimate, *, placed: bool) -> str:
    """placed: whether where it is is said too: of several the tables say it."""
    position = translation_figures(estimate)
    sigmas = [f.sigma for f in position if f.sigma is not None]
    turns = estimate.sigma_rotation_deg
    if not sigmas or turns is None:
        return ""
    at = f"at ({', '.join(f.value_text for f in position)}) mm, " if placed else ""
    text = f"{estimate.parent} → {estimate.child} is {at}known to {sigma_text(max(sigmas))} mm"
    return text if is_point(estimate) else f"{text} and {sigma_text(float(turns.max()))} deg"


def focal_known(result: CalibrationResult) -> str:
    """How well the first camera's focal length is known; empty where that is not stated."""
    for camera in list(result.cameras.values())[:1]:
        for f in camera_figures(camera):
            if f.sigma and f.name in _FOCAL:
                return f"{f.name} is known to {plain(100 * f.sigma / f.value, digits=2)} % (1σ)."
    return ""


def transform_facts(transforms: Iterable[TransformEstimate]) -> list[Fact]:
    """Position and rotation of each transform by their worst axis; none for one whose uncertainty is not known."""
    facts = []
    for estimate in transforms:
        t, turns = estimate.sigma_translation_mm, estimate.sigma_rotation_deg
        if t is None or turns is None:
            continue
        label, note = f"{estimate.parent} → {estimate.child}", "1σ, worst axis"
        at = ", ".join(f"{f.name} {f.value_text}" for f in translation_figures(estimate))
        facts.append(Fact(f"{label}, position", f"± {sigma_text(float(t.max()))} mm", f"{note}; {at} mm", at))
        if not is_point(estimate):
            facts.append(Fact(f"{label}, rotation", f"± {sigma_text(float(turns.max()))} deg", note))
    return facts


def focal_facts(result: CalibrationResult) -> list[Fact]:
    """The focal lengths of the first camera."""
    return [
        Fact(f.name, f.text, "" if f.fixed else "± 1σ")
        for camera in list(result.cameras.values())[:1]
        for f in camera_figures(camera)
        if f.name in _FOCAL
    ]


def loop_facts(result: CalibrationResult) -> list[Fact]:
    """How the loop of the joint refinement closes."""
    joint = result.methods.get(JOINT)
    if joint is None or joint.loop_rms_mm is None or joint.loop_rms_deg is None:
        return []
    text = f"{plain(joint.loop_rms_mm, digits=3)} mm, {plain(joint.loop_rms_deg, digits=3)} deg"
    return [Fact("loop error, RMS", text, "joint refinement")]


def errors(
    result: CalibrationResult, *names: str, facts: Callable[[CalibrationResult], list[Fact]] = noise_facts
) -> list[Fact]:
    """Those of the errors and noise that are named. facts: the kind's own, where it has its words for them."""
    return [fact for fact in facts(result) if fact.name in names]


def used(result: CalibrationResult, rows: str = "views") -> list[Fact]:
    """How many of the rows were used."""
    all_rows = view_rows(result)
    return [Fact(f"{rows} used", f"{sum(r.used for r in all_rows)} of {len(all_rows)}", "")] if all_rows else []


def placed(result: CalibrationResult, transforms: Sequence[TransformEstimate] | None = None) -> list[Fact]:
    """The head of a result that places something: its transforms (the first, if not said), errors, views used."""
    asked = result.transforms[:1] if transforms is None else transforms
    return [
        *transform_facts(asked),
        *loop_facts(result),
        *errors(result, "RMS error", "held-out error"),
        *used(result),
    ]
