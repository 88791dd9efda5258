"""Results of calibrant itself: nothing is lost."""

from __future__ import annotations

from calibrant.cameras import MODELS
from calibrant.cameras.splined import FAMILY
from calibrant.data import CalibrationResult
from calibrant.data.result_encoding import FORMAT as RESULT_FORMAT
from calibrant.data.result_file import read_result, result_text
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions


def is_result(document: Document) -> bool:
    """Whether it says so."""
    return str(document.mapping.get("format", "")).startswith(RESULT_FORMAT.partition("/")[0])


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    return read_result(document.path)


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    return (result_text(result) + "\n").encode()


FORMAT = ExchangeFormat(
    name="calibrant",
    title="calibrant result (JSON)",
    suffix=".json",
    matches=is_result,
    read=_read,
    write=_write,
    models=(*MODELS, FAMILY),
)
