"""Does the doctor name every fault, keep quiet about clean data, and repair what it names?

    python benchmarks/doctor.py                          200 corruptions of each kind, 200 clean subsets, each data set
    python benchmarks/doctor.py --trials 20              fewer
    python benchmarks/doctor.py --data moveit --fault swapped

Real data from ../shared/data: 50 pose pairs (handeye_moveit_poses) and 12 pictures of a ChArUco board with their poses
(handeye_rct_charuco_static), random subsets of them, corrupted as users do it. Passes when every fault is named in 95 %
of the trials, clean data raise an alarm in 2 % at most, and the repaired data give the result of the clean ones within
1 sigma (its covariance) in 95 %; after a wrong size, that of the clean ones at the size that they say themselves.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, RobotPoses
from calibrant.diagnose.doctor.diagnosis import Diagnosis, diagnose_poses, diagnose_views
from calibrant.diagnose.doctor.repair import calibrate_repaired
from calibrant.errors import CalibrantError, RefusedError
from calibrant.formats.poses.read import notations, read_poses
from calibrant.geometry import rotations, se3
from calibrant.simulate.noise import flipped_board
from calibrant.simulate.truth import normalised

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"
NAMED, ALARMS, AGREES = 0.95, 0.02, 0.95
SEED = 2027
"""Of the subsets and corruptions; not one that the doctor was developed on."""
ABOUT_MOTIONS = ("poses", "parallel-axes", "pure-translation", "half-turns", "small-rotations")
"""What is said about a subset's motions is no alarm about its data."""
BOARD = np.array([[0.0, 0.0, 0.0], [0.2, 0.15, 0.0]])
"""Corners of a board of ordinary size, for flips of poses whose board is not known."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Clean data: ids, T_base_gripper (n, 4, 4), and target poses or observations with their camera."""

    setup: str
    ids: tuple[str, ...]
    T: Array
    B: Array | None = None
    observations: Observations | None = None
    camera: Camera | None = None

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: Sequence[int]) -> Sample:
        """Some of the moments."""
        ids = tuple(self.ids[i] for i in rows)
        observations = None if self.observations is None else self.observations.only(ids)
        B = None if self.B is None else self.B[list(rows)]
        return replace(self, ids=ids, T=self.T[list(rows)], B=B, observations=observations)

    def with_board(self, k: int, change: Callable[[Array], Array]) -> Sample:
        """Target pose k changed (pose pairs), or the points of view k (pictures)."""
        if self.B is not None:
            B = self.B.copy()
            B[k] = flipped_board(BOARD, B[k])
            return replace(self, B=B)
        views = tuple(
            replace(v, points=change(v.points)) if v.id == self.ids[k] else v for v in self.observations.views
        )
        return replace(self, observations=replace(self.observations, views=views))

    def scaled(self, factor: float) -> Sample:
        """The target given `factor` times too large."""
        if self.B is not None:
            B = self.B.copy()
            B[:, :3, 3] *= factor
            return replace(self, B=B)
        views = tuple(replace(v, points=v.points * factor) for v in self.observations.views)
        return replace(self, observations=replace(self.observations, views=views))


@dataclass(frozen=True)
class Text:
    """How poses are written: header and numbers (n, k)."""

    header: str
    numbers: Array


def native(T: Array) -> Text:
    """The documented form."""
    q = rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])
    return Text("x,y,z,qx,qy,qz,qw", np.column_stack([T[:, :3, 3], q]))


def euler(T: Array, order: str) -> Text:
    """Degrees, in an order that no name tells."""
    angles = rotations.euler_from_matrix(T[:, :3, :3], order=order, unit="deg")
    return Text("x,y,z,e1,e2,e3", np.column_stack([T[:, :3, 3], angles]))


def scalar_first(T: Array) -> Text:
    """w x y z under names that say x y z w."""
    text = native(T)
    return replace(text, numbers=np.column_stack([text.numbers[:, :3], np.roll(text.numbers[:, 3:], 1, axis=1)]))


def millimetres(T: Array) -> Text:
    """Positions in mm under names without a unit."""
    text = native(T)
    return replace(text, numbers=text.numbers * [1e3, 1e3, 1e3, 1, 1, 1, 1])


Corruption = Callable[[Sample, np.random.Generator], tuple[Text, Sample]]


def _shifted(s: Sample, rng: np.random.Generator) -> tuple[Text, Sample]:
    return native(np.roll(s.T, rng.choice([-1, 1]), axis=0)), s


def _swapped(s: Sample, rng: np.random.Generator) -> tuple[Text, Sample]:
    T, (i, j) = s.T.copy(), rng.choice(len(s), 2, replace=False)
    T[[i, j]] = T[[j, i]]
    return native(T), s


def _flipped(s: Sample, rng: np.random.Generator) -> tuple[Text, Sample]:
    every = np.zeros((1, 3)) if s.observations is None else np.concatenate([v.points for v in s.observations.views])
    ends = every.min(axis=0) + every.max(axis=0)
    return native(s.T), s.with_board(int(rng.integers(len(s))), lambda points: ends - points)


FAULTS: dict[str, tuple[str, Corruption]] = {
    "inverted": ("pose-direction", lambda s, _: (native(se3.inverse(s.T)), s)),
    "mm": ("pose-units", lambda s, _: (millimetres(s.T), s)),
    "euler ZYX": ("pose-rotation", lambda s, _: (euler(s.T, "ZYX"), s)),
    "euler xyz": ("pose-rotation", lambda s, _: (euler(s.T, "xyz"), s)),
    "quaternions wxyz": ("pose-rotation", lambda s, _: (scalar_first(s.T), s)),
    "shifted": ("poses-shifted", _shifted),
    "swapped": ("poses-swapped", _swapped),
    "flipped": ("board-flipped", _flipped),
    "size": ("target-size", lambda s, rng: (native(s.T), s.scaled(float(rng.choice([0.95, 1.05]))))),
}


def moveit() -> Sample:
    """50 pose pairs, eye-to-hand."""
    raw = read_poses(DATA / "handeye_moveit_poses" / "pose_samples.json")
    ids = tuple(f"{i}.png" for i in range(len(raw)))
    return Sample("eye-to-hand", ids, notations(raw)[0].T_base_gripper, B=notations(raw.target)[0].T_base_gripper)


def charuco() -> Sample:
    """12 pictures, eye-to-hand; two show too little of the board to be used by themselves."""
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.detection import detect
    from calibrant.targets.registry import parse_target

    folder = DATA / "handeye_rct_charuco_static"
    target = parse_target("charuco:5x7:36.195mm:18.256mm:DICT_6X6_250")
    observations = detect([str(folder / "images")], target=target)
    views = tuple(replace(v, file=None) for v in observations.views)
    observations = replace(observations, views=views)
    notation = notations(read_poses(str(folder / "poses" / "*.yaml")))[0]
    ids = tuple(v.id for v in views)
    T = notation.take([notation.ids.index(Path(i).stem) for i in ids]).T_base_gripper
    camera = calibrate_intrinsics(observations).camera
    return Sample("eye-to-hand", ids, T, observations=observations, camera=camera)


DATA_SETS: dict[str, tuple[Callable[[], Sample], tuple[int, int], tuple[int, int]]] = {
    "moveit": (moveit, (8, 41), (30, 51)),
    "charuco": (charuco, (8, 13), (10, 13)),
}
"""Loader; sizes (from, below) of clean subsets; sizes of subsets that are corrupted."""


def diagnosed(text: Text, sample: Sample, folder: Path, *, known: bool = False) -> Diagnosis:
    """The doctor on poses written to a file, as a user hands them over; known: the camera was given."""
    path = folder / "poses.csv"
    rows = "\n".join(f"{i}," + ",".join(repr(float(x)) for x in row) for i, row in zip(sample.ids, text.numbers))
    path.write_text(f"image,{text.header}\n{rows}\n")
    complete = notations(read_poses(path))
    if sample.B is not None:
        return diagnose_poses(complete, sample.B)
    return diagnose_views(complete, sample.observations, sample.camera, camera_given=known)


def result_of(calibrate: Callable[[], CalibrationResult]) -> CalibrationResult:
    """The calibration that would be handed out, also when it is doubted."""
    try:
        return calibrate()
    except RefusedError as error:
        if isinstance(error.result, CalibrationResult):
            return error.result
        raise


def repaired_result(diagnosis: Diagnosis) -> CalibrationResult:
    """Calibration of the repaired data; the camera is held as given."""
    case = replace(diagnosis.repaired, camera_given=True)
    given = replace(diagnosis, examination=replace(diagnosis.examination, repaired=case))
    return result_of(lambda: calibrate_repaired(given))


def reference(name: str, sample: Sample) -> CalibrationResult:
    """What the repaired data should give: the calibration of the clean ones, at the size that the repair measures.

    A size that was given wrong cannot be repaired to the one printed on the board, only to the one that the robot's
    motion says, and no print is exact: the clean data are then calibrated at the size that they themselves say.
    """
    clean = clean_result(sample)
    if name != "size" or clean.target_scale is None:
        return clean
    return clean_result(sample.scaled(clean.target_scale.value))


def clean_result(sample: Sample) -> CalibrationResult:
    """Calibration of the data as they are."""
    poses = RobotPoses(sample.ids, sample.T)
    target = sample.B if sample.B is not None else sample.observations
    return result_of(lambda: calibrate_hand_eye(poses, target, setup=sample.setup, camera=sample.camera))


def distance(result: CalibrationResult, clean: CalibrationResult) -> float:
    """sqrt(d^T C^-1 d / 6) of the camera's transform, C the covariance that the repaired result states."""
    estimate, truth = result.transforms[0], clean.transforms[0]
    return float(np.sqrt(normalised(estimate, truth.matrix) / 6))


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    trials: int
    named: float
    agrees: float
    compared: int
    seconds: float
    remarks: tuple[str, ...] = ()


def run_fault(
    name: str, sample: Sample, sizes: tuple[int, int], trials: int, compare: int, folder: Path, *, seed: int = SEED
) -> Row:
    """One kind of corruption on random subsets."""
    expected, corrupt = FAULTS[name]
    named = agrees = compared = 0
    seconds, remarks = 0.0, []
    for trial in range(trials):
        rng = np.random.default_rng([seed, list(FAULTS).index(name), trial])
        some = sample.take(np.sort(rng.choice(len(sample), int(rng.integers(*sizes)), replace=False)).tolist())
        text, bad = corrupt(some, rng)
        start = time.perf_counter()
        try:
            diagnosis = diagnosed(text, bad, folder)
        except CalibrantError as error:
            remarks.append(f"{trial}: refused: {str(error)[:100]}")
            continue
        seconds += time.perf_counter() - start
        hit = bool(diagnosis.named(expected)) and _undone(diagnosis, some)
        named += hit
        if not hit:
            found = ", ".join(f.name for f in diagnosis.findings if f.status != "ok") or "nothing"
            remarks.append(f"{trial}: {len(some)} views: found {found}")
        elif compared < compare:
            compared += 1
            off = distance(repaired_result(diagnosis), reference(name, some))
            agrees += off <= 1
            if off > 1:
                remarks.append(f"{trial}: result {off:.2f} sigma off")
    return Row(name, trials, named / trials, agrees / max(compared, 1), compared, seconds / trials, tuple(remarks))


def _undone(diagnosis: Diagnosis, some: Sample) -> bool:
    """The poses used are the clean ones again, and none was left out but what says too little by itself."""
    if any(f.name in ("bad-pose", "views-disagree") for f in diagnosis.findings):
        return False
    rows = [some.ids.index(i) for i in diagnosis.repaired.ids]
    return bool(np.allclose(diagnosis.repaired.data.T_base_gripper[diagnosis.repaired.index], some.T[rows], atol=1e-6))


def run_clean(sample: Sample, sizes: tuple[int, int], trials: int, folder: Path, *, seed: int = SEED) -> Row:
    """Alarms about data without a fault."""
    alarms, seconds, remarks = 0, 0.0, []
    for trial in range(trials):
        rng = np.random.default_rng([seed, 99, trial])
        rows = np.sort(rng.choice(len(sample), int(rng.integers(*sizes)), replace=False))
        some = sample.take(rows.tolist())
        start = time.perf_counter()
        diagnosis = diagnosed(native(some.T), some, folder)
        seconds += time.perf_counter() - start
        bad = [f for f in diagnosis.findings if f.status != "ok" and f.name not in ABOUT_MOTIONS]
        alarms += bool(bad)
        remarks += [f"{trial}: {len(some)} views: {f.name}: {f.message[:110]}" for f in bad]
    return Row("clean", trials, alarms / trials, 1.0, 0, seconds / trials, tuple(remarks))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--compare", type=int, default=20, help="repaired results compared with the clean one")
    parser.add_argument("--seed", type=int, default=SEED, help="of the subsets and corruptions")
    parser.add_argument("--data", choices=tuple(DATA_SETS), action="append")
    parser.add_argument("--fault", choices=("clean", *FAULTS), action="append")
    given = parser.parse_args()
    passed = True
    with tempfile.TemporaryDirectory() as folder:
        for data in given.data or DATA_SETS:
            load, clean_sizes, sizes = DATA_SETS[data]
            sample = load()
            for name in given.fault or ("clean", *FAULTS):
                if name == "clean":
                    row = run_clean(sample, clean_sizes, given.trials, Path(folder), seed=given.seed)
                    good = row.named <= ALARMS
                    text = f"alarms {100 * row.named:5.1f} %"
                else:
                    row = run_fault(name, sample, sizes, given.trials, given.compare, Path(folder), seed=given.seed)
                    good = row.named >= NAMED and row.agrees >= AGREES
                    text = f"named {100 * row.named:5.1f} %, within 1 sigma {100 * row.agrees:5.1f} % of {row.compared}"
                passed &= good
                print(
                    f"{data:8s} {name:17s} {text:50s} {row.seconds:5.2f} s a case  {'ok' if good else 'FAILED'}",
                    flush=True,
                )
                for remark in row.remarks[:6]:
                    print(f"            {remark}")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
