"""The images of a pair: a camera that saw no board is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import DetectionError, InputError
from calibrant.geometry import se3
from calibrant.opencv import cv2
from calibrant.simulate.render import render
from calibrant.simulate.scenes import standard_camera
from calibrant.targets.registry import parse_target
from calibrant.tasks.cameras.stereo_pictures import StereoPictures, pictures_of
from calibrant.tasks.listener import SILENT
from calibrant.tasks.options.images import CornerOptions, PairSearchOptions


def test_a_camera_that_saw_no_board_is_named(tmp_path: Path) -> None:
    target, rng = parse_target("chessboard:9x6:25mm"), np.random.default_rng(0)
    T = se3.make(np.eye(3), np.array([0.0, 0.0, 0.6]) - target.points.mean(axis=0))
    shown = render(target.artwork(), standard_camera(), T, rng=rng)
    for side, picture in (("left", shown), ("right", np.full_like(shown, 90))):
        for k in range(2):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{k}.png"), np.clip(picture + rng.normal(0, 2, shown.shape), 0, 255))
    with pytest.raises(DetectionError, match="camera right: 0 of 2 boards found"):
        cb.stereo(left=tmp_path / "left", right=tmp_path / "right", target="chessboard:9x6:25mm")


def test_a_table_of_times_pairs_the_images(tmp_path: Path) -> None:
    """Numbers that both sides count by themselves would pair every image with another moment's."""
    rows = ["camera,frame,time"]
    for side, times in (("left", [0.0, 1.0, 2.0, 3.0]), ("right", [1.01, 2.02, 2.99])):
        (tmp_path / side).mkdir()
        for k, t in enumerate(times):
            (tmp_path / side / f"{k}.png").write_text(f"{side} {k}")
            rows.append(f"{side},{k},{t}")
    table = tmp_path / "times.csv"
    table.write_text("\n".join(rows))
    given = {"left": [str(tmp_path / "left")], "right": [str(tmp_path / "right")]}

    def pictures(*, rule: str = "auto", observations: Path | None = None) -> StereoPictures:
        sides = given if observations is None else {"left": (), "right": ()}
        return pictures_of(
            **sides, targets={"left": "chessboard:9x6:25mm", "right": "chessboard:9x6:25mm"}, observations=observations,
            rule=rule, table=table, search=PairSearchOptions(), corners=CornerOptions(), listener=SILENT,
        )  # fmt: skip

    found = pictures()
    left, right = ({m: f.name for f, m in found.moments[side].items()} for side in ("left", "right"))
    assert {left[m]: right[m] for m in left if m in right} == {"1.png": "0.png", "2.png": "1.png", "3.png": "2.png"}
    assert found.paired.startswith(
        "3 pairs by the times given; 1 of the left camera without a partner: 0.png; times of"
    )
    assert table in found.inputs
    with pytest.raises(InputError, match="leave out --pairs name"):
        pictures(rule="name")
    with pytest.raises(InputError, match="leave out --observations"):
        pictures(observations=table)
    table.write_text("\n".join(rows[:-1]))
    with pytest.raises(InputError, match=r"tells no time of 2\.png of camera right .*add their rows"):
        _ = pictures().found
