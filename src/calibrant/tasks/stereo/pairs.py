"""Which picture of the left camera goes with which of the right one, and corners that both see."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs.image_pairs import paired_images

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, View


def paired(left: Sequence[Path], right: Sequence[Path]) -> tuple[list[tuple[Path, Path]], str]:
    """The pairs, by name, time or order as `paired_images` finds them, and how in words; none of no pictures.

    Raises: InputError as there, for unequal numbers whose names do not tell, and one file on both sides.
    """
    if not left and not right:
        return [], ""
    same = {f.resolve() for f in left} & {f.resolve() for f in right}
    if same:
        raise InputError(f"{min(same)} is given as a left and as a right picture")
    found = paired_images(left, right)
    return [(left[i], right[j]) for i, j in found.pairs], found.words


def common_points(left: View, right: View) -> tuple[Array, Array]:
    """What two views of one target have in common: pixels (2, n, 2), and the target's points (n, 3)."""
    import numpy as np

    _, a, b = np.intersect1d(left.point_ids, right.point_ids, return_indices=True)
    return np.stack([left.uv[a], right.uv[b]]), left.points[a]


def corners_of(result: CalibrationResult, names: Sequence[str]) -> dict[str, tuple[Array, Array]]:
    """By moment, the corners that both cameras saw and the calibration used, as `common_points`."""
    if result.observations is None:
        return {}
    used = {v.id for v in result.views if v.used}
    seen: dict[str, dict[str, View]] = {}
    for view in result.observations.views:
        if view.id in used and view.camera in names:
            seen.setdefault(view.moment, {})[view.camera] = view
    pairs = {m: common_points(v[names[0]], v[names[1]]) for m, v in seen.items() if len(v) == 2}
    return {m: pair for m, pair in pairs.items() if len(pair[1])}
