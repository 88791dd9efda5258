"""Makers' libraries, which the extra `devices` installs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from calibrant.errors import MissingExtraError


def makers_library(module: str, *, package: str, what: str) -> Any:
    """The module. Args: package: its name for pip; what: it is needed for. Raises: MissingExtraError with the extra."""
    try:
        return import_module(module)
    except ImportError as error:
        found = "is not installed" if isinstance(error, ModuleNotFoundError) else f"cannot be loaded ({error})"
        raise MissingExtraError(
            f'{what} is driven by {package}, which {found}: pip install "calibrant[devices]", or {package} alone'
        ) from None
