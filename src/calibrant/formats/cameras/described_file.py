"""A camera, or several by name, under keys of any program's or one's own: what no other format has claimed."""

from __future__ import annotations

from calibrant.data import CalibrationResult
from calibrant.formats.cameras.described import described_cameras, is_described
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, read_cameras


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    return read_cameras(described_cameras(document.mapping, options.image_size, str(document.path)))


FORMAT = ExchangeFormat(
    name="described",
    title="named intrinsics (fx, fy, cx, cy or a matrix, terms of the lens by name)",
    suffix=".json",
    matches=lambda document: is_described(document.mapping),
    read=_read,
)
