"""Which calibrant this is: one number, read by the package, its result files and its build."""

from __future__ import annotations

__version__ = "0.1.0"
