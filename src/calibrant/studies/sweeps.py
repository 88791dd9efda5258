"""Where the classical methods fail: one condition at a time is carried to its degenerate value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from calibrant.studies import methods as study_methods
from calibrant.studies.methods import USES, Method, Outcome, Use
from calibrant.studies.scenes import Conditions, plane_case, solid_case

PLANE, DEPTH, ALL = USES


@dataclass(frozen=True)
class Sweep:
    """A condition and the values it takes. `change` gives the conditions of a value."""

    title: str
    unit: str
    lesson: str
    uses: tuple[Use, ...]
    values: tuple[float, ...]
    change: Callable[[Conditions, float], Conditions]


@dataclass(frozen=True)
class Row:
    """A method along a sweep: a median outcome a value, and how many of its runs were refused."""

    method: str
    use: Use
    outcomes: tuple[Outcome, ...]
    refused: tuple[int, ...]


@dataclass(frozen=True)
class Swept:
    """A sweep that was run, with `trials` scenes a value."""

    sweep: Sweep
    trials: int
    rows: tuple[Row, ...]


def _lens(conditions: Conditions, value: float) -> Conditions:
    return replace(conditions, lens=f"brown:{value:g}" if value else "pinhole")


SWEEPS = (
    Sweep(
        "Noise", "px", "Errors grow in proportion; without noise and with the right lens they vanish.", USES,
        (0.0, 0.05, 0.1, 0.2, 0.5, 1.0), lambda c, v: replace(c, noise_px=v),
    ),
    Sweep(
        "Number of points", "", "Each method has its least number; just above it, errors are large.", USES,
        (4, 5, 6, 7, 12, 40), lambda c, v: replace(c, only=int(v)),
    ),
    Sweep(
        "Tilt of a plane", "deg", "Facing the camera it shows no focal length (slide 62: w = 0).", (PLANE, ALL),
        (40, 20, 10, 5, 2, 0), lambda c, v: replace(c, tilt_deg=(v, v)),
    ),
    Sweep(
        "Depth of the target", "%", "Coplanar points make the system singular (slide 34).", (DEPTH,),
        (100, 30, 10, 3, 1, 0), lambda c, v: replace(c, depth=v / 100),
    ),
    Sweep(
        "t_y of the target's origin", "mm", "Step one divides by t_y (slides 54 to 56).", (PLANE, DEPTH),
        (50, 10, 3, 1, 0.3, 0), lambda c, v: replace(c, t_y_mm=v),
    ),
    Sweep(
        "Error of the principal point", "px", "Tsai's method takes C_x, C_y as known (slides 28 and 52).", USES,
        (0, 2, 5, 10, 20, 40), lambda c, v: replace(c, centre_error_px=v),
    ),
    Sweep(
        "Distortion k1", "", "The DLT and Zhang's closed form have none (slide 35).", USES,
        (0, -0.02, -0.05, -0.1, -0.2, -0.3), _lens,
    ),
)  # fmt: skip


def sweep(one: Sweep, conditions: Conditions, *, trials: int, step: Callable[[], Any]) -> Swept:
    """Run every method that the sweep concerns on `trials` scenes a value. step: called after each value."""
    methods = [m for m in study_methods.methods() if m.use in one.uses]
    found: dict[str, list[tuple[Outcome, int]]] = {m.use + m.name: [] for m in methods}
    for value in one.values:
        scenes = [one.change(replace(conditions, seed=conditions.seed + 1 + t), value) for t in range(trials)]
        for use in one.uses:
            cases = [_scene(use, s) for s in scenes]
            for method in (m for m in methods if m.use == use):
                outcomes = [study_methods.outcome(method, case) for case in cases]
                found[use + method.name].append(study_methods.summary(outcomes))
        step()
    return Swept(one, trials, tuple(_sweep_row(m, found[m.use + m.name]) for m in methods))


def _scene(use: Use, conditions: Conditions) -> Any:
    if use == ALL:
        return plane_case(conditions)
    single = replace(conditions, views=1)
    return plane_case(single) if use == PLANE else solid_case(single)


def _sweep_row(method: Method, found: list[tuple[Outcome, int]]) -> Row:
    return Row(method.name, method.use, tuple(o for o, _ in found), tuple(n for _, n in found))
