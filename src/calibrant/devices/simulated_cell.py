"""The simulated cell as devices: `cell`, `cell:seed=3,arm=ur5e,camera=top`. Needs the extra `sim`."""

from __future__ import annotations

from pathlib import Path

from calibrant.devices.driver import Driver, Opened
from calibrant.devices.spec import DeviceSpec


def open_cell(spec: DeviceSpec) -> Opened:
    """The cell of a seed, its arm and its cameras. Raises: MissingExtraError without MuJoCo; InputError."""
    from calibrant.simulate.robot_cell import RobotCellSpec, make_robot_cell

    spec.refuse_place("cell:seed=3,arm=ur5e")
    made = RobotCellSpec(arm=spec.options.get("arm", RobotCellSpec().arm))
    record = spec.options.get("record")
    cell = make_robot_cell(spec.whole("seed", 0), spec=made, record=None if record is None else Path(record))
    if "tool" in spec.options:
        cell.carry("pen" if spec.one_of("tool", ("pen", "stick"), "pen") == "pen" else "stick")
    return Opened(cell.robot, dict(cell.cameras), "wrist" if "wrist" in cell.cameras else "", cell.close)


DRIVER = Driver(
    name="cell",
    form="cell[:seed=N,arm=ARM,camera=wrist|front|top,tool=pen|stick,record=DIR]",
    gives=("robot", "camera"),
    says="a simulated arm with wrist, front and top cameras",
    tested="itself: MuJoCo",
    connect=open_cell,
    keys=("seed", "arm", "camera", "tool", "record"),
    extra="sim",
)
