"""What touches are asked: do they agree, and is one of them at odds with the others?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.cell.problem.touches import touch_group, touch_name
from calibrant.calibrate.tool.tip import TOUCH_MM
from calibrant.data import Check
from calibrant.optimize.chances import f_tail
from calibrant.optimize.noise import NoiseEstimate

ODD = 0.01
"""Chance below which some touch is flagged when all are good: once in a hundred tools."""


def touch_checks(cell: Cell, noise: NoiseEstimate) -> Iterable[Check]:
    """One question a tool."""
    for tool in dict.fromkeys(t.tool for t in cell.layout.touches):
        lists = [k for k, t in enumerate(cell.layout.touches) if t.tool == tool]
        names = [name for k in lists for name in cell.layout.touches[k].ids]
        r = np.concatenate([noise.solution.residuals(touch_name(k)) for k in lists])
        level = noise.levels[touch_group(tool)]
        off, mm = 1e3 * np.linalg.norm(r, axis=1), 1e3 * level.sigma
        worst = int(np.argmax(off))
        text = f"{len(r)} touches of {tool} agree to {mm:.3g} mm (1 sigma per axis); farthest {names[worst]}, "
        text += f"{off[worst]:.3g} mm"
        if not level.determined:
            few = f"{len(r)} touches of {tool} are as many as it takes, nothing tells whether they agree: touch more"
            yield Check(f"touches-{tool}", "warn", few, mm)
            continue
        if mm > TOUCH_MM[0]:
            text += (
                f"; one and the same point is touched to better than {TOUCH_MM[0]:g} mm: are these the poses of the "
                "touches, and is the target the one that was touched?"
            )
            yield Check(f"touches-{tool}", "fail" if mm > TOUCH_MM[1] else "warn", text, mm)
            continue
        odd = f_tail(3, level.redundancy, (off[worst] / mm) ** 2 / 3) < ODD / len(r)
        more = ", at odds with the others: repeat it, or leave it out" if odd else ""
        yield Check(f"touches-{tool}", "warn" if odd else "ok", f"{text}{more}", mm)
