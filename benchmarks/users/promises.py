"""What is promised of the figures, line by line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from users.runs import Figures

Kinds = Mapping[str, frozenset[str]]
"""Names of the conditions that are "known", "clean", "told"."""

FEW = 5
"""Below so many results a mean says nothing."""
CLEAN = ("intrinsics/clean", "hand-eye/clean")
"""The ordinary clean sets; the others are clean and poor in something."""


def promises(found: Sequence[Figures], kinds: Kinds) -> Iterator[tuple[str, bool, str]]:
    """(what is promised, kept, what broke it)."""
    runs, silent = sum(f.runs for f in found), sum(f.silent for f in found)
    # One of 100; of fewer seeds one may be silent as well.
    loud = [f for f in found if f.silent > max(1, 0.01 * f.runs)]
    yield "verdict ok and wrong: 1 of 100 at most in each condition", not loud, told(loud, lambda f: f.silent)
    share = silent / runs if runs else 0.0
    yield "verdict ok and wrong: 0.3 % at most over all", share <= 0.003, f"{silent} of {runs}, {100 * share:.2f} %"
    large = [f for f in found if f.verdicts["ok"] >= FEW and f.mean_ok > 1.5]
    yield "verdict ok: mean normalised error 1.5 at most", not large, told(large, lambda f: f.mean_ok)
    known = [f for f in found if f.name in kinds["known"] and answers(f) >= FEW]
    large = [f for f in known if f.mean > 1.3]
    yield "sigma can be known: mean 1.3 at most, whatever the verdict", not large, told(large, lambda f: f.mean)
    narrow = [f for f in known if f.covered < 0.93]
    yield "sigma can be known: 95 % intervals hold 93 % at least", not narrow, told(narrow, lambda f: 100 * f.covered)
    told_of = [f for f in found if f.name in kinds["told"] and answers(f) >= FEW]
    if told_of:
        large = [f for f in told_of if f.mean > 1.5]
        yield "robot's accuracy told: mean 1.5 at most, whatever the verdict", not large, told(large, lambda f: f.mean)
    yield from of_clean([f for f in found if f.name in CLEAN])
    errors = [f for f in found if f.verdicts["error"]]
    yield "no exception but refusals", not errors, told(errors, lambda f: f.verdicts["error"])


def of_clean(clean: Sequence[Figures]) -> Iterator[tuple[str, bool, str]]:
    for f in clean:
        yield f"{f.name}: sigma 10 % above the least at most", f.growth <= 1.1, f"{f.growth:.3f}"
        refused = f.verdicts["refused"] / f.runs
        yield f"{f.name}: refused 0.5 % at most", refused <= 0.005, f"{100 * refused:.1f} %"
        nothing = f.for_nothing / f.runs
        yield f"{f.name}: warned of for nothing 5 % at most", nothing <= 0.05, f"{100 * nothing:.1f} %"


def answers(f: Figures) -> int:
    return f.verdicts["ok"] + f.verdicts["warn"]


def told(conditions: Sequence[Figures], what) -> str:
    return ", ".join(f"{f.name} {float(np.round(what(f), 2)):g}" for f in conditions)
