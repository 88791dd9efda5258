"""The node on a real ROS 1: Debian's roscore and rospy, a robot of a few lines that publishes pictures and tf."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.ros.bridge import Bridge
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import gripper_poses, look_at_board, standard_mounting
from calibrant.targets.registry import parse_target
from calibrant.tasks.live.camera_config import CameraConfig

PYTHON = Path("/usr/bin/python3")
ROBOT = Path(__file__).with_name("robot_ros1.py")
TARGET = "chessboard:7x6:30mm"
PACKAGES = "python3-rospy python3-roslaunch python3-sensor-msgs python3-tf2-msgs python3-geometry-msgs"
CAMERA = Camera.create("brown", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0, "k1": -0.1}, image_size=(480, 360))
CONFIG = """\
name: wrist
ros: 1
image: /wrist/image
camera_info: /wrist/camera_info
tf: base:tool0
target: chessboard:7x6:30mm
views: 8
session: session
"""


def hear_interrupts() -> None:
    """Jobs that a shell starts in the background ignore Ctrl-C, and so would what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture(scope="module")
def ros() -> Iterator[dict[str, str]]:
    """The environment of a roscore on a free port."""
    needed = "import rospy, rosmaster, sensor_msgs.msg, tf2_msgs.msg, geometry_msgs.msg, numpy"
    have = PYTHON.exists() and not subprocess.run([PYTHON, "-c", needed], capture_output=True, check=False).returncode
    if not have or not Path("/usr/bin/roscore").exists():
        pytest.skip(f"no ROS 1 in {PYTHON}; on Debian: apt-get install {PACKAGES}")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = {**os.environ, "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    env.pop("PYTHONPATH", None)
    core = subprocess.Popen(
        ["/usr/bin/roscore", "-p", str(port)], env=env, start_new_session=True, preexec_fn=hear_interrupts,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    wait = "import time, rosgraph\nwhile not rosgraph.is_master_online(): time.sleep(0.1)"
    subprocess.run([PYTHON, "-c", wait], env=env, timeout=60, check=True)
    yield env
    core.send_signal(signal.SIGINT)
    core.wait(30)


@pytest.mark.long
def test_the_camera_of_a_running_robot_comes_on_tf_static(ros: dict[str, str], tmp_path: Path) -> None:
    X, Z = standard_mounting("eye-in-hand")
    target, rng = parse_target(TARGET), np.random.default_rng(3)
    seen = look_at_board(CAMERA, target.points, 9, rng=rng, distance=(0.35, 0.6), tilt_deg=45)
    A = gripper_poses("eye-in-hand", X, Z, seen)
    look = Look(clutter=0, noise_grey=2.0)
    pictures = np.array([render(target.artwork(), CAMERA, T, rng=rng, look=look) for T in seen])
    quaternions = so3.quaternion_wxyz(A[:, :3, :3])[:, [1, 2, 3, 0]]
    terms = np.array([CAMERA.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")])
    places = np.hstack([A[:, :3, 3], quaternions])
    np.savez(tmp_path / "stands.npz", pictures=pictures, places=places, D=terms, K=CAMERA.K)
    (tmp_path / "wrist.yaml").write_text(CONFIG)
    node = subprocess.Popen(
        [sys.executable, "-m", "calibrant", "ros", "run", str(tmp_path / "wrist.yaml")],
        env={**ros, "PYTHONPATH": os.environ.get("PYTHONPATH", "")}, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, preexec_fn=hear_interrupts,
    )  # fmt: skip
    try:
        robot = subprocess.run(
            [PYTHON, ROBOT, tmp_path], env=ros, capture_output=True, text=True, timeout=300, check=True
        )
        # What is published for good reaches those who come late.
        late = "import rospy; from tf2_msgs.msg import TFMessage; rospy.init_node('late'); "
        late += "print(rospy.wait_for_message('/tf_static', TFMessage, 20).transforms[0].child_frame_id)"
        again = subprocess.run([PYTHON, "-c", late], env=ros, capture_output=True, text=True, timeout=60, check=True)
    finally:
        node.send_signal(signal.SIGINT)
        said, _ = node.communicate(timeout=60)
    assert again.stdout.strip() == "wrist_optical", said
    found = json.loads(robot.stdout)
    (static,) = found["static"]
    x, y, z, *xyzw = static["place"]
    published = se3.make(so3.from_quaternion_wxyz([xyzw[3], *xyzw[:3]]), [x, y, z])
    mm, deg = se3.deviation(X, published)
    assert (static["parent"], static["child"], mm < 1.0, deg < 0.1) == ("tool0", "wrist_optical", True, True)
    assert found["shown"] == [[480, 360, "bgr8"]]
    assert node.returncode == 0, said
    assert (tmp_path / "session" / "result.json").exists()


@pytest.mark.long
@pytest.mark.usefixtures("ros")
def test_without_a_master_the_message_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    config = CameraConfig(
        name="wrist", ros=1, image="/i", base="base", tool="tool0", target=TARGET, session=tmp_path / "s"
    )
    with pytest.raises(InputError, match=r"ROS 1 by /usr/bin/python3: .*no roscore answers at http://127\.0\.0\.1:9"):
        Bridge(config)
