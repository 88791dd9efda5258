"""Options of commands that read cameras and move robots."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from calibrant.errors import RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.devices import DeviceOptions


class Answering(Listener):
    def __init__(self, answer: bool) -> None:
        self.answer, self.asked = answer, ""

    def ask(self, question: str) -> bool:
        self.asked = question
        return self.answer


def robot(*, matters: bool) -> Any:
    return SimpleNamespace(name="UR at 192.168.0.10", moves_matter=matters)


def test_real_robot_is_asked_for_and_nobody_is_no() -> None:
    options = DeviceOptions()
    asked = Answering(True)
    options.confirm(robot(matters=True), "it servos to the taught pose", asked)
    assert "UR at 192.168.0.10: it servos to the taught pose" in asked.asked
    for listener in (Answering(False), SILENT):
        with pytest.raises(RefusedError, match=r"has not moved.*--yes"):
            options.confirm(robot(matters=True), "it servos to the taught pose", listener)


def test_simulated_robot_and_yes_need_no_answer() -> None:
    DeviceOptions().confirm(robot(matters=False), "it moves", SILENT)
    DeviceOptions(yes=True).confirm(robot(matters=True), "it moves", SILENT)
