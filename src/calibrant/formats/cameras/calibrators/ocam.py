"""OCamCalib's calib_results.txt: Scaramuzza's polynomial lens, rows before columns.

    row, column = A (x, y) + centre,  A = [[c, d], [e, 1]],  ray = (x, y, a0 + a1 rho + a2 rho^2 + ...)

Lines: the polynomial with its count before it, its inverse (which follows from it), centre "row" and "column" from 0,
c d e, height and width. The axes are x down the rows, y along the columns and z towards the viewer; here they become
x right, y down, z ahead. Where c d e turn the image, which no lens here does, the camera's frame is turned about its
axis, and that is said: A = P R, P symmetric. What is written is the nearest polynomial. Source: OCamCalib's
exportData2TXT.m and undistortFunctions/ocam_functions.c.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.polynomial import polynomial_camera, polynomial_of
from calibrant.formats.cameras.camera_format import whole_size
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    one_camera,
    read_cameras,
)
from calibrant.reading.notes import note

_MOST = 20_000
"""Characters: five lines of numbers and what they are."""
_FLAT, _TURNED_DEG = 1e-6, 1e-4
"""A determinant below which a matrix has no inverse; a turn that moves no pixel of any image by a hundredth."""
_ROUGH_PX = 0.05
"""Above what good corners are found to: beyond it an approximation is one, and asked for."""
_SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])


def _lines(document: Document) -> list[Array]:
    """The lines of numbers; none where a line is something else."""
    text = document.text or ""
    if len(text) > _MOST:
        return []
    found = []
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                found.append(np.array([float(part) for part in line.split()]))
            except ValueError:
                return []
    return found


def _matches(document: Document) -> bool:
    lines = _lines(document)
    counted = len(lines) >= 2 and all(line[0] == len(line) - 1 > 2 for line in lines[:2])
    return "DIRECT mapping function" in (document.text or "")[:_MOST] or (counted and len(lines) in (5, 6))


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    lines = _lines(document)
    shape = [len(line) for line in lines[2:5]]
    if len(lines) < 5 or shape != [2, 3, 2] or lines[0][0] != len(lines[0]) - 1:
        raise InputError(
            f"lines of {[len(line) for line in lines]} numbers; expected the polynomial after its count, its inverse "
            "likewise, the centre (2), c d e (3), height and width (2)"
        )
    coefficients, centre, (c, d, e), size = lines[0][1:], lines[2], lines[3], whole_size(*lines[4][::-1])
    if not all(np.all(np.isfinite(line)) for line in lines):
        raise InputError("numbers that are not finite")
    if not 0 <= centre[0] < size[1] or not 0 <= centre[1] < size[0]:
        raise InputError(
            f"the centre, row {centre[0]:g} and column {centre[1]:g}, lies outside of {size[0]}x{size[1]} px"
        )
    # Rows and columns change places, in the image and in the camera.
    A = _unturned(_SWAP @ np.array([[c, d], [e, 1.0]]) @ _SWAP, str(document.path))
    camera = polynomial_camera(
        coefficients,
        A,
        centre[::-1],
        size=size,
        source=str(document.path),
        answers=options.answers,
    )
    return read_cameras({document.path.name.partition(".")[0] or "camera": camera})


def _unturned(A: Array, source: str) -> Array:
    """P of A = P R. Says by how much R turns."""
    if abs(np.linalg.det(A)) < _FLAT:
        return A
    U, s, Vt = np.linalg.svd(A)
    turn = float(np.degrees(np.arctan2(*(U @ Vt)[[1, 0], [0, 0]])))
    if abs(turn) > _TURNED_DEG:
        note(
            f"{source}: c, d and e turn the image by {turn:.3g} deg; the camera is read turned by as much about its "
            "optical axis against OCamCalib's frame"
        )
    return (U * s) @ U.T


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    name, camera = one_camera(result)
    lens = polynomial_of(camera)
    off = f"off by {lens.rms_px:.3g} px RMS and {lens.most_px:.3g} px at most over the image"
    if lens.unseen:
        off += f", of which {lens.unseen:.1%} has no rays"
    if lens.most_px > _ROUGH_PX and not options.approximate:
        raise InputError(
            f"{name} is a {camera.model.name} camera, and OCamCalib has polynomials alone; the nearest would be {off}. "
            "Take that with --approximate"
        )
    note(
        f"{name} is written as a polynomial of degree {len(lens.coefficients) - 1}, {off}; its inverse by another "
        f"{lens.inverse_px:.2g} px"
    )
    width, height = camera.image_size
    (c, d), (e, _) = _SWAP @ lens.A @ _SWAP
    blocks = {
        "polynomial coefficients for the DIRECT mapping function (ocam_model.ss)": _counted(lens.coefficients),
        "polynomial coefficients for the inverse mapping function (ocam_model.invpol)": _counted(lens.inverse),
        'center: "row" and "column", starting from 0': " ".join(text_of(lens.centre[::-1])),
        'affine parameters "c", "d", "e"': " ".join(text_of((c, d, e))),
        'image size: "height" and "width"': f"{height} {width}",
    }
    return "\n".join(f"#{words}\n\n{numbers}\n" for words, numbers in blocks.items()).encode()


def _counted(values: Array) -> str:
    return " ".join([str(len(values)), *text_of(values)])


FORMAT = ExchangeFormat(
    name="ocam",
    title="OCamCalib calib_results.txt",
    suffix=".txt",
    matches=_matches,
    read=_read,
    write=_write,
    asks=ASKS,
)
