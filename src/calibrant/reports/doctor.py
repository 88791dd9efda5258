"""The doctor's report: findings, and the loop of every view before and after the repairs, as one HTML file."""

from __future__ import annotations

from html import escape

import numpy as np
from numpy.typing import NDArray

from calibrant.diagnose.doctor.diagnosis import Diagnosis
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding

Array = NDArray[np.float64]

WORDS = {"ok": "noted", "warn": "warning", "fail": "FAULT"}
STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1a1a1a}"
    "table{border-collapse:collapse;width:100%}td,th{padding:.4rem .6rem;text-align:left;vertical-align:top;"
    "border-bottom:1px solid #ddd}.fail{color:#b00020;font-weight:600}.warn{color:#8a5a00;font-weight:600}"
    "svg{width:100%;height:auto}text{font-size:11px;fill:#444}@media(prefers-color-scheme:dark){"
    "body{background:#161616;color:#eee}td,th{border-color:#444}text{fill:#bbb}.fail{color:#ff8a8a}"
    ".warn{color:#f0c060}}"
)
BEFORE, AFTER = "#c44e52", "#4c72b0"
WIDTH, HEIGHT, LEFT, BOTTOM = 900, 240, 60, 30


def render(diagnosis: Diagnosis) -> str:
    """The page. It links to nothing outside itself."""
    examination = diagnosis.examination
    rows = "".join(_row(f) for f in diagnosis.findings) or "<tr><td colspan='4'>nothing wrong found</td></tr>"
    plots = ""
    if examination.before is not None:
        before, after = _deviations(examination.case), _deviations(examination.repaired)
        names = examination.case.data.ids
        plots = "<h2>The loop of every view, before and after</h2>"
        for k, title, unit in ((0, "Position of the target", "mm"), (1, "Rotation of the target", "deg")):
            pairs = [tuple(d[n][k] if n in d else None for d in (before, after)) for n in names]
            plots += f"<h3>{title}</h3>{_bars(names, pairs, unit)}"
    return (
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>Doctor</title><style>{STYLE}</style></head>"
        f"<body><h1>Doctor: what is wrong with the data</h1><p>{escape(diagnosis.poses.decision.message)}</p>"
        f"<table><tr><th>Finding</th><th>Confidence</th><th>What was found</th><th>Proposed</th></tr>{rows}</table>"
        f"{plots}</body></html>\n"
    )


def _row(f: Finding) -> str:
    sure = "&gt; 99.9 %" if f.confidence > 0.999 else f"{100 * f.confidence:.1f} %"
    return (
        f"<tr><td class='{f.status}'>{WORDS[f.status]}: {escape(f.name)}</td><td>{sure}</td>"
        f"<td>{escape(f.message)}</td><td>{escape(f.proposal)}</td></tr>"
    )


def _deviations(case: Case) -> dict[str, tuple[float, float]]:
    """mm and deg of each view used from where the others put the target."""
    d = case.robust.fit.deviation
    mm, deg = 1e3 * np.linalg.norm(d[:, 3:], axis=1), np.rad2deg(np.linalg.norm(d[:, :3], axis=1))
    return {name: (float(a), float(b)) for name, a, b in zip(case.ids, mm, deg)}


def _bars(names: tuple[str, ...], pairs: list[tuple[float | None, ...]], unit: str) -> str:
    """Two bars a view on a logarithmic scale: faults are a thousand times larger than noise."""
    values = np.array([v for pair in pairs for v in pair if v is not None and v > 0])
    if not len(values):
        return ""
    low, high = np.floor(np.log10(values.min())), np.ceil(np.log10(values.max()) + 1e-9)
    low, high = max(low, high - 6), max(high, low + 1)
    scale = (HEIGHT - BOTTOM - 10) / (high - low)
    parts = [f"<svg viewBox='0 0 {WIDTH} {HEIGHT}' role='img' aria-label='deviation of every view, {unit}'>"]
    for power in range(int(low), int(high) + 1):
        y = HEIGHT - BOTTOM - (power - low) * scale
        parts.append(f"<line x1='{LEFT}' x2='{WIDTH}' y1='{y:.1f}' y2='{y:.1f}' stroke='#8884'/>")
        parts.append(f"<text x='{LEFT - 6}' y='{y + 4:.1f}' text-anchor='end'>{10.0**power:g} {unit}</text>")
    step = (WIDTH - LEFT) / len(names)
    for i, name in enumerate(names):
        x = LEFT + i * step
        for k, (value, colour) in enumerate(zip(pairs[i], (BEFORE, AFTER))):
            if value is None or value <= 0:
                continue
            height = max(1.0, (np.log10(value) - low) * scale)
            left, top = x + (0.1 + 0.4 * k) * step, HEIGHT - BOTTOM - height
            parts.append(
                f"<rect x='{left:.1f}' y='{top:.1f}' width='{0.38 * step:.1f}' "
                f"height='{height:.1f}' fill='{colour}'><title>{escape(name)}: {value:.3g} {unit}</title></rect>"
            )
        if len(names) <= 30:
            parts.append(
                f"<text x='{x + 0.5 * step:.1f}' y='{HEIGHT - 10}' text-anchor='middle'>{escape(name[:8])}</text>"
            )
    legend = f"<p><span style='color:{BEFORE}'>■</span> as given <span style='color:{AFTER}'>■</span> repaired</p>"
    return "".join(parts) + "</svg>" + legend
