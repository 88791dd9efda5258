"""Compiled functions of one signature, kept on disk: Numba's njit, loaded without what only a compilation needs.

Before it looks into its cache, Numba brings the implementations of all of Python's and NumPy's functions, SciPy's
linear algebra among them: half a second. A function that is found there needs none of them, only Numba's runtime to
link against. One that is not found is compiled as ever: the compiler brings them itself.

What is reached here of Numba's inside, tests/test_compiled.py names and tries: `_cache`, `_insert`, `targetctx`,
`FunctionCache._index_key`. pyproject.toml bounds Numba's version from above for that reason.

A first run waits for all that it compiles, so each function says who calls it, and gets no other way in: a wrapper is
as much to compile as a small function, and holds a copy of one that is inlined. Kernels copy arrays element by element
where that is as short: `a[:] = b` brings a sentence about shapes that do not fit, and with it all of Python's strings.

The same picture gives the same digits in every process, although each holds some functions that it compiled and some
that another did. Where `fastmath` lets sums be reordered, that takes two things. Such a function, and each that calls
it from compiled code, has forceinline=True: otherwise the linker picks one of several copies, each optimised in
another surrounding. And it has no `**`: Numba compiles that once a process, as its first caller allows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys

Decorator = Callable[[Callable[..., Any]], Any]


def compiled(signature: Any, **options: Any) -> Decorator:
    """Decorator: the function compiled for `signature` alone, without Python's lock, divisions by 0 giving inf or NaN.

    For functions that Python calls, and no compiled one. options: further ones of Numba's njit.
    """
    return _decorator(signature, no_cfunc_wrapper=True, **options)


def compiled_part(signature: Any, **options: Any) -> Decorator:
    """As `compiled`, for functions that compiled ones alone call; Python's calls raise TypeError."""
    return _decorator(signature, no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)


def compiled_for_pointer(signature: Any, **options: Any) -> Decorator:
    """As `compiled`, for functions that compiled ones call through a pointer as well."""
    return _decorator(signature, **options)


def _decorator(signature: Any, **options: Any) -> Decorator:
    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = _from_cache(function, signature, options)
        if dispatcher.stats.cache_misses and options.get("no_cpython_wrapper"):
            # A part that was just compiled comes from the cache as well: linked into a caller it gives other machine
            # code than its cached form does, and where sums may be reordered, other last digits in the next process.
            dispatcher = _from_cache(function, signature, options)
        dispatcher.disable_compile()
        return dispatcher

    return decorate


def _from_cache(function: Callable[..., Any], signature: Any, options: dict[str, Any]) -> Any:
    """A dispatcher with the function of the cache, or with a new one that the cache then holds."""
    dispatcher = njit(nogil=True, error_model="numpy", **options)(function)
    dispatcher._cache = _KernelCache(function)
    if options.get("no_cpython_wrapper"):
        dispatcher._insert = _no_entry
    target = dispatcher.targetctx
    dispatcher.targetctx = _Linking(target)
    try:
        dispatcher.compile(signature)
    finally:
        dispatcher.targetctx = target
    return dispatcher


def _no_entry(types: Any, function: Any, objectmode: bool) -> None:
    """In place of Numba's table of what a call from Python may lead to: the way in was not compiled."""


class _KernelCache(FunctionCache):
    """Numba's cache of a function on disk, the same with and without asserts and docstrings (python -O, -OO).

    Numba tells functions of a file apart by line and name, and by their bytecode, where docstrings are counted as well.
    A kernel stands in its file alone, whose change of time or size empties the cache.
    """

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        signature, machine, (_, closure) = super()._index_key(sig, codegen)
        return signature, machine, closure


class _Linking:
    """Numba's target context, of which a cached function is asked for: refreshed, it has a runtime and nothing more."""

    def __init__(self, target: Any) -> None:
        self._target = target

    def refresh(self) -> None:
        rtsys.initialize(self._target)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._target, name)
