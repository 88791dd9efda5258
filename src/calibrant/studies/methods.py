"""The methods that `calibrant study methods` compares, each run on a case and judged against the truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.classical import (
    ClassicalCalibration,
    Degenerate,
    calibrate_dlt,
    calibrate_fast_rac,
    calibrate_tsai,
    calibrate_tsai_coplanar,
    calibrate_zhang,
    calibrate_zhang_one_view,
    zhang_distortion,
)
from calibrant.calibrate.classical.points import dimension
from calibrant.calibrate.classical.radial import RadialModel
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.intrinsics.fit import Start, refine
from calibrant.calibrate.reprojection.factor import stack
from calibrant.cameras import Camera, camera_model
from calibrant.errors import CalibrantError, InputError, RefusedError, causes
from calibrant.geometry import se3
from calibrant.studies.scenes import Case

Use = Literal["plane, one view", "depth, one view", "plane, all views"]
USES: tuple[Use, ...] = ("plane, one view", "depth, one view", "plane, all views")
RADIAL_ONLY = ("tangential", "k2", "k3")


@dataclass(frozen=True)
class Method:
    """One method: what it needs, where the lecture has it, and how it is run."""

    name: str
    use: Use
    source: str
    run: Callable[[Case], ClassicalCalibration]


@dataclass(frozen=True)
class Outcome:
    """What one run gave. `refused`: the name of the failure, with its message; the figures are then None.

    rms_px per point over both axes; focal_percent and centre_px against the truth (or the full solution of all views),
    centre_px None for a method that takes the principal point as known; rotation_deg and position_mm the medians over
    the views' poses, where a truth is known; milliseconds of one run.
    """

    refused: str | None = None
    message: str | None = None
    rms_px: float | None = None
    focal_percent: float | None = None
    centre_px: float | None = None
    rotation_deg: float | None = None
    position_mm: float | None = None
    milliseconds: float | None = None


def methods() -> tuple[Method, ...]:
    """All methods, by what they need."""
    flat, deep, many = USES
    return (
        Method("Tsai, division", flat, "slides 53-63, lens of 50", _tsai("division")),
        Method("Tsai, inverse_brown", flat, "lens of slide 49", _tsai("inverse_brown")),
        Method("Tsai, brown", flat, "lens of slide 47", _tsai("brown")),
        Method("fast RAC", flat, "slides 65-67", _fast_rac),
        Method("Zhang, one view", flat, "Zhang 2000", _zhang_one_view),
        Method("full solution", flat, "least squares in pixels", _full_plane),
        Method("DLT", deep, "slides 32-35", _dlt),
        Method("Tsai, with depth", deep, "Tsai 1987", _tsai_depth),
        Method("full solution", deep, "least squares in pixels", _full_depth),
        Method("Zhang", many, "Zhang 2000", _zhang("zero")),
        Method("Zhang, with skew", many, "Zhang 2000", _zhang("free")),
        Method("Zhang, k1 k2", many, "Zhang 2000, eq. 13", _zhang_radial),
        Method("full solution", many, "least squares in pixels", _full_all),
    )


def fitting(case: Case) -> tuple[Method, ...]:
    """The methods that take this target: those for a plane, or for points with depth."""
    flat = dimension(np.concatenate([v.points for v in case.views])) < 3
    return tuple(m for m in methods() if (m.use == "depth, one view") != flat)


def outcome(method: Method, case: Case, *, repeat: int = 1) -> Outcome:
    """Run a method on a case; its fastest of `repeat` runs is its time. Raises: InputError for unusable views."""
    times = []
    try:
        for _ in range(repeat):
            begin = time.perf_counter()
            found = method.run(case)
            times.append(time.perf_counter() - begin)
    except Degenerate as refusal:
        return Outcome(refused=refusal.name, message=str(refusal))
    except RefusedError as refusal:
        return Outcome(refused="refused", message=str(refusal))
    return _judged(found, case, 1e3 * min(times))


def summary(outcomes: Iterable[Outcome]) -> tuple[Outcome, int]:
    """Medians of the absolute figures of many runs, and how many were refused; a refusal where most were."""
    runs = list(outcomes)
    refused = [o for o in runs if o.refused is not None]
    if 2 * len(refused) >= len(runs):
        names = [o.refused for o in refused]
        name = max(set(names), key=names.count)
        return next(o for o in refused if o.refused == name), len(refused)
    done = [o for o in runs if o.refused is None]

    def median(pick: Callable[[Outcome], float | None]) -> float | None:
        values = [abs(v) for v in map(pick, done) if v is not None]
        return float(np.median(values)) if values else None

    medians = Outcome(
        rms_px=median(lambda o: o.rms_px),
        focal_percent=median(lambda o: o.focal_percent),
        centre_px=median(lambda o: o.centre_px),
        rotation_deg=median(lambda o: o.rotation_deg),
        position_mm=median(lambda o: o.position_mm),
        milliseconds=median(lambda o: o.milliseconds),
    )
    return medians, len(refused)


def runs(method: Method, case: Case, *, repeat: int = 1) -> list[Outcome]:
    """A method on the views it takes: all at once, or each alone."""
    if method.use == "plane, all views":
        return [outcome(method, case, repeat=repeat)]
    return [outcome(method, case.view(i), repeat=repeat) for i in range(len(case.views))]


def with_reference(case: Case) -> Case:
    """A real case with the full solution of all views in the truth's place; unchanged where there is none.

    Views of a target with depth are each judged alone, without a reference.
    """
    if dimension(np.concatenate([v.points for v in case.views])) > 2:
        return case
    try:
        found = _full_all(case)
    except CalibrantError:
        return case
    return Case(case.views, case.image_size, case.centre, case.aspect, found.camera, found.T_camera_target)


def _judged(found: ClassicalCalibration, case: Case, milliseconds: float) -> Outcome:
    squares = []
    for T, view in zip(found.T_camera_target, case.views):
        squares.append(np.sum(view.residuals(found.camera, T) ** 2, axis=1))
    rms = float(np.sqrt(np.mean(np.concatenate(squares))))
    focal = centre = rotation = position = None
    if case.camera is not None:
        focal = 100 * (_mean_focal(found.camera) / _mean_focal(case.camera) - 1)
        if not np.array_equal(found.camera.K[:2, 2], case.centre):
            centre = float(np.linalg.norm(found.camera.K[:2, 2] - case.camera.K[:2, 2]))
    if case.T_camera_target is not None:
        a, b = found.T_camera_target, case.T_camera_target
        position, rotation = (float(np.median(values)) for values in se3.deviation(b, a))
    return Outcome(None, None, rms, focal, centre, rotation, position, milliseconds)


def _mean_focal(camera: Camera) -> float:
    return float(np.sqrt(camera.parameters["fx"] * camera.parameters["fy"]))


def _tsai(radial: RadialModel) -> Callable[[Case], ClassicalCalibration]:
    def run(case: Case) -> ClassicalCalibration:
        view = case.views[0]
        return calibrate_tsai_coplanar(
            view.points,
            view.uv,
            image_size=case.image_size,
            centre=case.centre,
            aspect=case.aspect,
            radial=radial,
        )

    return run


def _fast_rac(case: Case) -> ClassicalCalibration:
    view = case.views[0]
    return calibrate_fast_rac(view.points, view.uv, image_size=case.image_size, centre=case.centre, aspect=case.aspect)


def _zhang_one_view(case: Case) -> ClassicalCalibration:
    view = case.views[0]
    return calibrate_zhang_one_view(view.points, view.uv, image_size=case.image_size, centre=case.centre)


def _dlt(case: Case) -> ClassicalCalibration:
    return calibrate_dlt(case.views[0].points, case.views[0].uv, image_size=case.image_size)


def _tsai_depth(case: Case) -> ClassicalCalibration:
    return calibrate_tsai(
        case.views[0].points, case.views[0].uv, image_size=case.image_size, centre=case.centre, radial="division"
    )


def _zhang(skew: Literal["zero", "free"]) -> Callable[[Case], ClassicalCalibration]:
    def run(case: Case) -> ClassicalCalibration:
        return calibrate_zhang(*_image_columns(case), image_size=case.image_size, skew=skew)

    return run


def _zhang_radial(case: Case) -> ClassicalCalibration:
    points, uv = _image_columns(case)
    return zhang_distortion(calibrate_zhang(points, uv, image_size=case.image_size), points, uv)


def _image_columns(case: Case) -> tuple[Sequence[Array], Sequence[Array]]:
    return [v.points for v in case.views], [v.uv for v in case.views]


def _full_plane(case: Case) -> ClassicalCalibration:
    """f, k1 and the pose from one view, the principal point and the aspect held: what Tsai's method looks for."""
    view = case.views[0]
    start = calibrate_tsai_coplanar(
        view.points,
        view.uv,
        image_size=case.image_size,
        centre=case.centre,
        aspect=case.aspect,
        radial="brown",
        scale="norm",
    )
    return _refined_classical(case, start, fix=("principal", "aspect", *RADIAL_ONLY))


def _full_depth(case: Case) -> ClassicalCalibration:
    """f_x, f_y, c_x, c_y, k1 and the pose from one view of points with depth."""
    return _refined_classical(case, _dlt(case), fix=RADIAL_ONLY)


def _refined_classical(case: Case, start: ClassicalCalibration, *, fix: tuple[str, ...]) -> ClassicalCalibration:
    kind = camera_model("brown")
    values = np.array([start.camera.parameters.get(name, 0.0) for name in kind.parameter_names])
    solution = refine(stack(case.views), kind, Start(values, start.T_camera_target), fix=fix)
    if solution.unobservable:
        raise RefusedError(causes(u.message for u in solution.unobservable[:2]))
    camera = Camera(kind, case.image_size, solution.value("camera")[0])
    return ClassicalCalibration(camera, solution.value("T_camera_target"))


def _full_all(case: Case) -> ClassicalCalibration:
    """All nine parameters of `brown` and all poses: what `calibrant intrinsics` does."""
    try:
        result = calibrate_intrinsics(case.observations, model="brown")
    except InputError as error:
        raise RefusedError(str(error)) from error
    T = {v.id: v.T_camera_target for v in result.views}
    poses = [T[v.id] for v in case.views]
    if any(p is None for p in poses):
        raise RefusedError(f"{sum(p is None for p in poses)} of {len(poses)} views were left out as not fitting")
    return ClassicalCalibration(result.camera, np.stack([p for p in poses if p is not None]))
