"""A camera's configuration, and what is said of one that is not whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.live.camera_config import read_config

GOOD = "name: wrist\nimage: /wrist/image\ntf: base:tool0\ntarget: chessboard:7x6:30mm\n"
FRONT = """\
name: front
ros: 2
image: /front/image
camera: front.json
tf: base_link:tool0
target: chessboard:7x6:30mm
through: {image: /wrist/image, result: wrist/result.json}
"""


def test_a_configuration_and_its_defaults(tmp_path: Path) -> None:
    (tmp_path / "wrist.yaml").write_text(GOOD)
    config = read_config(tmp_path / "wrist.yaml")
    assert (config.base, config.tool, config.ros, config.views, config.window) == ("base", "tool0", 1, 15, 30)
    assert config.session == tmp_path / "wrist-session"
    assert config.pictures == ("/wrist/image",)


def test_files_are_beside_it_and_the_window_may_be_given(tmp_path: Path) -> None:
    (tmp_path / "front.yaml").write_text(FRONT)
    config = read_config(tmp_path / "front.yaml", window=5)
    assert config.through is not None
    assert (config.camera, config.through.result) == (tmp_path / "front.json", tmp_path / "wrist" / "result.json")
    assert (config.pictures, config.window) == (("/front/image", "/wrist/image"), 5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (GOOD.replace("name: wrist\n", ""), "name is missing; expected a text"),
        (GOOD.replace("base:tool0", "base"), "tf is 'base'; expected the frames BASE:TOOL"),
        (GOOD + "topics: [a]\n", "unknown key topics; keys: camera, camera_info, "),
        (GOOD + "views: 2\n", "views is 2; expected a whole number, 3 or more"),
        (GOOD + "ros: 3\n", "ros is 3; expected 1 or 2"),
        (GOOD + "setup: hand\n", "setup is 'hand'; expected auto, eye-in-hand"),
        (GOOD.replace("30mm", "30"), "30"),
        (FRONT.replace("camera: front.json\n", ""), "needs its lens: camera_info, or camera: FILE"),
        (FRONT.replace("through: {", "through: {window: 3, "), "unknown key through.window; keys: image, result"),
        ("- 1\n", "name|tf is missing"),
        ("name: [\n", "not YAML"),
    ],
)
def test_what_is_not_whole_is_named(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(InputError, match=rf"c\.yaml.*(?:{words})"):
        read_config(tmp_path / "c.yaml")
