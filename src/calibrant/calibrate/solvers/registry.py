"""Every closed-form hand-eye solver by name. A new method is one file and one line here."""

from __future__ import annotations

from calibrant.calibrate.solvers.andreff import ANDREFF
from calibrant.calibrate.solvers.chou import CHOU
from calibrant.calibrate.solvers.convex import CONVEX
from calibrant.calibrate.solvers.daniilidis import DANIILIDIS, DANIILIDIS_SCREW
from calibrant.calibrate.solvers.dornaika import DORNAIKA
from calibrant.calibrate.solvers.horaud import HORAUD
from calibrant.calibrate.solvers.li import LI
from calibrant.calibrate.solvers.park import PARK
from calibrant.calibrate.solvers.shah import SHAH
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.calibrate.solvers.tsai import TSAI
from calibrant.errors import InputError

SOLVERS: dict[str, HandEyeSolver] = {
    solver.name: solver
    for solver in (
        TSAI,
        PARK,
        HORAUD,
        ANDREFF,
        DANIILIDIS,
        DANIILIDIS_SCREW,
        CHOU,
        SHAH,
        LI,
        DORNAIKA,
        CONVEX,
    )
}


JOINT, MEAN = "joint", "mean"
METHODS = (JOINT, *SOLVERS, MEAN)
"""The joint refinement, every closed form, and the mean transform over the closed forms that answered."""


def get_solver(name: str) -> HandEyeSolver:
    """The solver of that name. Raises: InputError listing the names there are."""
    if name not in SOLVERS:
        raise InputError(f"no hand-eye method called {name!r}; there are: {', '.join(SOLVERS)}")
    return SOLVERS[name]


def require_method(name: str) -> str:
    """The method's name. Raises: InputError listing the methods there are."""
    if name not in METHODS:
        raise InputError(f"unknown method {name!r}; known: {', '.join(METHODS)}")
    return name
