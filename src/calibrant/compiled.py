"""Compiled functions of one signature, kept on disk: Numba's njit, loaded without what only a compilation needs.

Before it looks into its cache, Numba brings the implementations of all of Python's and NumPy's functions, SciPy's
linear algebra among them: half a second. A function that is found there needs none of them, only Numba's runtime to
link against. One that is not found is compiled as ever: the compiler brings them itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.runtime import rtsys


def compiled(signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: the function compiled for `signature` alone, without Python's lock, divisions by 0 giving inf or NaN.

    options: further ones of Numba's njit.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
        target = dispatcher.targetctx
        dispatcher.targetctx = _Linking(target)
        try:
            dispatcher.compile(signature)
        finally:
            dispatcher.targetctx = target
        dispatcher.disable_compile()
        return dispatcher

    return decorate


class _Linking:
    """Numba's target context, of which a cached function is asked for: refreshed, it has a runtime and nothing more."""

    def __init__(self, target: Any) -> None:
        self._target = target

    def refresh(self) -> None:
        rtsys.initialize(self._target)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._target, name)
