"""Values of options as Python gives them."""

from __future__ import annotations

import pytest

from calibrant.errors import InputError
from calibrant.targets.registry import parse_target
from calibrant.tasks.cameras.intrinsics import Request as Intrinsics
from calibrant.tasks.options.fields import build
from calibrant.tasks.robots.hand_eye import Request as HandEye

SPEC = "chessboard:9x6:25mm"


def test_a_target_stands_for_its_spec() -> None:
    target = parse_target(SPEC)
    assert build(Intrinsics, {"target": target}).photos.target == target.spec
    by_name = build(HandEye, {"poses": "poses.csv", "target": {"left": target, "right": SPEC}})
    assert by_name.target == (f"left={target.spec}", f"right={SPEC}")


def test_what_says_no_target_is_named() -> None:
    with pytest.raises(InputError, match="target takes text or a path, got 3"):
        build(Intrinsics, {"target": 3})
