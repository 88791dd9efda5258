"""Plan the poses to take next, or from the start: read what is known, draw candidates, choose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.choices import SETUPS
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome, result_document

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.data import CalibrationResult
    from calibrant.data.details import PlannedPose, ViewPlan
    from calibrant.diagnose.next_pose.candidates import Wishes
    from calibrant.diagnose.next_pose.plan import Goal, Knowledge, Plan
    from calibrant.robots.geometry import ParametricChain

    Array = NDArray[np.float64]

EXAMPLE = 'cb.next_pose(robot="ur5e", result="hand-eye.json", count=3)'
DEFAULT_COUNT = 10
GOALS = ("point", "camera")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Say which poses to take so that the camera is known best with the fewest.

    calibrant next-pose --robot ur5e --result hand-eye.json

    calibrant next-pose --robot ur5e --camera camera.json --target chessboard:9x6:25mm \\
        --camera-at 20mm,-60mm,50mm,0deg,0deg,23deg --target-at 620mm,110mm,20mm,180deg,0deg,0deg \\
        --count 8 --out plan.csv

    Every pose is within the joint limits, has the target in view and in focus, and hits nothing that --geometry names.
    Each comes with the uncertainty that is left after it. The flange is the gripper.
    """

    robot: Annotated[str, Option("FILE")]
    """The robot with its joint limits: URDF, DH table (YAML), or a name such as ur5e."""
    result: Annotated[Path | None, Option("FILE")] = None
    """What was calibrated so far (hand-eye --out FILE); without it the plan starts from nothing."""
    camera: Annotated[Path | None, Option("FILE")] = None
    """Known camera, where there is no result."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""
    setup: Annotated[str, Option("SETUP", choices=SETUPS[1:])] = "eye-in-hand"
    """eye-in-hand or eye-to-hand."""
    camera_at: Annotated[str | None, Option("PLACE")] = None
    """Roughly where the camera is: x, y, z, roll, pitch, yaw in the gripper (eye-in-hand) or the base."""
    target_at: Annotated[str | None, Option("PLACE")] = None
    """Roughly where the target is: in the base (eye-in-hand) or in the gripper (eye-to-hand)."""
    count: Annotated[int | None, Option("N", "-n")] = None
    """Poses: 1 after a result, else 10."""
    wanted: Annotated[str, Option("WHAT")] = "point"
    """What is to be known well: point (seen) or camera."""
    at: Annotated[str | None, Option("LENGTH")] = None
    """Distance from the camera at which its work lies; the middle of --distance unless given."""
    workspace: Annotated[str | None, Option("VOLUME")] = None
    """For a camera that stands still: where its work lies, 300mm:700mm,-200mm:200mm,0mm:100mm."""
    distance: Annotated[str, Option("FROM:TO")] = "300mm:800mm"
    """Distances at which the target is in focus."""
    tilt: Annotated[str, Option("ANGLE")] = "40deg"
    """Largest tilt of the target."""
    in_view: Annotated[str, Option("PERCENT")] = "100%"
    """Share of the target that must be in the image."""
    geometry: Annotated[Path | None, Option("FILE")] = None
    """What the arm must not hit (YAML: link_radius, floor, boxes, spheres)."""
    sigma_px: Annotated[str, Option("LENGTH")] = "0.2px"
    """Noise of a corner, where there is no result."""
    sigma_robot: Annotated[str, Option("NOISE")] = "0.1mm,0.02deg"
    """Noise of its poses, where there is no result."""
    seed: Annotated[int, Option("N")] = 0
    """Of the candidates that are drawn."""
    robot_link: Annotated[str | None, Option("NAME")] = None
    """URDF: the link that ends the chain."""
    robot_base: Annotated[str | None, Option("NAME")] = None
    """URDF: the link that starts the chain."""
    out: Annotated[Path | None, Option("FILE.csv", "-o", output="file")] = None
    """Write poses (T_base_gripper, metres) and joint values (radians, metres) here; a name in .json: the result."""


def reads(request: Request) -> list[str | Path]:
    """The robot's file, what is known, and what the arm must not hit."""
    robot = [request.robot] if Path(request.robot).exists() else []
    return [*robot, *(f for f in (request.result, request.camera, request.geometry) if f is not None)]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The plan, with the uncertainty left after each pose.

    Raises: InputError; RefusedError where the arm can take too few views.
    """
    import numpy as np

    from calibrant.diagnose.next_pose.candidates import candidates
    from calibrant.diagnose.next_pose.obstacles import read_geometry
    from calibrant.diagnose.next_pose.plan import plan_views
    from calibrant.formats.robots.read import read_robot

    wishes = _wishes(request)
    chain = read_robot(request.robot, link=request.robot_link, base=request.robot_base).chain
    obstacles = None if request.geometry is None else read_geometry(request.geometry)
    known, spec = _knowledge(request)
    points = _points(request, spec)
    goal = _goal(request, known, wishes.distance)
    session.load_solver(listener)
    with listener.status("Planning …"):
        pool = candidates(
            chain, known.camera, points, setup=known.setup, X=known.X, Z=known.Z,
            rng=np.random.default_rng(request.seed), wishes=wishes, geometry=obstacles,
        )  # fmt: skip
        count = request.count or (1 if request.result is not None else DEFAULT_COUNT)
        found = _view_plan(plan_views(known, goal, points, pool, count), chain, request, wishes.distance)
    result = _plan_result(found, request)
    if request.out is None:
        return Outcome(result=result)
    table = Document(request.out, partial(_plan_csv, found))
    as_result = request.out.suffix.lower() == ".json"
    return Outcome(result=result, documents=(result_document(result, request.out) if as_result else table,))


def _wishes(request: Request) -> Wishes:
    """What a view must be. Raises: InputError for words that say no distance, angle or share."""
    import numpy as np

    from calibrant.diagnose.budget.volume import parse_share
    from calibrant.diagnose.next_pose.candidates import Wishes
    from calibrant.tasks.inputs.placement import parse_angle, parse_range

    if request.wanted not in GOALS:
        raise InputError(f"--wanted {request.wanted}: choose {' or '.join(GOALS)}")
    if request.count is not None and request.count < 1:
        raise InputError(f"--count {request.count}: a plan has at least 1 pose")
    return Wishes(
        parse_range(request.distance, what="--distance"),
        float(np.rad2deg(parse_angle(request.tilt, what="--tilt"))),
        in_view=parse_share(request.in_view, what="--in-view"),
    )


def _knowledge(request: Request) -> tuple[Knowledge, str | None]:
    """What is known, and the target that the result was made with."""
    from calibrant.calibrate.solvers.setup import get_setup
    from calibrant.diagnose.budget.views import NoiseLevels
    from calibrant.diagnose.next_pose.plan import known_from, nothing_known
    from calibrant.tasks.inputs.placement import parse_noise, parse_placement

    if request.result is not None:
        given = {"--camera": request.camera, "--camera-at": request.camera_at, "--target-at": request.target_at}
        twice = [option for option, value in given.items() if value is not None]
        if twice:
            raise InputError(f"{twice[0]} is in the result already; leave it out")
        from calibrant.data.result_file import read_result

        result = read_result(request.result)
        return known_from(result), result.observations.target if result.observations else None
    if request.camera is None or request.camera_at is None or request.target_at is None:
        raise InputError(
            "without --result, say what is known: --camera FILE, and roughly --camera-at and --target-at, such as "
            "20mm,-60mm,50mm,0deg,0deg,23deg (x, y, z, roll, pitch, yaw)"
        )
    from calibrant.formats.cameras.read import read_camera

    metres, radians = parse_noise(request.sigma_robot, what="--sigma-robot")
    noise = NoiseLevels(pixels(request.sigma_px, option="--sigma-px") or 0.0, radians, metres)
    X = parse_placement(request.camera_at, what="--camera-at")
    Z = parse_placement(request.target_at, what="--target-at")
    return nothing_known(get_setup(request.setup), X, Z, read_camera(request.camera), noise), None


def _points(request: Request, spec: str | None) -> Array:
    from calibrant.targets.registry import parse_target

    chosen = request.target or spec
    if chosen is None:
        raise InputError("say which target will be seen: --target, such as chessboard:9x6:25mm")
    return parse_target(chosen).points


def _goal(request: Request, known: Knowledge, distance: tuple[float, float]) -> Goal:
    import numpy as np

    from calibrant.diagnose.budget.volume import parse_volume
    from calibrant.diagnose.next_pose.plan import camera_goal, point_goal, volume_goal

    if request.workspace is not None:
        return volume_goal(known, parse_volume(request.workspace).grid((3, 3, 2)))
    if request.wanted == "camera":
        return camera_goal(known)
    return point_goal(known, np.array([0.0, 0.0, _depth(request, distance)]))


def _depth(request: Request, distance: tuple[float, float]) -> float:
    from calibrant.targets.lengths import parse_length

    return sum(distance) / 2 if request.at is None else parse_length(request.at, what="--at")


def _asked(request: Request, distance: tuple[float, float]) -> str:
    """What the figures are of, in words."""
    if request.workspace is not None:
        return "A point of the workspace that the camera sees"
    if request.wanted == "camera":
        return "The camera's position"
    return f"A point {1e3 * _depth(request, distance):.0f} mm in front of the camera"


def _view_plan(plan: Plan, chain: ParametricChain, request: Request, distance: tuple[float, float]) -> ViewPlan:
    """The plan as a record: T_base_gripper (metres, quaternion), joint values (radians or metres), sigma after each."""
    from calibrant.data.details import Expectation, PlannedPose, ViewPlan
    from calibrant.geometry import so3

    names = [j.name for j in chain.joints]
    poses = []
    for i, (T, q, left) in enumerate(zip(plan.chosen.T_base_gripper, plan.chosen.q, plan.after)):
        w, x, y, z = (float(v) for v in so3.quaternion_wxyz(T[:3, :3]))
        px, py, pz = (float(v) for v in T[:3, 3])
        joints = dict(zip(names, q.tolist()))
        poses.append(PlannedPose(f"{i:02d}.png", (px, py, pz), (x, y, z, w), joints, left.sigma_mm, left.radius_mm))
    units = {j.name: "rad" if j.kind == "revolute" else "m" for j in chain.joints}
    before = Expectation(plan.before.sigma_mm, plan.before.radius_mm)
    return ViewPlan(_asked(request, distance), before, tuple(poses), units, obstacles=request.geometry is not None)


def _plan_csv(plan: ViewPlan) -> bytes:
    """Name, T_base_gripper, joint values and the sigma that is left, a line a pose."""
    rows = [_plan_row(pose) for pose in plan.poses]
    lines = [",".join(v if isinstance(v, str) else f"{v:.9g}" for v in row.values()) for row in rows]
    return ("\n".join([",".join(rows[0]), *lines]) + "\n").encode()


def _plan_row(pose: PlannedPose) -> dict[str, str | float]:
    place = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), (*pose.position_m, *pose.quaternion_xyzw)))
    return {"image": pose.image, **place, **pose.joints, "sigma_mm": pose.sigma_mm}


def _plan_result(plan: ViewPlan, request: Request) -> CalibrationResult:
    from calibrant.data import CalibrationResult, Check, Measured
    from calibrant.data.verdicts import stamp

    after, ways = plan.poses[-1], ("joint limits and view", "joint limits, view and obstacles")
    checks = (
        Check(
            "expected", "ok", f"{plan.asked.lower()} will be known to {after.sigma_mm:.3g} mm (1 sigma, worst "
            f"direction) after {len(plan.poses)} more", after.sigma_mm,
        ),
        Check("reach", "ok", f"every pose was checked for {ways[plan.obstacles]}"),
    )  # fmt: skip
    asked = ("setup", "count", "wanted", "at", "workspace", "distance", "tilt", "in_view", "seed")
    given = {name: getattr(request, name) for name in ("robot", "target", *asked)}
    return stamp(
        CalibrationResult(
            kind="next-pose",
            verdict="ok",
            checks=checks,
            options={name: value for name, value in given.items() if value is not None},
            figures={
                "sigma_before": Measured(plan.before.sigma_mm, unit="mm"),
                "sigma_after": Measured(after.sigma_mm, unit="mm"),
            },
            details=(plan,),
            inputs=session.file_records(reads(request)),
        )
    )
