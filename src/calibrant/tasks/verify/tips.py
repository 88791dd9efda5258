"""Where a tool's tip is on the flange, and where the table is, as people say it."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.verification.touch.table import Table

UNITS = ("mm", "cm", "in", "m")
LEAST_TIP_M = 1e-4
"""Of a tip that was typed in, 1 sigma: a caliper's."""


def parse_tip(text: str) -> tuple[Array, float]:
    """The tip (3,) on the flange, metres, with its sigma per axis: 0,0,120mm, or a result of `tool touch` or `tool
    seen`.

    Raises: InputError for anything else.
    """
    import numpy as np

    from calibrant.targets.lengths import parse_coordinate

    if Path(text).suffix == ".json":
        return _tip_of(Path(text))
    parts = [p.strip() for p in text.split(",")]
    if len(parts) != 3:
        raise InputError(
            f"--tip {text}: give x,y,z of the tip on the flange with a unit, such as 0,0,120mm, or the result of "
            "`calibrant tool touch` (tool.json)"
        )
    unit = next((u for u in UNITS if parts[2].endswith(u)), "")
    whole = [p if p[-1:].isalpha() else f"{p}{unit}" for p in parts]
    return np.array([parse_coordinate(p, what="--tip") for p in whole]), LEAST_TIP_M


def _tip_of(path: Path) -> tuple[Array, float]:
    import numpy as np

    from calibrant.data.result_file import read_result

    known = read_result(path)
    found = next((t for t in known.transforms if (t.parent, t.child) == ("flange", "tip")), None)
    if found is None:
        raise InputError(
            f"--tip {path}: a result of kind {known.kind!r} has no tip on a flange; give one of `tool touch`"
        )
    sigma = LEAST_TIP_M if found.covariance is None else float(np.sqrt(np.trace(found.covariance[3:, 3:]) / 3))
    return found.matrix[:3, 3], sigma


def parse_table(text: str | None) -> Table | None:
    """The table's height in the base: 0mm, or with its sigma, 0mm,0.5mm. Raises: InputError for anything else."""
    from calibrant.targets.lengths import parse_coordinate, parse_length
    from calibrant.verification.touch.table import Table

    if text is None:
        return None
    parts = text.split(",")
    if len(parts) > 2:
        raise InputError(f"--table {text}: give the height of the table in the base and its sigma, such as 0mm,0.5mm")
    sigma = parse_length(parts[1], what="--table") if len(parts) == 2 else 1e-3
    return Table(parse_coordinate(parts[0], what="--table"), sigma, lies=inf)
