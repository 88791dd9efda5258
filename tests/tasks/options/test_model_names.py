"""The names of camera models that the help lists are those that there are."""

from __future__ import annotations

from calibrant.calibrate.intrinsics.model_choice import AUTO
from calibrant.cameras import MODELS
from calibrant.cameras.splined import EXAMPLE, FAMILY
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.fields import helps_of


def test_the_help_lists_every_model() -> None:
    text = helps_of(LensOptions)["model"]
    listed = set(text.replace("(", " ").replace(")", " ").replace(",", " ").replace(": ", " ").split())
    assert {*MODELS, AUTO, FAMILY, EXAMPLE} <= listed
