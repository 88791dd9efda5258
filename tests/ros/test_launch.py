"""Several nodes at once: checked before any starts, and ended together."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.ros import launch, run

CONFIG = "name: {name}\nimage: /{name}/image\ntf: base:tool0\ntarget: chessboard:7x6:30mm\npython: /no/python\n"


def configs(folder: Path, *names: str) -> tuple[Path, ...]:
    for i, name in enumerate(names):
        (folder / f"{i}.yaml").write_text(CONFIG.format(name=name))
    return tuple(folder / f"{i}.yaml" for i in range(len(names)))


def test_two_cameras_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two configurations have the name front; give each camera its own"):
        launch.run(launch.Request(configs=configs(tmp_path, "front", "front")))


def test_a_session_that_is_there_is_left_alone(tmp_path: Path) -> None:
    (only,) = configs(tmp_path, "front")
    (tmp_path / "front-session").mkdir()
    for module, request in ((run, run.Request(config=only)), (launch, launch.Request(configs=(only,)))):
        with pytest.raises(InputError, match="front-session exists already; give the samples a new folder"):
            module.run(request)


def test_a_window_of_no_view_is_refused(tmp_path: Path) -> None:
    (only,) = configs(tmp_path, "front")
    with pytest.raises(InputError, match="--window 0: expected 1 view or more"):
        run.run(run.Request(config=only, window=0))


@pytest.mark.long
def test_a_node_that_fails_ends_all_and_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the node of (wrist|top) failed with status 2; see above"):
        launch.run(launch.Request(configs=configs(tmp_path, "wrist", "top")))
