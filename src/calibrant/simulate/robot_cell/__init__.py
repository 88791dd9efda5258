"""A robot cell to believe in: MuJoCo's physics and pictures behind `data.Robot` and `data.CameraSource`.

`make_robot_cell(seed)` draws one; nobody who works with its robot and cameras learns that they are simulated. Needs the
extra `sim`.
"""

from calibrant.simulate.robot_cell.cell import RobotCell as RobotCell
from calibrant.simulate.robot_cell.make import make_robot_cell as make_robot_cell
from calibrant.simulate.robot_cell.parts.spec import CellCamera as CellCamera
from calibrant.simulate.robot_cell.parts.spec import CellObject as CellObject
from calibrant.simulate.robot_cell.parts.spec import Conveyor as Conveyor
from calibrant.simulate.robot_cell.parts.spec import RobotCellSpec as RobotCellSpec
from calibrant.simulate.robot_cell.parts.spec import cube as cube
from calibrant.simulate.robot_cell.parts.spec import cuboid as cuboid
from calibrant.simulate.robot_cell.parts.spec import sheet as sheet
