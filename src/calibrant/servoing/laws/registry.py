"""The control laws by the name that `--control` takes. A new one is a file beside this one and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from calibrant.errors import InputError
from calibrant.servoing.laws.hybrid import Hybrid
from calibrant.servoing.laws.image_based import ImageBased
from calibrant.servoing.laws.law import Law
from calibrant.servoing.laws.planar import Planar
from calibrant.servoing.laws.position_based import PositionBased

_EVERY: tuple[Law, ...] = (ImageBased(), PositionBased(), Hybrid(), Planar())
LAWS: Mapping[str, Law] = {law.name: law for law in _EVERY}


def law_of(name: str) -> Law:
    """Raises: InputError listing the known ones."""
    if name not in LAWS:
        raise InputError(f"--control {name}: choose {', '.join(LAWS)}")
    return LAWS[name]
