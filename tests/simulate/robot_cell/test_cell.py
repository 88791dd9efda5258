"""The cell as a whole: what a seed decides, things, cameras, the belt, what is recorded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.simulate.robot_cell.cells import needs_opengl

from calibrant.errors import DeviceError, InputError
from calibrant.geometry import se3

from calibrant.simulate.robot_cell import (  # isort: skip
    Conveyor,
    RobotCell,
    RobotCellSpec,
    cube,
    cuboid,
    make_robot_cell,
    sheet,
)
from calibrant.simulate.robot_cell.parts.spec import FRONT, LARGE_BOARD, MARKER, TOP, WRIST  # isort: skip

SMALL = RobotCellSpec(objects=(cube("red cube", "red"), sheet("marker", MARKER)))


def _state(cell: RobotCell) -> list[np.ndarray]:
    truth = cell.truth
    return [
        truth.T_base_camera("front"),
        truth.T_gripper_camera("wrist"),
        truth.camera("top").values,
        truth.T_base_object("red cube"),
        truth.chain.state,
    ]


def test_a_seed_decides_everything() -> None:
    with make_robot_cell(4, spec=SMALL) as one, make_robot_cell(4, spec=SMALL) as same:
        for a, b in zip(_state(one), _state(same)):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(one.camera("top").take().colour, same.camera("top").take().colour)
    with make_robot_cell(5, spec=SMALL) as other:
        assert all(np.abs(a - b).max() > 1e-6 for a, b in zip(_state(one), _state(other)))


def test_cells_of_one_seed_differ_only_in_what_their_specs_differ() -> None:
    blurred = tuple(replace(c, noise=replace(c.noise, blur_px=2.0)) for c in SMALL.cameras)
    with make_robot_cell(4, spec=SMALL) as one, make_robot_cell(4, spec=replace(SMALL, cameras=blurred)) as paired:
        for a, b in zip(_state(one), _state(paired)):
            np.testing.assert_array_equal(a, b)


def test_things_are_placed_moved_and_taken_away() -> None:
    with make_robot_cell(0, spec=SMALL) as cell:
        T = cell.lay("red cube", 0.5, 0.1, yaw=0.3)
        cell.wait(0.2)
        # It sinks by some hundredths of a millimetre into its contact with the table.
        assert np.abs(se3.local(T, cell.truth.T_base_object("red cube"))).max() < 3e-4
        marker = cell.lay("marker", 0.4, -0.1)
        assert marker[2, 2] == pytest.approx(-1.0)  # face up: a target's z goes into the sheet
        np.testing.assert_allclose(cell.truth.T_base_object("marker"), marker, atol=1e-12)
        cell.remove("marker")
        assert not cell.present("marker")
        with pytest.raises(InputError, match="'marker' is not in the cell now"):
            cell.truth.T_base_object("marker")
        with pytest.raises(InputError, match="nothing called 'green cube'"):
            cell.place("green cube", np.eye(4))


def test_a_camera_that_is_knocked_is_elsewhere() -> None:
    with make_robot_cell(0, spec=SMALL) as cell:
        before = cell.truth.T_base_camera("front")
        xi = np.array([0.0, 0.002, 0.0, 0.001, 0.0, 0.0])
        cell.push("front", xi)
        np.testing.assert_allclose(se3.local(before, cell.truth.T_base_camera("front")), xi, atol=1e-12)
        carried = cell.truth.T_base_gripper() @ cell.truth.T_gripper_camera("wrist")
        np.testing.assert_allclose(cell.truth.T_base_camera("wrist"), carried)
        with pytest.raises(InputError, match="no camera 'side'"):
            cell.push("side", xi)


def test_the_belt_carries_what_lies_on_it_at_its_speed() -> None:
    spec = RobotCellSpec(objects=(cube("red cube", "red"), cuboid()), cameras=(), conveyor=Conveyor(speed_m_s=0.15))
    with make_robot_cell(0, spec=spec) as cell:
        belt = spec.conveyor
        assert belt is not None
        cell.lay("cuboid", belt.x_m, -0.3, yaw=0.7, z=belt.height_m)
        cell.wait(0.3)
        start = cell.truth.T_base_object("cuboid")
        beside = cell.truth.T_base_object("red cube")
        cell.wait(3.0)  # long enough for the belt to be set back
        moved = se3.inverse(start) @ cell.truth.T_base_object("cuboid")
        np.testing.assert_allclose(start[:3, :3] @ moved[:3, 3], [0, 0.45, 0], atol=2e-3)
        assert np.abs(se3.log(moved)[:3]).max() < 0.01
        np.testing.assert_allclose(cell.truth.T_base_object("red cube"), beside, atol=1e-4)
    with make_robot_cell(0, spec=replace(SMALL, cameras=())) as still, pytest.raises(InputError, match="no conveyor"):
        still.run_conveyor(0.1)


def test_pictures_come_late_and_show_when_they_were_taken() -> None:
    with make_robot_cell(0, spec=SMALL) as cell:
        cell.robot.drive(np.array([0, 0, 0, 0, 0.05, 0]), seconds=0.5)
        before = cell.time_s
        picture = cell.camera("front").take()
        assert picture.time_s == pytest.approx(before)
        assert 0.045 <= cell.time_s - before <= 0.056  # the arm drove on while the picture came
        assert picture.size == (640, 480)
        cell.camera("front").close()
        with pytest.raises(DeviceError, match="front gives no picture"):
            cell.camera("front").take()


@needs_opengl()
def test_depth_is_noisy_as_published_and_has_holes() -> None:
    spec = RobotCellSpec(objects=(cube("red cube", "red"),), cameras=(TOP,))
    with make_robot_cell(0, spec=spec) as cell:
        cell.robot.move_joints(np.where(np.arange(7) == 0, 2.5, cell.robot.home))  # out of the picture
        cell.lay("red cube", 0.5, 0.0)
        camera = cell.truth.depth_camera("top")
        T = cell.truth.T_base_camera("top") @ cell.truth.T_colour_depth("top")
        rays = camera.unproject(np.stack(np.meshgrid(np.arange(640), np.arange(480)), axis=-1))
        rays = rays / rays[..., 2:] @ T[:3, :3].T
        table = -T[2, 3] / rays[..., 2]
        pictures = np.array([cell.camera("top").take().depth for _ in range(8)])
        middle = np.s_[:, 60:120, 280:360]  # table, nothing on it
        off = (pictures - table)[middle]
        # An offset of the device's disparity is an offset of depth; the rest scatters by z^2 / (f b) 0.08 px.
        z = float(table[60:120, 280:360].mean())
        noise = TOP.depth_noise
        expected = np.hypot(noise.sigma_m(z, 386.0), 0.001 / np.sqrt(12))
        assert np.nanstd(off) == pytest.approx(expected, rel=0.15)
        bias = -cell.truth.depth_offset_px("top") * z**2 / (386.0 * noise.baseline_m)
        assert np.nanmean(off) == pytest.approx(bias, abs=0.0006)
        assert 0.0005 < np.isnan(off).mean() < 0.006
        top = cell.truth.T_base_object("red cube")
        on_cube = np.hypot(*(T[:3, 3] + table[..., None] * rays - top[:3, 3])[..., :2].transpose(2, 0, 1)) < 0.03
        # Rims are lost: a good part of a small cube.
        assert 0.15 < np.isnan(pictures[:, on_cube]).mean() < 0.8


def test_a_slanted_plane_is_no_step_of_depth() -> None:
    spec = RobotCellSpec(objects=(), cameras=(FRONT,))
    with make_robot_cell(0, spec=spec) as cell:
        depth = cell.camera("front").take().depth
    assert depth is not None
    # The table before the arm, seen at 30 degrees: single pixels are missing, nothing else.
    assert np.isnan(depth[330:400, 150:500]).mean() < 0.006


def test_without_opengl_rays_draw_the_same_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    small = replace(FRONT, name="front")
    spec = RobotCellSpec(objects=SMALL.objects, cameras=(small,)).without_noise()
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    with make_robot_cell(0, spec=spec) as cell:
        assert "casting rays, slowly: no OpenGL (MUJOCO_GL=disabled)" in cell.drawn_by
        rays = cell.camera("front").take()
    monkeypatch.delenv("MUJOCO_GL")
    with make_robot_cell(0, spec=spec) as cell:
        if cell.drawn_by.startswith("pictures are drawn by casting"):
            pytest.skip(f"no OpenGL here to compare with: {cell.drawn_by}")
        drawn = cell.camera("front").take()
    assert rays.depth is not None
    assert drawn.depth is not None
    # Rims differ: a pixel's ray meets one of two things.
    assert np.quantile(np.abs(rays.depth - drawn.depth), 0.99) < 1e-3
    assert np.quantile(np.abs(rays.colour.astype(int) - drawn.colour), 0.95) <= 2


def test_a_tool_moves_the_tip() -> None:
    with make_robot_cell(0, spec=replace(SMALL, cameras=(), tool="pen")) as cell:
        assert cell.truth.T_gripper_tip[2, 3] == pytest.approx(0.170)
        cell.carry(None)
        assert cell.truth.T_gripper_tip[2, 3] == pytest.approx(0.112)
        with pytest.raises(InputError, match="unknown tool 'hammer'"):
            cell.carry("hammer")  # type: ignore[arg-type]


def test_a_spec_says_what_is_wrong_with_it() -> None:
    with pytest.raises(InputError, match="two things of the cell are called front"):
        RobotCellSpec(objects=(cube("front", "red"),))
    with pytest.raises(InputError, match="unknown colour 'pink'"):
        cube("a", "pink")
    with pytest.raises(InputError, match="no arm and no file called kuka"):
        make_robot_cell(0, spec=RobotCellSpec(arm="kuka"))
    many = tuple(sheet(f"board {k}", LARGE_BOARD) for k in range(9))
    with pytest.raises(InputError, match="no room on the table for board"):
        make_robot_cell(0, spec=RobotCellSpec(objects=many, cameras=()))


@needs_opengl()
def test_a_run_is_recorded(tmp_path: Path) -> None:
    with make_robot_cell(0, spec=replace(SMALL, cameras=(WRIST,)), record=tmp_path) as cell:
        cell.camera("wrist").take()
        cell.robot.drive(np.array([0, 0, 0, 0, 0.2, 0]), seconds=0.35)
    kept = sorted(p.name for p in tmp_path.iterdir())
    assert kept == ["film.gif", "film.mp4", "wrist_0000.png", "wrist_0000_depth.png"]
    from PIL import Image

    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames >= 3  # type: ignore[attr-defined]
        assert film.size == (240, 180)
