"""Does the doctor keep quiet about clean data and name every fault, whatever the arm, the camera and the noise?

    python benchmarks/doctor_simulated.py                        100 clean and 100 faulty data sets
    python benchmarks/doctor_simulated.py --clean 20 --faulty 0  fewer
    python benchmarks/doctor_simulated.py --fault "moved target" one kind of fault

Every data set is drawn anew: setup, arm, mounting, camera, target, 6 to 40 poses, pixel noise of 0.05 to 1 px, errors
of the robot up to 1 mm and 0.2 degrees (white, or of its geometry too); target poses found from pictures that are not
handed over, or pictures whose camera is known or calibrated from them. Faults go round in turn. Passes when at most 2 %
of the clean sets raise an alarm, 95 % of the faults are named, and 95 % of the repaired results lie within 2 sigma of
the clean ones.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from doctor import ABOUT_MOTIONS, FAULTS, Sample, Text, diagnosed, distance, native, reference, result_of
from numpy.typing import NDArray
from parts.doctor_worlds import SOURCES, Source, World, about_one_axis, by_five_joints, draw_world, without_turns
from scipy.special import betaincinv

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.doctor.diagnosis import Diagnosis
from calibrant.diagnose.doctor.repair import calibrate_repaired
from calibrant.errors import CalibrantError
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]
ALARMS, NAMED, AGREES = 0.02, 0.95, 0.95
LEAST_POSES = 6


Corrupt = Callable[[World, np.random.Generator], tuple[Text, Sample]]


@dataclass(frozen=True, eq=False)
class Fault:
    """Names that are right for it, and how it comes about.

    least: poses that it takes; source: data that can show it; repairable: the repaired data give the clean result.
    """

    names: tuple[str, ...]
    corrupt: Corrupt
    least: int = LEAST_POSES
    source: Source | None = None
    repairable: bool = True


def _moved(what: str) -> Corrupt:
    def corrupt(w: World, rng: np.random.Generator) -> tuple[Text, Sample]:
        first = int(rng.integers(3, len(w) - 3))
        D = _step(rng, (2, 8), (0.005, 0.03))
        B = w.B.copy()
        B[first:] = B[first:] @ D if what == "target" else se3.inverse(D) @ B[first:]
        return native(w.reported), w.sample(B=B)

    return corrupt


def _step(rng: np.random.Generator, deg: tuple[float, float], metres: tuple[float, float]) -> Array:
    """A transform that turns and moves by as much, in any direction."""
    turn, move = rng.standard_normal((2, 3))
    turn *= np.deg2rad(rng.uniform(*deg)) / np.linalg.norm(turn)
    return se3.make(so3.exp(turn), move * rng.uniform(*metres) / np.linalg.norm(move))


def _stale(w: World, rng: np.random.Generator) -> tuple[Text, Sample]:
    p, factor = dict(w.camera.parameters), float(rng.choice([0.97, 1.03]))
    p |= {"fx": p["fx"] * factor, "fy": p["fy"] * factor, "cx": p["cx"] + 0.01 * w.camera.image_size[0]}
    return native(w.reported), replace(w.sample(), camera=Camera.create("brown", p, image_size=w.camera.image_size))


def _text_sorted(w: World, _: np.random.Generator) -> tuple[Text, Sample]:
    return native(w.reported[sorted(range(len(w)), key=lambda i: w.ids[i])]), w.sample()


def _bad_pose(w: World, rng: np.random.Generator) -> tuple[Text, Sample]:
    T, k = w.reported.copy(), int(rng.integers(len(w)))
    T[k] = T[k] @ _step(rng, (5, 20), (0.03, 0.1))
    return native(T), w.sample()


def _two_poses(w: World, _: np.random.Generator) -> tuple[Text, Sample]:
    s = w.sample().take([0, 1])
    return native(s.T), s


def _motion(change: Callable[[World, np.random.Generator], World]) -> Corrupt:
    def corrupt(w: World, rng: np.random.Generator) -> tuple[Text, Sample]:
        w = change(w, rng)
        return native(w.reported), w.sample()

    return corrupt


def _as_real(name: str) -> Corrupt:
    return lambda w, rng: FAULTS[name][1](w.sample(), rng)


def _by_motion(names: tuple[str, ...], corrupt: Corrupt) -> Fault:
    return Fault(names, corrupt, source="known camera", repairable=False)


MOTIONS: dict[str, Callable[[World, np.random.Generator], World]] = {
    "any": lambda w, _: w,
    "five joints": by_five_joints,
}
MOVED = ("target-moved", "camera-moved")
KINDS = {
    **{name: Fault((expected, "header-overruled"), _as_real(name)) for name, (expected, _) in FAULTS.items()},
    "moved target": Fault(MOVED, _moved("target"), 9),
    "moved camera": Fault(MOVED, _moved("camera"), 9),
    "stale intrinsics": Fault(("stale-intrinsics",), _stale, source="known camera"),
    "sorted as text": Fault(("poses-sorted-as-text",), _text_sorted, 13),
    "bad pose": Fault(("bad-pose",), _bad_pose),
    "parallel axes": _by_motion(("parallel-axes",), _motion(about_one_axis)),
    "pure translation": _by_motion(("pure-translation",), _motion(without_turns)),
    "two poses": _by_motion(("poses",), _two_poses),
}


def alarms(diagnosis: Diagnosis) -> list[str]:
    """What is said against the data, not against the motions."""
    bad = [f for f in diagnosis.findings if f.status != "ok" and f.name not in ABOUT_MOTIONS]
    return [f"{f.name}: {f.message[:230]}" for f in bad]


def run_clean(world: World, folder: Path) -> list[str]:
    """What is said against clean data."""
    s = world.sample()
    try:
        return alarms(diagnosed(native(s.T), s, folder, known=world.source == "known camera"))
    except CalibrantError as error:
        return [] if any(name in str(error) for name in ABOUT_MOTIONS) else [f"refused: {str(error)[:230]}"]


def run_fault(kind: str, w: World, rng: np.random.Generator, folder: Path) -> tuple[bool, float | None, str]:
    """Named or not, how far the repaired result is from the clean one (sigma), remarks."""
    fault = KINDS[kind]
    text, bad = fault.corrupt(w, rng)
    try:
        d = diagnosed(text, bad, folder, known=w.source == "known camera")
    except CalibrantError as error:
        named = not fault.repairable and any(name in str(error) for name in fault.names)
        return named, None, "" if named else f"refused: {str(error)[:230]}"
    extra = [a for a in alarms(d) if a.split(":")[0] not in fault.names]
    if not any(d.named(name) for name in fault.names):
        return False, None, f"not named, found {'; '.join(extra) or 'nothing'}"
    remark = f"but also {'; '.join(extra)}" if extra else ""
    if not fault.repairable:
        return True, None, remark
    kept = w.ids.index(d.repaired.ids[0]) if kind == "moved camera" else 0
    try:
        off = distance(result_of(lambda: calibrate_repaired(d)), _reference(kind, w, bad, kept))
    except CalibrantError as error:
        return True, None, f"not calibrated: {str(error)[:200]} {remark}"
    return True, off, f"{off:.2f} sigma off {remark}" if off > 1 or extra else ""


def _reference(kind: str, w: World, bad: Sample, kept: int) -> CalibrationResult:
    """What the repaired data should give: the clean ones' result; of a camera that moved, that of its later place."""
    clean = bad.take(range(kept, len(w))) if kept > 0 else w.sample()
    if w.source == "own camera":
        clean = replace(clean, camera=None)  # as the repaired data, which calibrate it with the rest
    return reference(kind, clean)


def interval(count: int, total: int) -> str:
    """The share with its 95 % interval (Clopper and Pearson, 1934), per cent."""
    low = betaincinv(count, total - count + 1, 0.025) if count else 0.0
    high = betaincinv(count + 1, total - count, 0.975) if count < total else 1.0
    return f"{count} of {total} = {100 * count / total:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--faulty", type=int, default=100)
    parser.add_argument("--fault", choices=tuple(KINDS), action="append")
    parser.add_argument("--source", choices=SOURCES, help="of the clean sets; by default any")
    parser.add_argument("--motion", choices=tuple(MOTIONS), default="any", help="of the clean sets")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        raised = clean_table(given, Path(name))
        tally = fault_table(given, Path(name))
    rows = [row for some in tally.values() for row in some]
    offs = [off for _, off in rows if off is not None]
    named, within = sum(n for n, _ in rows), sum(off <= 2 for off in offs)
    return 0 if raised <= ALARMS * given.clean and named >= NAMED * len(rows) and within >= AGREES * len(offs) else 1


def clean_table(given: argparse.Namespace, folder: Path) -> int:
    """Alarms about clean data, counted and printed."""
    raised = 0
    for trial in range(given.clean):
        rng = np.random.default_rng([given.seed, 0, trial])
        world = MOTIONS[given.motion](draw_world(rng, source=given.source), rng)
        while len(world) < LEAST_POSES:  # a cell in which this arm sees nothing
            world = MOTIONS[given.motion](draw_world(rng, source=given.source), rng)
        said = run_clean(world, folder)
        raised += bool(said)
        if said:
            print(f"clean {trial}: {'; '.join(said)} ({world.words})", flush=True)
    if given.clean:
        print(f"clean: alarms in {interval(raised, given.clean)}", flush=True)
    return raised


def fault_table(given: argparse.Namespace, folder: Path) -> dict[str, list[tuple[bool, float | None]]]:
    """Each fault in turn: named, and how far the repaired result is off."""
    kinds = given.fault or list(KINDS)
    tally: dict[str, list[tuple[bool, float | None]]] = {}
    for trial in range(given.faulty):
        kind = kinds[trial % len(kinds)]
        rng = np.random.default_rng([given.seed, 1 + list(KINDS).index(kind), trial])
        world = draw_world(rng, source=KINDS[kind].source, least=KINDS[kind].least)
        named, off, text = run_fault(kind, world, rng, folder)
        tally.setdefault(kind, []).append((named, off))
        if text:
            print(f"{kind} {trial}: {text} ({world.words})", flush=True)
    for kind, rows in tally.items():
        offs = [off for _, off in rows if off is not None]
        near, fair = (sum(off <= limit for off in offs) for limit in (1, 2))
        named = interval(sum(n for n, _ in rows), len(rows))
        print(f"{kind:17s} named {named}, within 1 sigma {near}, 2 sigma {fair} of {len(offs)}")
    return tally


if __name__ == "__main__":
    sys.exit(main())
