"""What shells offer is what the commands take."""

from __future__ import annotations

from calibrant.calibrate.solvers import registry
from calibrant.cameras.registry import MODELS
from calibrant.formats.poses.makers import FORMATS
from calibrant.reports.sheet import PAGES
from calibrant.tasks.options import choices


def test_words_are_those_of_the_registries() -> None:
    assert set(choices.MODELS) == {*(name.partition(":")[0] for name in MODELS), "auto"}
    assert choices.METHODS == registry.METHODS
    assert set(choices.MAKERS) == set(FORMATS)
    assert set(choices.PAGES) == {*PAGES, "auto", "fit"}
