"""The result of a calibration: what was found, how certain it is, what was checked, and the data it came from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from math import nan
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.cell_layout import CellLayout
from calibrant.data.cell_layout import SigmaRobot as SigmaRobot
from calibrant.data.observations import Observations
from calibrant.data.poses import RobotPoses
from calibrant.errors import InputError

Status = Literal["ok", "warn", "fail"]
Verdict = Literal["ok", "warn", "refused"]
D = TypeVar("D")


@dataclass(frozen=True)
class Check:
    """One question asked of the data or the result, and its answer in words. `value` is the figure behind it.

    >>> import calibrant as cb
    >>> cb.Check("convergence", "ok", "converged in 9 steps", 9.0).status
    'ok'
    """

    name: str
    status: Status
    message: str
    value: float | None = None


@dataclass(frozen=True)
class ViewResult:
    """What one view contributed. rms_px is per point over both axes, min_px and max_px are the smallest and the largest
    error of a point that was used; reason says why it was left out, or flagged."""

    id: str
    used: bool
    points: int
    rms_px: float | None = None
    reason: str | None = None
    camera: str | None = None
    points_left_out: int = 0
    T_camera_target: Array | None = None
    min_px: float | None = None
    max_px: float | None = None

    def __repr__(self) -> str:
        rms = "" if self.rms_px is None else f", {self.rms_px:.3f} px"
        words = "" if self.reason is None else f", {self.reason}"
        return f"ViewResult({self.id!r}, {'used' if self.used else 'left out'}, {self.points} points{rms}{words})"


@dataclass(frozen=True, eq=False)
class TransformEstimate:
    """T_parent_child (4, 4), metres, with the covariance (6, 6) of (rotation, translation) along the parent's axes.

    The covariance belongs to `se3.retract`: radians and metres.
    """

    parent: str
    child: str
    matrix: Array
    covariance: Array | None = None

    @property
    def sigma_translation_mm(self) -> Array | None:
        """1 sigma of the child's origin along the parent's x, y, z, millimetres."""
        return None if self.covariance is None else 1e3 * np.sqrt(np.diag(self.covariance)[3:])

    @property
    def sigma_rotation_deg(self) -> Array | None:
        """1 sigma of the rotation about the parent's x, y, z, degrees."""
        return None if self.covariance is None else np.rad2deg(np.sqrt(np.diag(self.covariance)[:3]))

    def __repr__(self) -> str:
        place = ", ".join(f"{1e3 * v:.3f}" for v in self.matrix[:3, 3])
        sigma = self.sigma_translation_mm
        known = "" if sigma is None else f", ± {sigma.max():.2g} mm (1σ, worst axis)"
        return f"TransformEstimate({self.parent} → {self.child}: [{place}] mm{known})"


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance (6 k, 6 k) of k transforms together; frames: (parent, child) of each, in the order of the blocks.

    Each transform's six components are those of `TransformEstimate`: what the errors of two cameras have in common
    stands off the diagonal. Where several cameras were found together, the parameters of all lenses belong to it:
    cameras, their names; across (6 k, p), transforms by all cameras' parameters in that order; lenses (p, p).
    """

    frames: tuple[tuple[str, str], ...]
    matrix: Array
    cameras: tuple[str, ...] = ()
    across: Array | None = None
    lenses: Array | None = None

    def __post_init__(self) -> None:
        size = 6 * len(self.frames)
        if np.shape(self.matrix) != (size, size):
            raise InputError(
                f"{len(self.frames)} transforms need a ({size}, {size}) matrix, got {np.shape(self.matrix)}"
            )
        count = 0 if self.lenses is None else len(self.lenses)
        sizes = {n: None if v is None else np.shape(v) for n, v in (("across", self.across), ("lenses", self.lenses))}
        if sizes != ({"across": (size, count), "lenses": (count, count)} if self.cameras else dict.fromkeys(sizes)):
            raise InputError(f"the lenses of {len(self.cameras)} cameras need across and lenses, got {sizes}")

    @property
    def whole(self) -> Array:
        """(6 k + p, 6 k + p): the transforms, then the parameters of the cameras."""
        if self.across is None or self.lenses is None:
            return self.matrix
        return np.block([[self.matrix, self.across], [self.across.T, self.lenses]])

    def __repr__(self) -> str:
        return f"JointCovariance({', '.join(f'{parent} → {child}' for parent, child in self.frames)})"


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What one hand-eye method gave: the camera's transform and the spread of the loop that should be constant.

    loop_rms_mm / loop_rms_deg are None, and `message` says why, when the method could not answer.
    """

    matrix: Array | None
    loop_rms_mm: float | None
    loop_rms_deg: float | None
    message: str = ""

    def __repr__(self) -> str:
        if self.loop_rms_mm is None or self.loop_rms_deg is None:
            return f"MethodResult({self.message or 'no answer'})"
        return f"MethodResult(loop {self.loop_rms_mm:.3g} mm, {self.loop_rms_deg:.3g} deg rms)"


@dataclass(frozen=True)
class Measured:
    """A number with its 1 sigma, NaN where that is not known (absent in the file), and its unit, empty for a ratio."""

    value: float
    sigma: float = nan
    unit: str = ""


@dataclass(frozen=True)
class HeldOut:
    """Errors on data that were kept out of the fit, RMS; None where it does not apply."""

    mm: float | None = None
    deg: float | None = None
    px: float | None = None


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A calibration, complete: any diagnosis can be made later from it alone.

    rms_px is per point over both axes, as OpenCV's; sigma_px is the noise per axis, estimated from the residuals.
    `print(result)` says the answer in ten lines, `summary()` all that the command line shows; a notebook shows a page.

        >>> from calibrant.data import CalibrationResult, Measured
        >>> found = CalibrationResult("time-offset", "ok", figures={"offset": Measured(0.0801, 0.0002, "s")})
        >>> found.figures["offset"].value
        0.0801
        >>> found
        CalibrationResult('time-offset', 'ok', 1 figure)
    """

    kind: str
    verdict: Verdict
    checks: tuple[Check, ...] = ()
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    transforms: tuple[TransformEstimate, ...] = ()
    joint_covariance: JointCovariance | None = None
    """Of the transforms that were found in one problem, where there are more than a camera's and a target's."""
    rms_px: float | None = None
    sigma_px: float | None = None
    sigma_robot: SigmaRobot | None = None
    views: tuple[ViewResult, ...] = ()
    methods: Mapping[str, MethodResult] = field(default_factory=dict)
    target_scale: Measured | None = None
    held_out: HeldOut | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    """What was asked, and nothing that was found."""
    figures: Mapping[str, Measured] = field(default_factory=dict)
    """Single numbers that were found, beside those that have a field of their own."""
    decided: Mapping[str, str] = field(default_factory=dict)
    """What was chosen where the request left it open, in words: how the poses were read, where the camera is from."""
    cell: CellLayout | None = None
    """Who stands where, where there are several cameras, robots or lists of pictures."""
    details: tuple[Any, ...] = ()
    """Records of `calibrant.data.details`, at most one of a class; `detail` gives one by its class."""
    inputs: tuple[Mapping[str, str], ...] = ()
    observations: Observations | None = None
    robot_poses: RobotPoses | None = None
    T_camera_target: Array | None = None
    """Target poses (n, 4, 4) that were given in place of observations, one a robot pose."""
    notes: tuple[str, ...] = ()
    """What readers said on the way: keys and columns of the inputs that were not used."""
    created: str = ""
    version: str = ""

    @property
    def camera(self) -> Camera:
        """The only camera. Raises: InputError when there are several, or none."""
        if len(self.cameras) != 1:
            raise InputError(
                f"the result has {len(self.cameras)} cameras ({', '.join(self.cameras)}); name one: .cameras[…]"
            )
        return next(iter(self.cameras.values()))

    def camera_of(self, view: ViewResult) -> str:
        """Name of the camera of a view: as it says, else the only one there is, else empty."""
        if view.camera is not None:
            return view.camera
        names = self.observations.image_sizes if self.observations is not None else self.cameras
        return next(iter(names)) if len(names) == 1 else ""

    @property
    def is_about_cameras(self) -> bool:
        """Whether the images were taken to find a camera: then their coverage is judged. What places something is
        about that, and often with a camera that was given."""
        return bool(self.cameras) and not self.transforms

    def transform(self, parent: str, child: str) -> TransformEstimate:
        """The estimate of T_parent_child. Raises: InputError listing what there is."""
        for t in self.transforms:
            if (t.parent, t.child) == (parent, child):
                return t
        known = ", ".join(f"{t.parent} -> {t.child}" for t in self.transforms) or "none"
        raise InputError(f"the result has no transform {parent} -> {child}; it has: {known}")

    def check(self, name: str) -> Check:
        """The check of that name. Raises: InputError listing the names there are."""
        for c in self.checks:
            if c.name == name:
                return c
        raise InputError(f"the result has no check {name!r}; it has: {', '.join(c.name for c in self.checks)}")

    def detail(self, kind: type[D]) -> D | None:
        """The record of that class, None where the result has none: `result.detail(JointAxes)`."""
        return next((d for d in self.details if isinstance(d, kind)), None)

    def with_detail(self, record: object) -> CalibrationResult:
        """The result with the record in place of the one of its class."""
        others = tuple(d for d in self.details if type(d) is not type(record))
        return replace(self, details=(*others, record))

    def __repr__(self) -> str:
        counts = (
            (len(self.cameras), "camera"),
            (len(self.transforms), "transform"),
            (len(self.figures), "figure"),
            (len(self.views), "view"),
            (len(self.checks), "check"),
        )
        parts = [f"{n} {noun}{'s' * (n > 1)}" for n, noun in counts if n]
        return f"CalibrationResult({', '.join([repr(self.kind), repr(self.verdict), *parts])})"

    def __str__(self) -> str:
        """The answer in some ten lines: what it is, the verdict, the figures that count, the checks that warn."""
        return spoken("brief")(self)

    def summary(self) -> str:
        """What the command line shows after a calibration, as plain text of 80 columns."""
        return spoken("summary")(self)

    def _repr_html_(self) -> str:
        """The answer for a notebook."""
        return spoken("notebook")(self)

    def write(self, path: str | Path, *, force: bool = True) -> Path:
        """Write the result file (JSON, format calibrant/2), whole or not at all.

        Raises: InputError when the path cannot be written, or exists and `force` is False.
        """
        from calibrant.data.result_file import write_result

        return write_result(self, Path(path), force=force)


def spoken(form: str) -> Callable[[CalibrationResult], str]:
    """How a result is told: "brief", "summary" or "notebook", by `calibrant.reports.speech`.

    It is the one import of the house that runs up: a result speaks for itself, and only then is the report loaded.
    """
    speech: Callable[[CalibrationResult], str] = getattr(import_module("calibrant.reports.speech"), form)
    return speech


def verdict_of(checks: tuple[Check, ...]) -> Verdict:
    """The verdict that checks lead to: any fail refuses, any warning warns."""
    statuses = {c.status for c in checks}
    return "refused" if "fail" in statuses else "warn" if "warn" in statuses else "ok"


def as_transform(parent: str, child: str, matrix: ArrayLike, covariance: ArrayLike | None = None) -> TransformEstimate:
    """TransformEstimate from array-likes."""
    cov = None if covariance is None else np.asarray(covariance, dtype=np.float64)
    return TransformEstimate(parent, child, np.asarray(matrix, dtype=np.float64), cov)
