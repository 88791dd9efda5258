"""Two results compared: every camera and transform that both have, and whether their uncertainties explain it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, Check, Measured, TransformEstimate, as_transform
from calibrant.data.details_comparison import CameraComparison, Comparison, TransformComparison
from calibrant.data.results import verdict_of
from calibrant.diagnose.compare.cameras import compare_cameras
from calibrant.errors import InputError
from calibrant.formats.projects.chains import covariance_between
from calibrant.geometry import so3
from calibrant.geometry.frames import FrameGraph
from calibrant.optimize.chances import chi2_tail
from calibrant.percent import percent

RARE = 0.003
"""A chance below it is said: three sigma of one number."""
_MISSING = 0.01
"""Part of the image that one camera alone sees, above which it is said."""
_SAME_PX, _SAME_MM, _SAME_DEG = 1e-6, 1e-6, 1e-7
"""What numbers in files are rounded to: differences below are none, whatever the sigmas."""


def compare_results(
    first: CalibrationResult,
    second: CalibrationResult,
    *,
    names: tuple[str, str] = ("first", "second"),
    cameras: Sequence[tuple[str, str]] | None = None,
) -> CalibrationResult:
    """A result of kind "comparison": what differs between two, in pixels, mm and deg, with sigma.

    Cameras go by their names; the only camera of each goes with the other's whatever they are called. Both are taken
    as independent: calibrations from the same photos have less between them than is said here. Transforms are compared
    wherever both tie the same two frames, by one transform or by a chain of them.
    Args: names, what the two are called; cameras, pairs of names (of the first, of the second) in place of that.
    Raises: InputError where they have nothing in common, or a name is none of theirs.

        >>> import calibrant as cb
        >>> found = compare_results(cb.read("monday.json"), cb.read("friday.json"))  # doctest: +SKIP
    """
    pairs = _paired(first, second) if cameras is None else list(cameras)
    compared = []
    for a, b in pairs:
        for result, name, whose in ((first, a, names[0]), (second, b, names[1])):
            if name not in result.cameras:
                listed = ", ".join(result.cameras) or "none"
                raise InputError(f"{whose} has no camera {name!r}; its cameras: {listed}")
        compared.append(compare_cameras(first.cameras[a], second.cameras[b], names=(a, b)))
    trees = _Tree(first, {}), _Tree(second, dict(pairs))
    moved = _transforms(*trees)
    if not (compared or moved):
        raise InputError(
            f"{names[0]} and {names[1]} have no camera and no transform in common: {_holds(first)}; {_holds(second)}"
        )
    back = {b: a for a, b in pairs}
    record = Comparison(
        *names,
        tuple(compared),
        tuple(moved),
        only_first=(*(n for n in first.cameras if n not in dict(pairs)), *_alone(*trees)),
        only_second=(*(n for n in second.cameras if n not in back), *_alone(*trees[::-1])),
    )
    checks = tuple(_checks(record))
    return CalibrationResult("comparison", verdict_of(checks), checks, figures=_figures(record), details=(record,))


def _holds(result: CalibrationResult) -> str:
    cameras = ", ".join(result.cameras)
    transforms = ", ".join(f"{t.parent} → {t.child}" for t in result.transforms)
    return f"a {result.kind} result with " + ("; ".join(part for part in (cameras, transforms) if part) or "neither")


def _paired(first: CalibrationResult, second: CalibrationResult) -> list[tuple[str, str]]:
    if len(first.cameras) == len(second.cameras) == 1:
        return [(next(iter(first.cameras)), next(iter(second.cameras)))]
    common = [(name, name) for name in first.cameras if name in second.cameras]
    if first.cameras and second.cameras and not common:
        raise InputError(
            f"the cameras have other names, {', '.join(first.cameras)} and {', '.join(second.cameras)}; say which go "
            "together: --camera FIRST:SECOND"
        )
    return common


@dataclass(frozen=True, eq=False)
class _Tree:
    """A result's frames under the first result's names for cameras, and any of them relative to any other."""

    result: CalibrationResult
    called: Mapping[str, str]

    @cached_property
    def graph(self) -> FrameGraph:
        """Of all its transforms; where two ways lead to a frame, they are the same but for rounding."""
        graph = FrameGraph(tolerance_m=np.inf, tolerance_rad=np.inf)
        for t in self.result.transforms:
            graph = graph.add(t.parent, t.child, t.matrix)
        return graph

    def holds(self, parent: str, child: str) -> bool:
        """Whether a chain of its transforms ties the two."""
        ends = {self.called.get(frame, frame) for frame in (parent, child)}
        return any(ends <= set(group) for group in self.graph.groups())

    def between(self, parent: str, child: str) -> TransformEstimate:
        """T_parent_child along the shortest chain, with what the errors along it have in common."""
        a, b = (self.called.get(frame, frame) for frame in (parent, child))
        return as_transform(parent, child, self.graph.T(a, b), covariance_between(self.result, a, b))

    def edges(self) -> list[tuple[str, str]]:
        """Its transforms, under the first result's names."""
        back = {theirs: ours for ours, theirs in self.called.items()}
        return [(back.get(t.parent, t.parent), back.get(t.child, t.child)) for t in self.result.transforms]

    def chain(self, parent: str, child: str) -> tuple[str, ...]:
        """The frames between the two."""
        back = {theirs: ours for ours, theirs in self.called.items()}
        path = self.graph.path(*(self.called.get(frame, frame) for frame in (parent, child)))
        return tuple(back.get(frame, frame) for frame in path[1:-1])


def _transforms(first: _Tree, second: _Tree) -> list[TransformComparison]:
    """Every transform of one whose two frames the other ties too, by a transform either way round or by a chain of
    them; the first one's, then what the second adds."""
    known: dict[frozenset[str], TransformComparison] = {}
    for parent, child in (*first.edges(), *second.edges()):
        ends = frozenset((parent, child))
        if ends not in known and first.holds(parent, child) and second.holds(parent, child):
            via = first.chain(parent, child) or second.chain(parent, child)
            a, b = (tree.between(parent, child) for tree in (first, second))
            known[ends] = _moved(a, b.matrix, b.covariance, via)
    return list(known.values())


def _alone(tree: _Tree, other: _Tree) -> list[str]:
    """The transforms whose frames the other does not tie."""
    edges = zip(tree.edges(), tree.result.transforms)
    return sorted({f"{t.parent} → {t.child}" for ends, t in edges if not other.holds(*ends)})


def _moved(a: TransformEstimate, T: Array, C_b: Array | None, via: tuple[str, ...]) -> TransformComparison:
    """Errors as `se3.retract` has them, of rotation and translation along the parent's axes."""
    turn = so3.log(T[:3, :3] @ a.matrix[:3, :3].T)
    step = T[:3, 3] - a.matrix[:3, 3]
    mm, deg = _triple(1e3 * step), _triple(np.rad2deg(turn))
    if a.covariance is None or C_b is None:
        return TransformComparison(a.parent, a.child, mm, deg, via=via)
    C = a.covariance + C_b
    sigma = np.sqrt(np.maximum(np.diag(C), 0.0))
    sigmas = _triple(1e3 * sigma[3:]), _triple(np.rad2deg(sigma[:3]))
    return TransformComparison(a.parent, a.child, mm, deg, *sigmas, _chance(C, np.concatenate([turn, step])), via)


def _chance(C: Array, e: Array) -> float | None:
    """Of an error as large; directions that are held exactly tell nothing."""
    free = np.diag(C) > 0
    if not free.any():
        return None
    # Radians and metres beside each other: in units of their own sigma.
    s = np.sqrt(np.diag(C)[free])
    z = e[free] / s
    return chi2_tail(int(free.sum()), float(z @ np.linalg.pinv(C[np.ix_(free, free)] / np.outer(s, s)) @ z))


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _figures(record: Comparison) -> dict[str, Measured]:
    """The differences by name; of several cameras and transforms with whose they are."""
    out = {}
    for c in record.cameras:
        tail = f" of {c.first}" if len(record.cameras) > 1 else ""
        out[f"difference{tail}"] = Measured(c.rms_px, unit="px")
        out[f"largest difference{tail}"] = Measured(c.most_px, unit="px")
        out[f"difference without rotation{tail}"] = Measured(c.rotated_rms_px, unit="px")
        out[f"largest difference without rotation{tail}"] = Measured(c.rotated_most_px, unit="px")
        if c.expected_px is not None:
            out[f"difference by the uncertainties{tail}"] = Measured(c.expected_px, unit="px")
        out[f"implied rotation{tail}"] = Measured(float(np.linalg.norm(c.rotation_mrad)), unit="mrad")
    for t in record.transforms:
        name = f"{t.parent} → {t.child}"
        for what, value, sigma in (("mm", t.mm, t.mm_sigma), ("deg", t.deg, t.deg_sigma)):
            out[f"{name}, {'shift' if what == 'mm' else 'turn'}"] = Measured(
                float(np.linalg.norm(value)), float("nan") if sigma is None else _along(value, sigma), what
            )
    return out


def _along(value: Sequence[float], sigma: Sequence[float]) -> float:
    """1 sigma of a length: along it, where there is one; else its worst axis."""
    size = float(np.linalg.norm(value))
    return float(np.linalg.norm(np.multiply(value, sigma)) / size) if size > 0 else float(max(sigma))


def _checks(record: Comparison) -> list[Check]:
    out = []
    for c in record.cameras:
        name = c.first if c.first == c.second else f"{c.first} and {c.second}"
        out.append(_of_camera(c, name))
        if c.first_size != c.second_size:
            out.append(_sizes(c, name))
        if c.first_model != c.second_model:
            text = f"models {c.first_model} and {c.second_model}: compared by what they see"
            out.append(Check(f"models-{name}", "ok", text))
        if c.shared < 1 - _MISSING:
            text = f"only {percent(c.shared)} of the image of {name} is seen by both; the rest is not compared"
            out.append(Check(f"field-{name}", "warn", text, c.shared))
    for t in record.transforms:
        name, frames = f"{t.parent}-{t.child}", f"{t.parent} → {t.child}"
        frames += f" (in one of them by way of {', '.join(t.via)})" if t.via else ""
        mm, deg = float(np.linalg.norm(t.mm)), float(np.linalg.norm(t.deg))
        if mm < _SAME_MM and deg < _SAME_DEG:
            out.append(Check(name, "ok", f"{frames}: the same", t.chance))
        else:
            out.append(_judged(name, f"{frames}: {mm:.3g} mm and {deg:.3g} deg apart", t.chance))
    return out


def _of_camera(c: CameraComparison, name: str) -> Check:
    if c.rotated_most_px < _SAME_PX:
        return Check(f"lens-{name}", "ok", f"{name}: the same over the whole image", c.chance)
    text = f"{name}: {c.rotated_rms_px:.3g} px RMS apart over the image, {c.rotated_most_px:.3g} px at most"
    if c.expected_px is not None:
        text += f"; the uncertainties make {c.expected_px:.3g} px"
    return _judged(f"lens-{name}", text, c.chance)


def _judged(name: str, text: str, chance: float | None) -> Check:
    """Whether the uncertainties explain a difference; a difference without them is stated, not judged."""
    if chance is None:
        return Check(name, "ok", f"{text}; one of the two states no uncertainty, so that nothing judges it")
    if chance < RARE:
        words = "less than 1 in a million" if chance < 1e-6 else percent(chance)
        return Check(name, "warn", f"{text}: more than the uncertainties explain (chance {words})", chance)
    return Check(name, "ok", f"{text}: within the uncertainties", chance)


def _sizes(c: CameraComparison, name: str) -> Check:
    (w, h), (w2, h2) = c.first_size, c.second_size
    said = f"{name}: pictures of {w}x{h} and {w2}x{h2} px"
    if abs(w * h2 - w2 * h) <= max(w, h, w2, h2):
        return Check(f"size-{name}", "ok", f"{said}, compared as if the second were scaled to the first", w2 / w)
    return Check(f"size-{name}", "warn", f"{said}: no scale makes one the other, compared pixel by pixel as they stand")
