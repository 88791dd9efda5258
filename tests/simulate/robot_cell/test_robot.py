"""The simulated arm as a Robot: it goes where it is told, says where it thinks it is, and keeps off the table."""

from __future__ import annotations

import numpy as np
import pytest
from tests.simulate.robot_cell import cells  # noqa: F401  skips without MuJoCo

from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm

from calibrant.simulate.robot_cell.arm.arms import named_arm  # isort: skip
from calibrant.simulate.robot_cell.parts.noise import NO_ROBOT_NOISE, RobotNoise  # isort: skip
from calibrant.simulate.robot_cell.world.physics import World  # isort: skip
from calibrant.simulate.robot_cell.arm.robot import SimulatedRobot  # isort: skip
from calibrant.simulate.robot_cell.model import build_world  # isort: skip
from calibrant.simulate.robot_cell.parts.spec import RobotCellSpec, cube  # isort: skip
from calibrant.simulate.robot_cell.world.light import Light  # isort: skip

LIGHT = Light(np.array([0.0, 0.0, -1.0]), 0.5, 0.5)


def robot(
    name: str = "panda", noise: RobotNoise = NO_ROBOT_NOISE, *, seed: int = 0, spec: RobotCellSpec | None = None
) -> tuple[SimulatedRobot, World]:
    rng = np.random.default_rng(seed)
    cell_arm = named_arm(name)
    chosen = spec or RobotCellSpec(objects=())
    world = World(build_world(chosen, cell_arm, cell_arm.true_chain(noise, rng), LIGHT))
    return SimulatedRobot(world, cell_arm, noise, rng), world


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_the_simulated_flange_is_where_the_published_kinematics_have_it(name: str) -> None:
    moved, world = robot(name)
    rng = np.random.default_rng(1)
    rows = world.joint_rows([j.name for j in moved.chain.joints])[0]
    for _ in range(20):
        q = moved.home + rng.uniform(-0.6, 0.6, len(moved.home))
        world.data.qpos[rows] = q
        world.settle()
        np.testing.assert_allclose(world.pose("flange"), arm(name).forward(q), atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_without_noise_it_stands_where_it_was_sent(name: str) -> None:
    moved, world = robot(name)
    goal = moved.pose()
    goal[:3, 3] += [0.06, 0.10, -0.08]
    goal[:3, :3] = goal[:3, :3] @ so3.exp([0.1, -0.2, 0.3])
    moved.move_to(goal)
    # The controller's integral part leaves microradians.
    assert np.abs(se3.local(world.pose("flange"), goal)).max() < 2e-5
    np.testing.assert_allclose(moved.pose(), world.pose("flange"), atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_at_full_speed_it_still_follows(name: str) -> None:
    moved, _ = robot(name)
    rng = np.random.default_rng(2)
    for _ in range(6):  # short ways too, where the limit is acceleration
        goal = moved.home + np.where(np.arange(len(moved.home)) == 0, rng.uniform(-1, 1), 0)
        goal += rng.uniform(-0.35, 0.35, len(moved.home)) * rng.choice([0.1, 1.0])
        moved.move_joints(goal, speed=1.0)
        np.testing.assert_allclose(moved.joints(), goal, atol=2e-5)


def test_a_line_stays_on_the_line() -> None:
    moved, world = robot()
    start, off = moved.pose(), []
    goal = start.copy()
    goal[:3, 3] += [0.15, -0.10, -0.10]
    along = (goal - start)[:3, 3] / np.linalg.norm((goal - start)[:3, 3])

    def watch(_: float) -> None:
        p = world.pose("flange")[:3, 3] - start[:3, 3]
        off.append(np.linalg.norm(p - (p @ along) * along))

    world.at_every_step(watch)
    moved.move_line(goal)
    assert max(off) < 1e-3  # a servo's lag differs from joint to joint
    assert np.abs(se3.local(world.pose("flange"), goal)).max() < 2e-5


def test_a_velocity_moves_the_flange_that_fast_until_it_is_stopped() -> None:
    moved, world = robot()
    start = world.pose("flange")
    moved.drive(np.array([0, 0, 0.2, 0.05, 0, 0]), seconds=1.0)
    moved.drive(np.array([0, 0, 0.2, 0.05, 0, 0]), seconds=0.5)
    after = world.pose("flange")
    # The servos need a fraction of a second to get going.
    np.testing.assert_allclose(after[:3, 3] - start[:3, 3], [0.075, 0, 0], atol=3e-3)
    turned = so3.log(after[:3, :3] @ start[:3, :3].T)
    np.testing.assert_allclose(turned, [0, 0, 0.3], atol=0.02)
    moved.stop()
    world.wait(0.3)
    still = world.pose("flange")
    world.wait(0.2)
    np.testing.assert_allclose(world.pose("flange"), still, atol=1e-4)


def test_what_the_controller_says_differs_from_the_truth_as_the_noise_says() -> None:
    noise = RobotNoise(repeatability_mm=0.1, joint_offset_deg=0.0, link_mm=0.0, backlash_deg=0.0)
    moved, world = robot(noise=noise)
    off = []
    there, here = moved.pose(), moved.pose()
    there[:3, 3] += [0.05, 0.02, 0.03]
    for k in range(40):
        moved.move_to(here if k % 2 else there, speed=1.0)
        off.append((world.pose("flange") - moved.pose())[:3, 3])
    rms_mm = 1e3 * np.sqrt(np.mean(np.square(off)))
    # 120 numbers, not all independent: the scatter of their rms is below a sixth.
    assert 0.05 < rms_mm < 0.17


def test_poses_below_the_table_are_refused_and_nothing_moves() -> None:
    moved, _ = robot()
    before, low = moved.joints(), moved.pose()
    low[2, 3] = moved.workspace.tip_m - 0.004
    for move in (moved.move_to, moved.move_line):
        with pytest.raises(RefusedError, match=r"the tip would be 4\.0 mm below the table"):
            move(low)
    np.testing.assert_allclose(moved.joints(), before, atol=1e-6)
    low[2, 3] += 0.02
    moved.move_to(low)


def test_a_velocity_into_the_table_stops_above_it() -> None:
    moved, world = robot()
    near = moved.pose()
    near[2, 3] = moved.workspace.tip_m + 0.02
    moved.move_to(near)
    with pytest.raises(RefusedError, match="below the table"):
        moved.drive(np.array([0, 0, 0, 0, 0, -0.05]), seconds=2.0)
    assert world.pose("flange")[2, 3] - moved.workspace.tip_m > -1e-3


def test_what_cannot_be_reached_is_said() -> None:
    moved, _ = robot()
    far = moved.pose()
    far[:3, 3] = [1.5, 0, 0.5]
    with pytest.raises(RefusedError, match=r"cannot reach the flange pose at \(1500, 0, 500\) mm"):
        moved.move_to(far)
    with pytest.raises(RefusedError, match=r"joint4 would go to 57\.3 deg"):
        moved.move_joints(np.where(np.arange(7) == 3, 1.0, moved.home))
    with pytest.raises(InputError, match="0 to 80 mm"):
        moved.grip(0.1)


def test_an_arm_that_is_held_stops_and_says_so() -> None:
    # The closed fingers come down on a cube on the table.
    moved, world = robot(spec=RobotCellSpec(objects=(cube("block", "grey"),)))
    T = np.eye(4)
    T[:3, 3] = [*moved.pose()[:2, 3], 0.02]
    world.put("block", T)
    down = moved.pose()
    down[2, 3] = moved.workspace.tip_m + 0.001
    moved.grip(0.0)
    with pytest.raises(DeviceError, match="stopped by itself"):
        moved.move_line(down, speed=0.5)


def test_a_robot_that_was_switched_off_says_so() -> None:
    moved, _ = robot()
    moved.disconnect()
    with pytest.raises(DeviceError, match="does not answer"):
        moved.move_joints(moved.home)


def test_the_gripper_holds_a_cube_by_friction() -> None:
    moved, world = robot(spec=RobotCellSpec(objects=(cube("cube", "red"),)))
    T = np.eye(4)
    T[:3, 3] = [*moved.pose()[:2, 3], 0.02]
    world.put("cube", T)
    grasp = moved.pose()
    grasp[2, 3] = moved.workspace.tip_m + 0.012
    moved.move_to(grasp)
    state = moved.grip(0.0)
    assert state.holds
    assert state.width_m == pytest.approx(0.04, abs=1e-3)
    before = se3.inverse(world.pose("flange")) @ world.pose("cube")
    grasp[:3, 3] += [-0.1, 0.2, 0.25]
    moved.move_to(grasp, speed=0.6)
    world.wait(2.0)
    slip = se3.local(before, se3.inverse(world.pose("flange")) @ world.pose("cube"))
    assert np.abs(slip[3:]).max() < 1e-3  # it is carried, and creeps less than a millimetre
    assert not moved.grip(0.08).holds
    world.wait(0.5)
    assert world.pose("cube")[2, 3] < 0.05
