"""The few figures that answer "how good is it": the top of a page, and what a result says of itself."""

from __future__ import annotations

from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.reports.figures import JOINT, Fact, camera_figures, camera_transforms, is_point, noise_facts, rows_name
from calibrant.reports.numbers import plain, sigma_text
from calibrant.reports.words import view_rows


def headline(result: CalibrationResult) -> list[Fact]:
    """The few figures that answer "how good is it", for the top of the page."""
    facts = [fact for fact in noise_facts(result) if fact.name == "clock offset"]
    if result.transforms:
        for estimate in camera_transforms(result):
            facts += _transform_facts(estimate)
    elif result.cameras:
        camera = next(iter(result.cameras.values()))
        facts += [
            Fact(f.name, f.text, "" if f.fixed else "± 1σ")
            for f in camera_figures(camera)
            if f.name in ("fx", "fy", "f")
        ]
    joint = result.methods.get(JOINT)
    if joint is not None and joint.loop_rms_mm is not None and joint.loop_rms_deg is not None:
        text = f"{plain(joint.loop_rms_mm, digits=3)} mm, {plain(joint.loop_rms_deg, digits=3)} deg"
        facts.append(Fact("loop error, RMS", text, "joint refinement"))
    wanted = (
        ("RMS error", "held-out error") if result.transforms else ("RMS error", "pixel noise, 1σ", "held-out error")
    )
    facts += [fact for fact in noise_facts(result) if fact.name in wanted]
    rows = view_rows(result)
    if rows:
        facts.append(Fact(f"{rows_name(result)} used", f"{sum(r.used for r in rows)} of {len(rows)}", ""))
    return facts


def _transform_facts(estimate: TransformEstimate) -> list[Fact]:
    t, turns = estimate.sigma_translation_mm, estimate.sigma_rotation_deg
    if t is None or turns is None:
        return []
    label = f"{estimate.parent} → {estimate.child}"
    if is_point(estimate):
        return [Fact(f"{label}, position", f"± {sigma_text(float(t.max()))} mm", "1σ, worst axis")]
    return [
        Fact(f"{label}, position", f"± {sigma_text(float(t.max()))} mm", "1σ, worst axis"),
        Fact(f"{label}, rotation", f"± {sigma_text(float(turns.max()))} deg", "1σ, worst axis"),
    ]
