"""Reading what any known program wrote: the format is found out from the content."""

from __future__ import annotations

from pathlib import Path

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions
from calibrant.formats.exchange.registry import FORMATS, format_named, formats_for
from calibrant.reading.files import open_file

DEFAULT = ReadOptions()
_SHOWN_KEYS = 8


def read_any(path: str | Path, options: ReadOptions = DEFAULT, *, form: str | None = None) -> CalibrationResult:
    """The cameras, places and views that a file or folder holds.

    Args: options: what the file does not say; form: the format's name, where the content alone is not to decide.
    Raises: InputError naming the file, what it holds, and which formats are read.
    """
    document = Document(Path(path))
    if not document.is_folder:
        open_file(document.path, what="file").close()
    try:
        found = format_of(document) if form is None else format_named(form)
        if found.read is None:
            raise InputError(f"{found.title} is written, not read")
        found.known_answers(options.answers)
        return found.read(document, options)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def format_of(document: Document) -> ExchangeFormat:
    """The first format whose marks are in the content. Raises: InputError where none is known."""
    for _, form in formats_for(document):
        if form.matches(document):
            return form
    raise InputError(_nothing_known(document))


def _nothing_known(document: Document) -> str:
    """What the document is instead, and what would be read."""
    names = ", ".join(name for name, line in FORMATS.items() if line.read)
    return f"{_what_it_is(document)}; formats read: {names}"


def _what_it_is(document: Document) -> str:
    if document.foreign is not None:
        return f"this is {document.foreign}; expected a camera in a file of a known format"
    if document.trouble is not None:
        return document.trouble
    if document.is_folder:
        listed = ", ".join(sorted(document.names)[:_SHOWN_KEYS]) or "nothing"
        return f"a folder with {listed}; expected a file, or a folder of a known format"
    if document.mapping:
        listed = ", ".join(repr(str(key)) for key in list(document.mapping)[:_SHOWN_KEYS])
        return f"no camera in it; its keys are {listed}"
    if document.text is None:
        return "a binary file; expected a camera in a file of a known format"
    if document.root is not None:
        return f"XML whose root is <{document.root.tag}>; expected a camera in a file of a known format"
    what = "a list" if isinstance(document.data, list) else "text" if document.text.strip() else "the file is empty"
    return f"{what}; expected keys and values that describe a camera"
