"""Options that say what a projector shows."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels

if TYPE_CHECKING:
    from calibrant.patterns.sequence import PatternSequence

CODES = ("gray", "phase", "both")
_SIZE = re.compile(r"(\d+)\s*[xX×]\s*(\d+)(px)?")


@dataclass(frozen=True, kw_only=True)
class PatternOptions:
    """The patterns, as `projector patterns` made them."""

    projector_size: Annotated[str, Option("WxH")] = ""
    """The projector's own pixels, e.g. 1024x768."""
    code: Annotated[str, Option("gray|phase|both", choices=CODES)] = "gray"
    """gray: bits, each with its inverse; phase: shifted cosines of several periods; both: bits, then fine cosines."""
    period: Annotated[str, Option("PX")] = "16px"
    """Period of the finest cosines."""
    shifts: Annotated[int, Option("N")] = 8
    """Shifts of each cosine; five or more cancel a projector's gamma."""

    def sequence(self) -> PatternSequence:
        """The sequence. Raises: InputError for a size or period that is none."""
        found = _SIZE.fullmatch(self.projector_size.strip())
        if found is None:
            what = "is missing" if not self.projector_size else f"is {self.projector_size!r}"
            raise InputError(f"--projector-size {what}; give the projector's own pixels, such as 1024x768")
        return sequence_of((int(found[1]), int(found[2])), self.code, self.period, self.shifts)


def sequence_of(size: tuple[int, int], code: str, period: str, shifts: int) -> PatternSequence:
    """The sequence of a projector of a size. Raises: InputError for a code, period or count that cannot be."""
    from calibrant.patterns.sequence import PatternSequence

    length = pixels(period, option="--period") or 0.0
    if length != int(length):
        raise InputError(f"--period is a whole number of pixels, such as 16px; got {period}")
    return PatternSequence(size, code, int(length), shifts)
