"""Poses in NumPy's files: .npy holds a stack, .npz one stack, or one of the robot's poses and one of the target's."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from calibrant.errors import InputError

ARRAYS = (".npy", ".npz")


def read_arrays(path: Path) -> Any:
    """The file as lists, as a JSON document would hold it: poses, or one entry a pose with the arrays' names as keys.

    Raises: InputError for a file that is no NumPy file, holds objects, or arrays that are no poses.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
        arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read {path} as NumPy's arrays of numbers: {error}") from error
    for name, array in arrays.items():
        what = f"{path}: the array {name!r}" if name else f"{path}: its array"
        if array.dtype.kind not in "fiu":
            raise InputError(f"{what} holds {array.dtype}, expected numbers")
        if array.ndim not in (2, 3) or not array.size:
            raise InputError(
                f"{what} has the shape {array.shape}; expected (n, 4, 4) or (n, 3, 4) matrices, or n rows of 6, 7, 12 "
                "or 16 numbers"
            )
    if len(arrays) == 1:
        name, array = next(iter(arrays.items()))
        return {name: array.tolist()} if name else array.tolist()
    lengths = {len(a) for a in arrays.values()}
    if len(lengths) != 1:
        listed = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise InputError(f"{path}: arrays of different lengths ({listed}); expected one entry a pose in each")
    return [{name: a[i].tolist() for name, a in arrays.items()} for i in range(lengths.pop())]
