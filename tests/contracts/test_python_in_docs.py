"""Every fenced block of Python in the README and the docs runs, on data that its page takes as given."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.geometry import so3
from calibrant.simulate.cell import make_cell, photograph
from calibrant.simulate.manhattan import render_room, room
from calibrant.simulate.render import render
from calibrant.simulate.scenes import hand_eye_scene, intrinsics_scene, look_at_board, standard_camera
from calibrant.targets.registry import parse_target

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
BOARD = "chessboard:9x6:25mm"

SHOWN_ELSEWHERE = {
    "from-opencv.md": "its block runs with the lines of its page: test_pages_of_users.py",
    "conventions.md": "its examples say their output: test_conventions.py",
    "examples.md": "shows the files of examples/, which run by themselves",
}
"""Pages whose blocks are not run here, and why."""


def blocks() -> list[tuple[str, str]]:
    return [(page.name, text) for page in PAGES for text in BLOCK.findall(page.read_text(encoding="utf-8"))]


def photos(folder: Path) -> dict[str, Any]:
    """README: photos of a board in photos/, and pose pairs."""
    board, camera, rng = parse_target(BOARD), standard_camera(), np.random.default_rng(3)
    (folder / "photos").mkdir()
    for i, T in enumerate(look_at_board(camera, board.points, 5, rng=rng, distance=(0.25, 0.5))):
        cv2.imwrite(f"{folder}/photos/{i}.png", render(board.artwork(), camera, T, rng=rng))
    scene = hand_eye_scene("good", seed=1)
    return {"T_base_gripper": scene.robot_poses.T_base_gripper, "T_camera_target": scene.measured_T_camera_target}


def first_set(folder: Path) -> dict[str, Any]:
    """My first hand-eye: photos and poses in good/."""
    photograph(make_cell(1, views=6), folder / "good")
    return {}


def one_view(folder: Path) -> dict[str, Any]:
    """Points that a camera saw in one photo of a tilted board."""
    scene = intrinsics_scene(1, seed=4, sigma_px=0.05)
    view = scene.observations.views[0]
    return {"points": view.points, "uv": view.uv}


def photo_of_a_board(folder: Path) -> dict[str, Any]:
    """photo.png of a board, and camera.json."""
    board, camera, rng = parse_target(BOARD), standard_camera(), np.random.default_rng(2)
    (T,) = look_at_board(camera, board.points, 1, rng=rng, distance=(0.3, 0.4))
    cv2.imwrite(f"{folder}/photo.png", render(board.artwork(), camera, T, rng=rng))
    save(camera, folder)
    return {}


def photo_of_a_room(folder: Path) -> dict[str, Any]:
    """street.jpg, of a room with edges along three directions, and camera.json."""
    rng, camera = np.random.default_rng(0), standard_camera()
    grey = render_room(room(rng), camera, so3.exp([0.2, 0.4, 0.05]), rng=rng)
    cv2.imwrite(f"{folder}/street.jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 98])
    save(camera, folder)
    return {}


def save(camera: Camera, folder: Path) -> None:
    CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(folder / "camera.json")


def any_photo(folder: Path) -> dict[str, Any]:
    return {"camera": standard_camera(), "image": np.full((1024, 1280), 128, dtype=np.uint8)}


GIVEN: dict[str, Callable[[Path], dict[str, Any]]] = {
    "README.md": photos,
    "camera-models.md": any_photo,
    "classical-methods.md": one_view,
    "first-hand-eye.md": first_set,
    "pose.md": photo_of_a_board,
    "vanishing.md": photo_of_a_room,
}


@pytest.mark.parametrize(("page", "text"), blocks(), ids=lambda value: value if value.endswith(".md") else "")
def test_python_on_a_page_runs(page: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page in SHOWN_ELSEWHERE:
        compile(text, page, "exec") if ">>>" not in text else None
        return
    monkeypatch.chdir(tmp_path)
    names = GIVEN[page](tmp_path) if page in GIVEN else {}
    exec(compile(text, page, "exec"), names)


def test_every_exception_names_a_page_that_has_python() -> None:
    with_python = {page for page, _ in blocks()}
    assert set(SHOWN_ELSEWHERE) <= with_python
    assert set(GIVEN) <= with_python


def test_the_page_of_examples_shows_every_example() -> None:
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    shown = re.findall(r'^--8<-- "(examples/.*)"$', page, re.M)
    assert shown == sorted(f"examples/{file.name}" for file in (ROOT / "examples").glob("[0-9]*.py"))


def test_examples_are_short() -> None:
    long = {f.name: n for f in (ROOT / "examples").glob("*.py") if (n := len(f.read_text("utf-8").splitlines())) > 60}
    assert not long


def test_words_of_the_glossary_live_where_it_says() -> None:
    source = ROOT / "src" / "calibrant"
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    places = re.findall(r"\| (?:`([A-Za-z_.]+)` in )?`([a-z_/]+\.py)` \|$", page, re.M)
    assert len(places) > 40
    for name, file in places:
        assert (source / file).is_file(), f"{file} is not there"
        if name:
            text, (owner, _, member) = (source / file).read_text(encoding="utf-8"), name.partition(".")
            assert re.search(rf"^(?:class|def) {owner}\b", text, re.M), f"{file} defines no {owner}"
            assert not member or re.search(rf"^    {member}:", text, re.M), f"{owner} in {file} has no {member}"
