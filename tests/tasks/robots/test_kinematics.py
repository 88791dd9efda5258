"""`calibrant kinematics` from files to files."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.cli.application import run
from calibrant.formats.robots.read import read_robot
from calibrant.formats.robots.urdf import new_urdf
from calibrant.robots.arms import arm
from calibrant.simulate.robot_errors import SimulatedArm, measure, simulate_arm


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulatedArm]:
    """A folder with the URDF of a nominal arm and measurements of a worn one, positions in mm."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(new_urdf(arm("ur5e")))
    nominal = read_robot(folder / "arm.urdf").chain
    rng = np.random.default_rng(11)
    simulated = simulate_arm(nominal, rng, sigma_mm=0.5, sigma_deg=0.1)
    data = measure(simulated, simulated.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=None)
    lines = ["name,q1,q2,q3,q4,q5,q6,x[mm],y[mm],z[mm]"]
    for name, q, p in zip(data.ids, data.joints, data.positions):
        lines.append(",".join([name, *(f"{v:.9f}" for v in (*q, *(1e3 * p)))]))
    (folder / "tracker.csv").write_text("\n".join(lines) + "\n")
    circle = new_urdf(arm("ur5e")).replace('<parent link="base_link" />', '<parent link="link_3" />')
    (folder / "circle.urdf").write_text(circle)
    (folder / "targets.csv").write_text("q1,q2,q3,q4,q5,q6\n0.1,-1.2,1.1,-1.0,1.3,0.2\n-0.6,-1.0,1.4,-1.5,1.2,0.9\n")
    return folder, simulated


def test_a_worn_arm_is_corrected(session: tuple[Path, SimulatedArm], capsys: pytest.CaptureFixture[str]) -> None:
    folder, simulated = session
    out = {name: folder / name for name in ("result.json", "corrected.urdf", "commands.csv", "report.html")}
    options = {
        "--robot": folder / "arm.urdf",
        "--measurements": folder / "tracker.csv",
        "--out": out["result.json"],
        "--corrected": out["corrected.urdf"],
        "--commands": folder / "targets.csv",
        "--commands-out": out["commands.csv"],
        "--report": out["report.html"],
    }
    status = run(["kinematics", *(str(word) for pair in options.items() for word in pair)])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    assert "elbow offset" in printed.out
    assert f"{out['corrected.urdf']}" in "".join(printed.out.split())
    assert "0 deg  per axis" not in printed.out
    result = json.loads(out["result.json"].read_text())
    assert result["kind"] == "kinematics"
    page = out["report.html"].read_text()
    elbow = next(p for p in result["details"]["robot_parameters"]["robots"]["robot"] if p["name"] == "elbow offset")
    row = page[page.index("elbow offset") :].split("</tr>")[0]
    assert f">{np.rad2deg(elbow['correction']):.4f}<" in row
    assert "40 of 40 measurements used" in page
    assert result["created"] in page
    assert result["held_out"]["mm"] < 0.2
    base, tool = (np.array(t["matrix"]) for t in result["transforms"])
    corrected = read_robot(out["corrected.urdf"]).chain
    q = simulated.draw_joints(np.random.default_rng(0), 100)
    # The target is 0.08 mm for the typical error of positions the fit has not seen.
    error = (base @ corrected.forward(q) @ tool)[:, :3, 3] - simulated.tool(q)[:, :3, 3]
    assert 1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.08
    commands = list(csv.reader(out["commands.csv"].open()))
    values = np.array([[float(v) for v in row[1:7]] for row in commands[1:]])
    wanted = simulated.nominal.forward([[0.1, -1.2, 1.1, -1.0, 1.3, 0.2], [-0.6, -1.0, 1.4, -1.5, 1.2, 0.9]])
    assert np.allclose(corrected.forward(values), wanted, atol=1e-8)


def test_a_positioner_needs_no_robot_file(
    shared_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = shared_data("kinematic_rct_positioner") / "positioner_kinematic_measurements.yaml"
    report = tmp_path / "report.html"
    assert run(["kinematics", "-m", str(data), "--json", "--report", str(report)]) == 0
    result = json.loads(capsys.readouterr().out)
    first = result["details"]["joint_axes"]["axes"][0]
    row = report.read_text().split("target_joints_1</th>")[1].split("</tr>")[0]
    assert ", ".join(f"{v:.6f}" for v in first["direction"]) in row
    assert f">{first['sigma_point_mm']:.2g}<" in row
    assert result["figures"]["rms_after_mm"]["value"] <= 0.41
    assert result["figures"]["rms_after_deg"]["value"] <= 0.055
    assert [axis["kind"] for axis in result["details"]["joint_axes"]["axes"]] == ["revolute", "revolute"]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--robot", "arm.urdf", "--robot-link", "hand"], 2, "no link 'hand'; the links are base_link"),
        (["--robot", "arm.urdf", "--joint-angle", "deg", "--hold", "wrist"], 2, "cannot hold 'wrist'"),
        (["--robot", "arm.urdf", "--identify", "wear"], 2, "cannot identify 'wear'"),
        (["--robot", "arm.urdf", "--identify", "elasticity"], 2, "needs the robot's masses"),
        (["--robot", "arm.urdf", "--payload", "5"], 2, "--payload takes a mass with its unit"),
        (["--robot", "arm.urdf", "--commands", "targets.csv"], 2, "--commands and --commands-out belong together"),
        (["--robot", "arm.urdf", "--corrected", "arm.urdf", "--force"], 2, "is an input of this command"),
        (["--robot", "circle.urdf"], 2, "in a circle"),
        (["--robot", "circle.urdf", "--robot-base", "link_4", "--robot-link", "link_2"], 2, "in a circle"),
        (["--robot", "none.urdf"], 2, "no robot file none.urdf"),
        ([], 1, "positions alone do not start a robot"),
    ],
)
def test_what_cannot_be_done_is_said(
    session: tuple[Path, SimulatedArm],
    arguments: list[str],
    status: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(session[0])
    assert run(["kinematics", "-m", "tracker.csv", *arguments]) == status
    assert message in capsys.readouterr().err
