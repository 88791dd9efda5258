"""The names of camera models that the help lists are those that there are."""

from __future__ import annotations

from typing import get_args

from calibrant.calibrate.intrinsics.model_choice import AUTO
from calibrant.cameras import MODELS
from calibrant.cameras.splined import EXAMPLE, FAMILY
from calibrant.cli.options import Model


def test_the_help_lists_every_model() -> None:
    option = get_args(Model)[1]
    listed = set(option.help.replace("(", " ").replace(")", " ").replace(",", " ").replace(": ", " ").split())
    assert {*MODELS, AUTO, FAMILY, EXAMPLE} <= listed
