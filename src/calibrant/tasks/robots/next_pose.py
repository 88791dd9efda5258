"""What `calibrant next-pose` does: read what is known, draw candidates, plan, and say it."""

from __future__ import annotations

import json as json_format
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calibrant.cli import session
from calibrant.cli.options import pixels
from calibrant.errors import InputError
from calibrant.tasks.inputs.placement import parse_angle, parse_noise, parse_placement, parse_range

if TYPE_CHECKING:
    from calibrant.diagnose.next_pose.plan import Goal, Knowledge, Plan
    from calibrant.robots.geometry import ParametricChain

Array = NDArray[np.float64]

DEFAULT_COUNT = 10
GOALS = ("point", "camera")
UNDETERMINED_MM = 100.0
"""What is known to no better than this was not determined: before the first views nothing is known to 1 m."""


@dataclass(frozen=True)
class Request:
    """The command's arguments, as given."""

    robot: str
    link: str | None = None
    base: str | None = None
    result: Path | None = None
    camera: Path | None = None
    target: str | None = None
    setup: str = "eye-in-hand"
    camera_at: str | None = None
    target_at: str | None = None
    count: int | None = None
    wanted: str = "point"
    at: str | None = None
    workspace: str | None = None
    distance: str = "300mm:800mm"
    tilt: str = "40deg"
    in_view: str = "100%"
    geometry: Path | None = None
    sigma_px: str = "0.2px"
    sigma_robot: str = "0.1mm,0.02deg"
    seed: int = 0
    out: Path | None = None
    json: bool = False
    quiet: bool = False
    force: bool = False


def run(request: Request) -> None:
    """Plan, write and print. Raises: InputError, RefusedError as the parts do."""
    from calibrant.diagnose.budget.volume import parse_share
    from calibrant.diagnose.next_pose.candidates import Wishes, candidates
    from calibrant.diagnose.next_pose.obstacles import read_geometry
    from calibrant.diagnose.next_pose.plan import plan_views
    from calibrant.formats.robots.read import read_robot

    if request.wanted not in GOALS:
        raise InputError(f"--wanted {request.wanted}: choose {' or '.join(GOALS)}")
    if request.out is not None:
        session.check_writable(request.out, force=request.force)
    wishes = Wishes(
        parse_range(request.distance, what="--distance"),
        float(np.rad2deg(parse_angle(request.tilt, what="--tilt"))),
        in_view=parse_share(request.in_view, what="--in-view"),
    )
    chain = read_robot(request.robot, link=request.link, base=request.base).chain
    obstacles = None if request.geometry is None else read_geometry(request.geometry)
    known, spec = _knowledge(request)
    points = _points(request, spec)
    goal = _goal(request, known, wishes.distance)
    session.load_solver(quiet=request.quiet or request.json)
    with session.status("Planning …", quiet=request.quiet or request.json):
        pool = candidates(
            chain, known.camera, points, setup=known.setup, X=known.X, Z=known.Z,
            rng=np.random.default_rng(request.seed), wishes=wishes, geometry=obstacles,
        )  # fmt: skip
        count = request.count or (1 if request.result is not None else DEFAULT_COUNT)
        plan = plan_views(known, goal, points, pool, count)
    _say(request, plan, chain, wishes.distance)


def _knowledge(request: Request) -> tuple[Knowledge, str | None]:
    """What is known, and the target that the result was made with."""
    from calibrant.calibrate.solvers.setup import get_setup
    from calibrant.diagnose.budget.single import NoiseLevels
    from calibrant.diagnose.next_pose.plan import known_from, nothing_known

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


def _say(request: Request, plan: Plan, chain: ParametricChain, distance: tuple[float, float]) -> None:
    rows = plan_rows(plan, [j.name for j in chain.joints])
    if request.out is not None:
        header = ",".join(rows[0])
        lines = [",".join(v if isinstance(v, str) else f"{v:.9g}" for v in row.values()) for row in rows]
        session.write_bytes(request.out, ("\n".join([header, *lines]) + "\n").encode())
    if request.json:
        before = {"sigma_mm": plan.before.sigma_mm, "radius_95_mm": plan.before.radius_mm}
        sys.stdout.write(json_format.dumps({"before": before, "poses": rows}, indent=2) + "\n")
    elif not request.quiet:
        _print(request, plan, chain, _asked(request, distance))


def _asked(request: Request, distance: tuple[float, float]) -> str:
    """What the figures are of, in words."""
    if request.workspace is not None:
        return "A point of the workspace that the camera sees"
    if request.wanted == "camera":
        return "The camera's position"
    return f"A point {1e3 * _depth(request, distance):.0f} mm in front of the camera"


def plan_rows(plan: Plan, joints: list[str]) -> list[dict[str, Any]]:
    """The plan as rows: name, T_base_gripper (metres, quaternion), joint values (radians or metres), sigma after it."""
    from calibrant.geometry import so3

    rows = []
    for i, (T, q, left) in enumerate(zip(plan.chosen.T_base_gripper, plan.chosen.q, plan.after)):
        w, x, y, z = so3.quaternion_wxyz(T[:3, :3])
        place = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), (float(v) for v in (*T[:3, 3], x, y, z, w))))
        values = {name: float(v) for name, v in zip(joints, q)}
        rows.append({"image": f"{i:02d}.png", **place, **values, "sigma_mm": left.sigma_mm})
    return rows


def _print(request: Request, plan: Plan, chain: ParametricChain, what: str) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    units = ["deg" if j.kind == "revolute" else "mm" for j in chain.joints]
    scales = [float(np.rad2deg(1)) if u == "deg" else 1e3 for u in units]
    table.add_column("pose", justify="right")
    for i, unit in enumerate(units, start=1):
        table.add_column(f"q{i} {unit}", justify="right", no_wrap=True)
    table.add_column("1σ after", justify="right", no_wrap=True)
    table.add_column("95 % below", justify="right", no_wrap=True)
    for i, (q, left) in enumerate(zip(plan.chosen.q, plan.after)):
        angles = [f"{v * s:.0f}" if abs(v * s) >= 100 else f"{v * s:.1f}" for v, s in zip(q, scales)]
        table.add_row(str(i + 1), *angles, f"{_figure(left.sigma_mm)} mm", f"{_figure(left.radius_mm)} mm")
    now = _figure(plan.before.sigma_mm)
    console = Console()
    state = "nothing is known yet." if now == "–" else f"known to {now} mm (1σ, worst direction)."
    console.print(f"{what}: {state}")
    console.print(table)
    if request.geometry is None:
        console.print("Only joint limits and view are checked; say what the arm must not hit with --geometry FILE.")
    if request.out is not None:
        console.print(f"{request.out}: poses (T_base_gripper, metres) and joint values (radians, metres).")


def _figure(mm: float) -> str:
    """A figure in millimetres, or a dash where the poses so far do not determine it."""
    return "–" if mm > UNDETERMINED_MM else f"{mm:.3g}"
