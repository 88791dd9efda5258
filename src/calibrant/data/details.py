"""What a calibration found that is no single figure: one frozen record a thing, kept under `details` in the file.

A record holds text, numbers, truth values, None, and tuples, mappings and records of these; `typed_json` writes and
reads it by its annotations, so that a new one needs nothing but its class and its line in `DETAILS`. Results are asked
for a record by its class: `result.detail(JointAxes)` is one, or None where the result has none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from calibrant.data.details_comparison import Comparison as Comparison
from calibrant.data.details_rig import CameraClock as CameraClock
from calibrant.data.details_rig import CameraClocks as CameraClocks
from calibrant.data.details_rig import SharedMoments as SharedMoments
from calibrant.data.details_scene import LocatedObject as LocatedObject
from calibrant.data.details_scene import ProjectorCaptures
from calibrant.data.details_stereo import EpipolarErrors as EpipolarErrors
from calibrant.data.details_stereo import EpipolarMatrices as EpipolarMatrices
from calibrant.data.details_stereo import PairErrors as PairErrors
from calibrant.data.details_stereo import StereoGeometry as StereoGeometry
from calibrant.data.details_stereo import TriangulatedEdges as TriangulatedEdges
from calibrant.data.records.servoing import ServoTrace, TaughtFeatures
from calibrant.data.records.verification import WatchedPicture as WatchedPicture
from calibrant.data.records.verification import Watching as Watching
from calibrant.data.records.verification_runs import TaskRun as TaskRun
from calibrant.data.records.verification_runs import TaskRuns as TaskRuns

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class RobotParameter:
    """A parameter of a robot's geometry: its correction and 1 sigma in `unit`, or the reason why it was not fitted."""

    name: str
    unit: str
    correction: float
    sigma: float | None = None
    reason: str | None = None
    group: str = ""


@dataclass(frozen=True)
class RobotParameters:
    """Every parameter that was asked for, by robot."""

    robots: Mapping[str, tuple[RobotParameter, ...]]


@dataclass(frozen=True)
class ArmError:
    """What an arm's own geometry errs by at the flange, rms over where it worked, by a hand-eye's data.

    held_mm: in every sigma; unseen_mm: what it could be beside without contradicting the data, 95 %, or, assumed, what
    arms as delivered err by; camera_mm: what the latter would move the camera by, 1 sigma, its worst axis.
    """

    held_mm: float
    unseen_mm: float
    camera_mm: float
    assumed: bool


@dataclass(frozen=True)
class ArmErrors:
    """By robot; none for one whose accuracy was told."""

    robots: Mapping[str, ArmError]


@dataclass(frozen=True)
class JointAxis:
    """An axis in the measuring frame: its direction, a point on it (metres), 1 sigma of tilt and of shift.

    The sigmas are those of the worse of the two directions across the axis; None where they are not known.
    """

    joint: str
    kind: str
    direction: Triple
    point: Triple
    sigma_direction_deg: float | None = None
    sigma_point_mm: float | None = None


@dataclass(frozen=True)
class JointAxes:
    """The axes of a robot that was found without a nominal one."""

    axes: tuple[JointAxis, ...]


@dataclass(frozen=True)
class ModelCandidate:
    """A camera model that was tried: its free parameters and errors, or the reason why it does not serve."""

    model: str
    free: int
    rms_px: float | None = None
    held_out_px: float | None = None
    bic: float | None = None
    reason: str | None = None


@dataclass(frozen=True)
class ModelChoice:
    """The camera models between which the data chose, simplest first."""

    candidates: tuple[ModelCandidate, ...]


@dataclass(frozen=True)
class BentTarget:
    """A target bent like a dish: its sag across columns and across rows with 1 sigma, its largest, and its twist (how
    far a corner leaves the dish, two of them up and two down), mm."""

    bend_mm: tuple[float, float]
    bend_sigma_mm: tuple[float, float]
    largest_mm: float
    twist_mm: float = 0.0
    twist_sigma_mm: float = 0.0


@dataclass(frozen=True)
class FreeTarget:
    """A target whose every point was estimated: how far they are from where they should be, by the point's id, mm.

    The rms is over all points, across the plane and along it; typical_sigma_mm is 1 sigma of a coordinate.
    """

    points: int
    out_of_plane_rms_mm: float
    in_plane_rms_mm: float
    largest_mm: float
    typical_sigma_mm: float
    deviation_mm: Mapping[str, Triple]


@dataclass(frozen=True)
class ViewMotion:
    """Motion of one view over the readout of its rows: of the target's centre in the image, px, with 1 sigma, and of
    the target in its own frame: a turn (rad) about centre_m and a shift (m), half of them before the middle row."""

    px: tuple[float, float]
    sigma_px: tuple[float, float]
    turn_rad: Triple
    shift_m: Triple
    centre_m: Triple


@dataclass(frozen=True)
class RollingShutter:
    """Views whose `rows` were read in turn while something moved: how far, rms over views, px, with 1 sigma, and
    each view's motion by its id."""

    rows: int
    typical_px: float
    typical_sigma_px: float
    views: Mapping[str, ViewMotion]


@dataclass(frozen=True)
class SharedErrors:
    """How much wider sigma is for errors that points share: `times` in all; by view, board point, place in the image.

    independent_sigma: what each parameter's sigma were if all points erred independently.
    """

    times: float
    by_view: float
    by_point: float
    by_place: float
    independent_sigma: Mapping[str, float]


@dataclass(frozen=True)
class LoopSpread:
    """How far a loop of poses is from closing, rms."""

    mm: float
    deg: float


@dataclass(frozen=True)
class Fault:
    """A finding of the doctor: what it is sure of (0 … 1), the loop with it and without, what it measured, the cure."""

    name: str
    status: str
    message: str
    confidence: float
    loop_before: LoopSpread | None = None
    loop_after: LoopSpread | None = None
    value: float | None = None
    sigma: float | None = None
    views: tuple[str, ...] = ()
    proposal: str = ""


@dataclass(frozen=True)
class Faults:
    """What the doctor found; in the result of repaired data, what was repaired."""

    found: tuple[Fault, ...]


@dataclass(frozen=True)
class ViewDeviation:
    """How far a view's target lies from where the others put it, as the data were given and as they were repaired."""

    id: str
    before_mm: float | None = None
    before_deg: float | None = None
    after_mm: float | None = None
    after_deg: float | None = None


@dataclass(frozen=True)
class Deviations:
    """The loop, view by view, before and after the doctor's repairs."""

    views: tuple[ViewDeviation, ...]


@dataclass(frozen=True)
class TouchedPoint:
    """The point (mm, base frame) that a tool touched, and how far from it each pose put the tip, mm."""

    point_mm: Triple
    off_mm: Mapping[str, float]


@dataclass(frozen=True)
class PictureRegion:
    """The largest rectangle of an undistorted picture whose every pixel has a source, pixels."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True)
class MarkedPoints:
    """Points whose error is above a limit, px, by view: they were used, and the next run may leave them out.

    limits_px: by camera, and "epipolar", where there are several; limit_px is the least of them then.
    """

    limit_px: float
    points: Mapping[str, tuple[int, ...]]
    limits_px: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Expectation:
    """How well something will be known: 1 sigma along its worst direction and the radius of 95 % of the errors, mm."""

    sigma_mm: float
    radius_95_mm: float


@dataclass(frozen=True)
class PlannedPose:
    """A pose to take: T_base_gripper (metres, quaternion), joint values (rad or m), and what is known after it, mm."""

    image: str
    position_m: Triple
    quaternion_xyzw: tuple[float, float, float, float]
    joints: Mapping[str, float]
    sigma_mm: float
    radius_95_mm: float


@dataclass(frozen=True)
class ViewPlan:
    """Which poses to take. asked: what is to be known, in words; before: how well it is known without them; units:
    "rad" or "m" of each joint; obstacles: whether the poses were checked against what the arm must not hit."""

    asked: str
    before: Expectation
    poses: tuple[PlannedPose, ...]
    units: Mapping[str, str]
    obstacles: bool = False


@dataclass(frozen=True)
class PossibleChange:
    """Something that may have changed since a calibration, and how well it explains the photos.

    chance: of as much where nothing changed; fits: chance of photos that differ as much from this explanation; words:
    by how much, with 1 sigma; moved_mm, turned_deg: along and about the camera's axes of then (right, down, forward).
    """

    what: str
    explains: bool
    chance: float
    fits: float
    words: str
    moved_mm: Triple | None = None
    moved_sigma_mm: Triple | None = None
    turned_deg: Triple | None = None
    turned_sigma_deg: Triple | None = None


@dataclass(frozen=True)
class PhotoShift:
    """Where points of a photo should be and where they are, pixels. file: the photo; empty where it has none."""

    id: str
    image_size: tuple[int, int]
    expected_px: tuple[tuple[float, float], ...]
    found_px: tuple[tuple[float, float], ...]
    file: str = ""


@dataclass(frozen=True)
class Changes:
    """What `verify unchanged` found: the answer, what to do, what may have changed, the best first, and the photos."""

    answer: str
    advice: str
    possible: tuple[PossibleChange, ...]
    photos: tuple[PhotoShift, ...]


@dataclass(frozen=True)
class PointedSpot:
    """The spot of a plane that a pointer points at: unit of the plane ("m", or empty for parts of it), covariance (xx,
    xy, yy) of the spot in it, and the pixel of the spot by camera."""

    unit: str
    covariance: Triple
    seen_px: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class RectifiedPair:
    """How a pair was rectified: pinhole or cylinder, the axis of the baseline (x or y), f and both (cx, cy), px, the
    size, the baseline (m) and the turns R_rectified_camera of left and right."""

    projection: str
    axis: str
    focal_px: float
    centres_px: tuple[tuple[float, float], tuple[float, float]]
    image_size: tuple[int, int]
    baseline_m: float
    R_rectified_camera: tuple[tuple[Triple, Triple, Triple], tuple[Triple, Triple, Triple]]


@dataclass(frozen=True)
class ReferencePicture:
    """A small grey copy of a photo, by which later ones tell whether the camera was pushed.

    image_size: (width, height) of the photo; jpeg: the copy, base64.
    """

    name: str
    image_size: tuple[int, int]
    jpeg: str


DETAILS: Mapping[str, type] = {
    "robot_parameters": RobotParameters,
    "arm_errors": ArmErrors,
    "joint_axes": JointAxes,
    "model_choice": ModelChoice,
    "bent_target": BentTarget,
    "free_target": FreeTarget,
    "rolling_shutter": RollingShutter,
    "camera_clocks": CameraClocks,
    "shared_moments": SharedMoments,
    "shared_errors": SharedErrors,
    "faults": Faults,
    "deviations": Deviations,
    "touched_point": TouchedPoint,
    "valid_region": PictureRegion,
    "plan": ViewPlan,
    "marked_points": MarkedPoints,
    "changes": Changes,
    "reference": ReferencePicture,
    "pointed_spot": PointedSpot,
    "stereo": StereoGeometry,
    "epipolar": EpipolarErrors,
    "edges": TriangulatedEdges,
    "rectified_pair": RectifiedPair,
    "epipolar_matrices": EpipolarMatrices,
    "projector_captures": ProjectorCaptures,
    "comparison": Comparison,
    "taught_features": TaughtFeatures,
    "servo_trace": ServoTrace,
    "located_object": LocatedObject,
    "watching": Watching,
    "task_runs": TaskRuns,
}
"""The key of each record in a result file."""
