"""Closed-form hand-eye solvers behind one interface; one file each, with its paper.

solution = SOLVERS["park"].solve(A, B)      # A_i X B_i = Z: solution.X, solution.Z
"""

from __future__ import annotations

from calibrant.calibrate.solvers.registry import SOLVERS, get_solver
from calibrant.calibrate.solvers.solver import HandEyeSolution, HandEyeSolver

__all__ = ["SOLVERS", "HandEyeSolution", "HandEyeSolver", "get_solver"]
