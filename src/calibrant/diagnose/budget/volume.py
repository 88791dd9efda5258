"""A working volume as people type it: a box in the base frame with units, a tolerance, a share in percent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.data import Check
from calibrant.errors import InputError
from calibrant.targets.lengths import parse_length

STEPS = (9, 9, 5)
"""Places along x, y, z: the uncertainty is a smooth function, its square about quadratic along every line."""


@dataclass(frozen=True)
class Volume:
    """A box in the base frame: lower and upper corner (x, y, z), metres."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def __post_init__(self) -> None:
        for axis, low, high in zip("xyz", self.lower, self.upper):
            if not (np.isfinite(low) and np.isfinite(high) and low <= high):
                raise InputError(
                    f"workspace: {axis} goes from {1e3 * low:g} mm to {1e3 * high:g} mm; the lower end comes first"
                )

    @property
    def centre(self) -> Array:
        """The middle (3,), metres."""
        return 0.5 * (np.array(self.lower) + np.array(self.upper))

    def grid(self, steps: Sequence[int] = STEPS) -> Array:
        """Points (nx, ny, nz, 3), metres; an axis without extent has one place."""
        axes = [np.linspace(a, b, n if b > a else 1) for a, b, n in zip(self.lower, self.upper, steps)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    @property
    def text(self) -> str:
        """As `parse_volume` reads it."""
        return ",".join(f"{1e3 * a:.6g}mm:{1e3 * b:.6g}mm" for a, b in zip(self.lower, self.upper))


def parse_volume(text: str) -> Volume:
    """A volume in the base frame, such as 300mm:700mm,-200mm:200mm,0mm:100mm (x, y, z).

    Raises: InputError for a wrong number of ranges, a bare number, an unknown unit.
    """
    parts = text.split(",")
    if len(parts) != 3 or any(p.count(":") != 1 for p in parts):
        raise InputError(
            f"workspace {text!r}: expected three ranges x0:x1,y0:y1,z0:z1 with units, such as "
            "300mm:700mm,-200mm:200mm,0mm:100mm"
        )
    ends = [[parse_coordinate(e, what=f"workspace, {axis}") for e in p.split(":")] for axis, p in zip("xyz", parts)]
    x, y, z = ends
    return Volume((x[0], y[0], z[0]), (x[1], y[1], z[1]))


def parse_coordinate(text: str, *, what: str) -> float:
    """Metres of a length with its unit and sign: -200mm, 0mm, 0.7m. Raises: InputError as `parse_length`."""
    word = text.strip()
    sign = -1.0 if word.startswith("-") else 1.0
    magnitude = word.lstrip("+-")
    digits = magnitude.rstrip("mcinuµ ")
    if digits and not digits.strip("0.") and digits != magnitude:
        parse_length(f"1{magnitude[len(digits) :]}", what=what)  # the unit of a zero is checked as well
        return 0.0
    return sign * parse_length(magnitude, what=what)


def parse_fraction(text: str, *, what: str) -> float:
    """A relative size in percent with its sign, such as 0.05%. Raises: InputError for anything else."""
    number = text.strip().removesuffix("%")
    try:
        value = float(number) / 100
    except ValueError:
        value = -1.0
    if not text.strip().endswith("%") or not 0 <= value < 1:
        raise InputError(f"{what}: expected percent from 0% to below 100%, such as 0.05%; got {text!r}")
    return value


def parse_share(text: str, *, what: str) -> float:
    """A share in percent, above 0% to 100%. Raises: InputError for anything else."""
    value = 1.0 if text.strip() == "100%" else parse_fraction(text, what=what)
    if value <= 0:
        raise InputError(f"{what}: the share must be above 0%, got {text!r}")
    return value


def check_request(workspace: str | None, tolerance: str | None, target_sigma: str | None) -> None:
    """Refuse options that cannot be read before any work is done. Raises: InputError naming the option."""
    if workspace is None and (tolerance is not None or target_sigma is not None):
        option = "--tolerance" if tolerance is not None else "--target-sigma"
        raise InputError(f"{option} speaks of a volume: add --workspace 300mm:700mm,-200mm:200mm,0mm:100mm")
    if workspace is not None:
        parse_volume(workspace)
    if tolerance is not None:
        parse_length(tolerance, what="--tolerance")
    if target_sigma is not None:
        parse_fraction(target_sigma, what="--target-sigma")


def is_workspace_check(check: Check) -> bool:
    """Whether a check is one of `with_workspace`."""
    return check.name == "workspace" or check.name.startswith("workspace-")
