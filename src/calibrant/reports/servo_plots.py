"""Pictures of servo runs: what remains, and the gain and speed with which it goes."""

from __future__ import annotations

import io
from collections.abc import Sequence

from calibrant.data.details import ServoTrace

FLOOR = 1e-3
"""Millimetres, degrees and pixels below which a logarithmic scale shows nothing that matters."""


def servo_png(traces: Sequence[ServoTrace], *, title: str = "") -> bytes:
    """A PNG of runs over time: distance and turn that remain, features' error, gain and speed; rests are dotted."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 6.5), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    several = len(traces) > 1
    for trace in traces:
        t = [s.time_s for s in trace.samples]
        look = {"color": "#1f5fa8", "alpha": 0.35 if several else 1.0, "linewidth": 1.2}
        moving = [not s.resting for s in trace.samples]
        rows = (
            (axes[0][0], [s.mm for s in trace.samples], "remaining distance [mm]"),
            (axes[0][1], [s.deg for s in trace.samples], "remaining turn [deg]"),
            (axes[1][0], [s.error_px for s in trace.samples], "features' error, rms [px]"),
        )
        for ax, values, name in rows:
            ax.semilogy(t, [max(v, FLOOR) for v in values], **look)
            rest = [(x, max(v, FLOOR)) for x, v, m in zip(t, values, moving) if not m]
            if rest:
                ax.semilogy(*zip(*rest), ".", color="#c0392b", markersize=4)
            ax.set_ylabel(name)
        axes[1][1].plot(t, [s.gain if m else float("nan") for s, m in zip(trace.samples, moving)], **look)
        axes[1][1].plot(t, [s.mm_s / 100 for s in trace.samples], **{**look, "color": "#2d8a4e"})
    axes[1][1].set_ylabel("gain [1/s] (blue), speed [100 mm/s] (green)")
    for ax in axes.flat:
        ax.grid(visible=True, which="major", alpha=0.3)
    for ax in axes[1]:
        ax.set_xlabel("time [s]")
    figure.suptitle(title or f"{traces[0].control} control; red: at rest")
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()
