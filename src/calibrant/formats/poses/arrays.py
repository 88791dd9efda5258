"""Poses in NumPy's files: .npy holds a stack, .npz one stack, one of the robot's poses and one of the target's, a
matrix a pose under a name of its own, or a single pose in parts.

An archive of a kilobyte can unfold to gigabytes, and a header can promise any shape: both are looked at first.
"""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.reading.files import Most, foreign, read_bytes

ARRAYS = (".npy", ".npz")
MOST = Most(16_000_000, "a hundred thousand matrices")
"""Of numbers, once unfolded."""
_MEMBERS = 4096
"""An array a pose, the robot's and the target's, of two thousand poses."""
# What NumPy raises on headers that are none: it reads them as a Python literal.
_NO_HEADER = (
    *(ValueError, EOFError, TypeError, KeyError, SyntaxError, RecursionError, MemoryError, OverflowError),
    *(AttributeError, TokenError),
)
_ONE_POSE = ((3,), (3, 1), (1, 3), (4,), (4, 1), (1, 4), (3, 3), (9,))
_VECTORS = ((3,), (3, 1), (1, 3))
_MATRICES = ((4, 4), (3, 4))


def read_arrays(path: Path) -> Any:
    """The file as lists, as a JSON document would hold it: poses, one entry a pose with the arrays' names as keys, or
    single matrices by their names.

    Raises: InputError for a file that is no NumPy file, holds objects, or arrays that are no poses, or too many.
    """
    data = read_bytes(path, most=MOST, what="pose file")
    arrays = _members(data, path) if path.suffix.lower() == ".npz" or data[:4] == b"PK\x03\x04" else None
    if arrays is None:
        arrays = {"": _array(data, path, "its array")}
    for name, array in arrays.items():
        what = f"{path}: the array {name!r}" if name else f"{path}: its array"
        if array.dtype.kind not in "fiu":
            raise InputError(f"{what} holds {array.dtype}, expected numbers")
    if len(arrays) > 1 and _is_one_pose(arrays):
        return {
            name: array.tolist() if array.shape == (3, 3) else array.ravel().tolist() for name, array in arrays.items()
        }
    if len(arrays) > 1 and all(array.shape in _MATRICES for array in arrays.values()):
        return {name: array.tolist() for name, array in arrays.items()}
    # OpenCV's vectors are columns: (n, 3, 1) is (n, 3).
    arrays = {n: a[..., 0] if a.ndim == 3 and a.shape[2] == 1 else a for n, a in arrays.items()}
    for name, array in arrays.items():
        what = f"{path}: the array {name!r}" if name else f"{path}: its array"
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


def _is_one_pose(arrays: dict[str, NDArray[Any]]) -> bool:
    """Whether the arrays are the parts of a single pose, such as rvec and tvec, or R and t."""
    shapes = [array.shape for array in arrays.values()]
    return all(shape in _ONE_POSE for shape in shapes) and any(shape in _VECTORS for shape in shapes)


def _members(data: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive. Raises: InputError for one that unfolds to more than numbers of poses do."""
    out: dict[str, NDArray[Any]] = {}
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            size = sum(m.file_size for m in members)
            if len(members) > _MEMBERS or size > MOST.size:
                raise InputError(
                    f"{path}: unfolds to {len(members)} arrays of {size / 1e6:,.0f} MB; expected {_MEMBERS} arrays and "
                    f"{MOST.words} at most ({MOST.reason})"
                )
            for member in members:
                if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise InputError(f"{path}: an archive that NumPy did not write; save it again with numpy.savez")
                with archive.open(member) as stream:
                    content = stream.read(member.file_size)
                name = member.filename.removesuffix(".npy")
                out[name] = _array(content, path, f"the array {name[:40]!r}")
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise InputError(f"{path} cannot be read as NumPy's arrays of numbers: {error}") from error
    if not out:
        raise InputError(f"{path}: an archive without arrays")
    return out


def _array(data: bytes, path: Path, what: str) -> NDArray[Any]:
    """One array. Raises: InputError for objects, and a header that promises other than there is."""
    stream = BytesIO(data)
    try:
        version = npy.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"version {version} of the format")
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, fortran, dtype = read(stream)
    except _NO_HEADER as error:
        known = foreign(data, path)
        # What Python's parser says of a damaged header is no word to a person.
        said = error if isinstance(error, ValueError | EOFError) else "its header is damaged"
        words = known if known is not None and known != "NumPy's array file" else said
        raise InputError(f"{path} cannot be read as NumPy's arrays of numbers: {words}") from None
    if dtype.hasobject:
        raise InputError(
            f"{path}: {what} holds Python objects, a pickle, which can run any program when it is read; save numbers: "
            "numpy.save(file, numpy.array(poses, dtype=float))"
        )
    # A shape can have any number of digits; Python's integers hold it.
    count = 1
    for n in shape:
        count *= int(n)
    left = data[stream.tell() :]
    if count < 0 or count * dtype.itemsize != len(left):
        raise InputError(
            f"{path}: {what} has the shape {str(shape)[:60]}, {count * dtype.itemsize:,} bytes, and {len(left):,} are "
            "there; it was cut off, or its header is damaged"
        )
    try:
        return np.frombuffer(left, dtype=dtype, count=count).reshape(shape, order="F" if fortran else "C")
    except ValueError as error:
        raise InputError(f"{path} cannot be read as NumPy's arrays of numbers: {error}") from None
