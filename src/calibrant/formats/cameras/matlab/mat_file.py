"""MATLAB's .mat files of versions 5 to 7 as plain data, nothing taken on trust.

Every length in such a file is checked against the bytes that are there before anything is made of it, compressed parts
against a limit: SciPy's reader allocates what the header promises. Source: The MathWorks, "MAT-File Format", level 5.
Arrays come as float64, text as str, a struct as a mapping (a list of them for more than one), a cell as a list.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError

MARK, MARK_73 = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
CURE_73 = "this is a MATLAB 7.3 file (HDF5), which is not read: save it with save('camera.mat', …, '-v7')"
CURE_OBJECT = (
    "is saved as an object, whose content MATLAB alone can read: save it as a struct, s = toStruct({0}); "
    "save('camera.mat', 's', '-v7')"
)
_HEADER = 128
_MOST = 128_000_000
"""Bytes after decompression: far more than any calibration, pictures of all boards among it."""
_DEEPEST = 16
_MATRIX, _COMPRESSED = 14, 15
_TYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
    16: "u1",
    17: "u2",
    18: "u4",
}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = range(6, 16)


class Opaque:
    """An object of a class of MATLAB's: what it holds stands elsewhere, undocumented."""


class _Reader:
    """Elements of one byte order."""

    def __init__(self, order: str) -> None:
        self.order = order

    def elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Type and content of each. Raises: InputError where one ends beyond the data."""
        at = 0
        while at + 8 <= len(data):
            first, second = (int(n) for n in np.frombuffer(data[at : at + 8], self.order + "u4"))
            if first >> 16:  # four bytes or fewer stand in the tag itself
                kind, size, start, step = first & 0xFFFF, first >> 16, at + 4, 8
            else:
                kind, size, start = first, second, at + 8
                step = 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
            if start + size > len(data) or (first >> 16 and size > 4):
                raise InputError("the .mat file ends in the middle of a variable, or is damaged")
            yield kind, data[start : start + size]
            at += step

    def numbers(self, kind: int, data: memoryview) -> Array:
        if kind not in _TYPES:
            raise InputError(f"the .mat file holds numbers of an unknown type {kind}")
        form = np.dtype(self.order + _TYPES[kind])
        if len(data) % form.itemsize:
            raise InputError("the .mat file holds half a number")
        return np.frombuffer(data, form).astype(np.float64)

    def matrix(self, data: memoryview, depth: int = 0) -> tuple[str, Any]:
        """Name and value of a variable, or of a field. Raises: InputError for what is damaged."""
        if depth > _DEEPEST:
            raise InputError(f"the .mat file nests structs more than {_DEEPEST} deep")
        if not len(data):
            return "", np.zeros((0, 0))
        parts = list(self.elements(data))
        if len(parts) < 3 or len(parts[0][1]) < 4:
            raise InputError("the .mat file holds a variable without type, size and name")
        group = int(np.frombuffer(parts[0][1][:4], self.order + "u4")[0]) & 0xFF
        if group in (_OPAQUE, _FUNCTION):
            return bytes(parts[1][1]).decode("latin-1"), Opaque()
        shape = tuple(int(n) for n in self.numbers(*parts[1]))
        name = bytes(parts[2][1]).decode("latin-1")
        count = 1
        for n in shape:
            count *= n
        if min(shape, default=-1) < 0 or count > _MOST:
            raise InputError(f"{name or 'a field'} of the .mat file has the size {shape}")
        return name, self._value(group, shape, count, parts[3:], depth)

    def _value(
        self, group: int, shape: tuple[int, ...], count: int, parts: list[tuple[int, memoryview]], depth: int
    ) -> Any:
        if group in _NUMERIC or group == _CHAR:
            flat = self.numbers(*parts[0]) if parts else np.zeros(0)
            if group == _CHAR:
                return "".join(chr(int(n)) for n in flat)
            if len(flat) != count:
                raise InputError(f"the .mat file holds {len(flat)} numbers for an array of {count}")
            return flat.reshape(shape, order="F")
        if group in (_STRUCT, _OBJECT):
            return self._structs(count, parts[1:] if group == _OBJECT else parts, depth)
        if group == _CELL:
            if len(parts) != count:
                raise InputError(f"the .mat file holds {len(parts)} cells of {count}")
            return [self.matrix(content, depth + 1)[1] for _, content in parts]
        return Opaque()

    def _structs(self, count: int, parts: list[tuple[int, memoryview]], depth: int) -> Any:
        if len(parts) < 2 or len(parts[0][1]) < 4:
            raise InputError("the .mat file holds a struct without names of fields")
        length = int(np.frombuffer(parts[0][1][:4], self.order + "i4")[0])
        text = bytes(parts[1][1])
        if length < 1:
            raise InputError("the .mat file holds a struct whose fields have no names")
        names = [text[i : i + length].partition(b"\0")[0].decode("latin-1") for i in range(0, len(text), length)]
        values = parts[2:]
        if len(values) != count * len(names):
            raise InputError(f"the .mat file holds {len(values)} values for {count} structs of {len(names)} fields")
        out = [
            {name: self.matrix(content, depth + 1)[1] for name, (_, content) in zip(names, values[i:])}
            for i in range(0, len(values), len(names) or 1)
        ]
        return out[0] if count == 1 and out else out


def variables(data: bytes) -> Mapping[str, Any]:
    """The file's variables by name. Raises: InputError for another version, and for what is damaged."""
    if data.startswith(MARK_73):
        raise InputError(CURE_73)
    if len(data) < _HEADER or data[126:128] not in (b"IM", b"MI"):
        raise InputError("the header of a .mat file of version 5 to 7 was expected")
    reader = _Reader("<" if data[126:128] == b"IM" else ">")
    found: dict[str, Any] = {}
    room = _MOST
    for kind, content in reader.elements(memoryview(data)[_HEADER:]):
        if kind == _COMPRESSED:
            plain = _unpacked(content, room)
            room -= len(plain)
            inner = list(reader.elements(memoryview(plain)))
        else:
            inner = [(kind, content)]
        for of, body in inner:
            if of == _MATRIX:
                name, value = reader.matrix(body)
                if name:
                    found[name] = value
    return found


def _unpacked(content: memoryview, room: int) -> bytes:
    unpack = zlib.decompressobj()
    try:
        plain = unpack.decompress(content, max(1, room))
    except zlib.error as error:
        raise InputError(f"a compressed part of the .mat file is damaged ({error})") from None
    if unpack.unconsumed_tail:
        raise InputError(f"the .mat file unpacks to more than {_MOST / 1e6:g} MB; save the camera alone")
    return plain


def written(values: Mapping[str, Any]) -> bytes:
    """A .mat file of version 5 with these variables; mappings become structs."""
    import io

    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, dict(values), oned_as="row")  # type: ignore[arg-type]
    return stream.getvalue()
