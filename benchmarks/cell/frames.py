"""Pictures a second of the robot cell beside those of MuJoCo's bare renderer on the same model, taking turns.

The bare loop draws colour, then depth, of the front camera at 640 x 480; the cell's `take` draws colour and depth from
their two lenses, bends them, draws the boards in view and adds the noise. Primitive arm, no shadows, no samples.

    nice -n 10 python benchmarks/cell/frames.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from calibrant.simulate.robot_cell import RobotCell, RobotCellSpec, make_robot_cell
from calibrant.simulate.robot_cell.parts.noise import NO_LATENCY

TURNS, PICTURES = 12, 8


def bare(cell: RobotCell) -> Callable[[], None]:
    """A loop of `mujoco.Renderer` over the cell's model: colour and depth of the front camera."""
    model, data = cell._world.model, cell._world.data
    model.vis.global_.offwidth, model.vis.global_.offheight = 640, 480
    model.vis.global_.fovy = float(np.rad2deg(2 * np.arctan(240 / cell.truth.camera("front").parameters["fy"])))
    colour, depth = mujoco.Renderer(model, 480, 640), mujoco.Renderer(model, 480, 640)
    depth.enable_depth_rendering()
    T = cell.truth.T_base_camera("front")
    eye = mujoco.MjvCamera()
    eye.lookat[:], eye.distance = T[:3, 3] + 1.3 * T[:3, 2], 1.3
    eye.azimuth = np.rad2deg(np.arctan2(T[1, 2], T[0, 2]))
    eye.elevation = np.rad2deg(np.arcsin(T[2, 2]))
    colour.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
    depth.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False

    def draw() -> None:
        for renderer in (colour, depth):
            renderer.update_scene(data, eye)
            renderer.render()

    return draw


def main() -> None:
    spec = RobotCellSpec()
    spec = replace(spec, cameras=tuple(replace(c, latency=NO_LATENCY) for c in spec.cameras))
    with make_robot_cell(0, spec=spec) as cell, make_robot_cell(0, spec=spec.without_noise()) as perfect:
        print(cell.drawn_by)
        front = cell.camera("front")
        loops: dict[str, Callable[[], object]] = {"bare renderer": bare(cell), "the cell": front.take}
        cell_colour = front.take_colour
        loops["the cell, colour alone"] = cell_colour
        loops["the cell without noise"] = perfect.camera("front").take
        seconds: dict[str, list[float]] = {name: [] for name in loops}
        work: dict[str, float] = dict.fromkeys(loops, 0.0)
        for loop in loops.values():
            loop()
        for _ in range(TURNS):
            for name, loop in loops.items():
                start, before = time.perf_counter(), time.process_time()
                for _ in range(PICTURES):
                    loop()
                seconds[name].append((time.perf_counter() - start) / PICTURES)
                work[name] += (time.process_time() - before) / PICTURES / TURNS
        for name, values in seconds.items():
            pace = 1 / np.median(values)
            print(f"{name:25s} {pace:6.1f} pictures a second, {1e3 * work[name]:5.1f} ms of processor each")
        for name in ("the cell", "the cell without noise"):
            ratio = np.median(np.array(seconds["bare renderer"]) / np.array(seconds[name]))
            by_work = work["bare renderer"] / work[name]
            print(
                f"{name}: {ratio:.2f} of the bare renderer (median of {TURNS} turns), by processor time {by_work:.2f}"
            )


if __name__ == "__main__":
    main()
