"""The one door through which files are read: ordinary files alone, no larger than their kind can be, decoded.

A pipe waits for ever, a device never ends, and a sparse file of two gigabytes takes one block on the disk: all three
are refused before a byte is read. How large a file may be its reader says, with the reason in words.
"""

from __future__ import annotations

import os
import secrets
import stat
from dataclasses import dataclass
from io import BufferedReader, BufferedWriter
from pathlib import Path

from calibrant.errors import InputError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_FOREIGN = (
    (b"\x80\x02", "a Python pickle"),
    (b"\x80\x03", "a Python pickle"),
    (b"\x80\x04", "a Python pickle"),
    (b"\x80\x05", "a Python pickle"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"\x89HDF\r\n", "an HDF5 file (or MATLAB 7.3)"),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word file"),
    (b"%PDF", "a PDF"),
    (b"#ROSBAG", "a ROS bag"),
    (b"SQLite format 3", "an SQLite database (a ROS 2 bag, perhaps)"),
    (b"\x89MCAP0", "an MCAP recording"),
    (b"PK\x03\x04", "a zip archive (an Excel file, perhaps)"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x93NUMPY", "NumPy's array file"),
)
_CURES = {
    "a Python pickle": "reading one can run any program, so that none is read: save the numbers instead, with "
    "numpy.save, numpy.savetxt or json.dump",
    "a MATLAB file": "write the numbers as text: writematrix(reshape(T, 16, [])', 'poses.csv')",
}
_NAME_KEPT = 100
"""Letters of a name in its draft's: systems hold 255 bytes."""
_PICKLES = (".pkl", ".pickle", ".p")


@dataclass(frozen=True)
class Most:
    """The largest size of a kind of file, bytes, and why no such file is larger."""

    size: int
    reason: str

    @property
    def words(self) -> str:
        """ "64 MB"."""
        return f"{self.size / 1e6:g} MB"


TEXT = Most(64_000_000, "a million poses as text")
"""Tables of numbers, JSON."""
DOCUMENT = Most(1_000_000, "YAML of this size takes ten seconds to read; save large tables as CSV or JSON")
"""YAML, which Python reads slowly."""
RESULT = Most(512_000_000, "some ten thousand photos of a large board")
PICTURE = Most(1_000_000_000, "raw pixels of a sensor of 150 megapixels in 16 bits and three colours")
ANY = Most(2**63 - 1, "")
"""What is passed through in parts, such as a video under its checksum."""


def open_file(path: str | Path, *, most: Most = ANY, what: str = "file") -> BufferedReader:
    """An ordinary file, open for reading.

    Args: most: how large it may be; what: its name in messages. Raises: InputError: it is not there, cannot be read, is
    a folder, a pipe or a device, or is larger.
    """
    try:
        # Opening a pipe waits for whoever writes into it, unless told not to.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise InputError(f"{what} {path} does not exist") from None
    except (OSError, ValueError) as error:
        # Windows opens no folders, and says that access is denied.
        reason = "it is a folder" if Path(str(path)).is_dir() else reason_of(error)
        raise InputError(f"{what} {path} cannot be read: {reason}") from None
    try:
        status = os.fstat(number)
        if not stat.S_ISREG(status.st_mode):
            kind = next((words for test, words in _KINDS if test(status.st_mode)), "no ordinary file")
            cure = "" if kind == "a folder" else "; write what it gives into a file first"
            raise InputError(f"{what} {path} cannot be read: it is {kind}, expected a file{cure}")
        if status.st_size > most.size:
            raise InputError(
                f"{what} {path} has {status.st_size / 1e6:,.0f} MB; expected {most.words} at most ({most.reason})"
            )
        return os.fdopen(number, "rb")
    except BaseException:
        os.close(number)
        raise


def read_bytes(path: str | Path, *, most: Most, what: str = "file") -> bytes:
    """The content of an ordinary file. Raises: InputError as `open_file`."""
    with open_file(path, most=most, what=what) as stream:
        try:
            data = stream.read(most.size + 1)
        except OSError as error:
            raise InputError(f"{what} {path} cannot be read: {reason_of(error)}") from None
    if len(data) > most.size:  # it grew since it was opened
        raise InputError(f"{what} {path} has more than {most.words} ({most.reason})")
    return data


def read_text(path: str | Path, *, most: Most = TEXT, what: str = "file", expected: str = "text") -> str:
    """The text of an ordinary file: UTF-8 or, where its mark says so, UTF-16.

    Args: expected: what would serve, for messages. Raises: InputError as `open_file`, and for what is no text, named
    where it is known.
    """
    return decoded(read_bytes(path, most=most, what=what), path, what=what, expected=expected)


def decoded(data: bytes, path: str | Path, *, what: str = "file", expected: str = "text", latin: bool = False) -> str:
    """Bytes as text. Args: latin: whether what is no UTF-8 is taken for Latin-1. Raises: InputError, as `read_text`."""
    known = foreign(data, path)
    if known is not None:
        raise InputError(f"{what} {path} is {known}; expected {expected}")
    try:
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            return data.decode("utf-16")
        if b"\0" in data:
            raise InputError(f"{what} {path} is a binary file; expected {expected}")
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if latin and not data.startswith((b"\xff\xfe", b"\xfe\xff")):
            # Spreadsheets of older systems keep their degree sign so.
            return data.decode("latin-1")
        raise InputError(
            f"{what} {path} cannot be read as text: byte {error.start} is no {error.encoding.upper()}; expected "
            f"{expected}"
        ) from None


def foreign(data: bytes, path: str | Path) -> str | None:
    """What a file is that belongs to another program, and what to do; None for all others."""
    name = next((words for mark, words in _FOREIGN if data.startswith(mark)), None)
    if name is None and Path(str(path)).suffix.lower() in _PICKLES:
        name = "a Python pickle"
    if name is None:
        return None
    return f"{name}: {_CURES[name]}" if name in _CURES else name


def draft(path: Path) -> tuple[Path, BufferedWriter]:
    """A new file beside a path, open for writing, with a name that nobody can foresee; to be moved there when whole.

    It is made, never opened: what stands there already, a link among it, is left alone. Raises: OSError.
    """
    while True:
        beside = path.with_name(f".{path.name[:_NAME_KEPT]}.{secrets.token_hex(8)}.tmp")
        try:
            return beside, open(beside, "xb")
        except FileExistsError:
            continue


def reason_of(error: Exception) -> str:
    """The system's reason, in small letters."""
    return error.strerror.lower() if isinstance(error, OSError) and error.strerror else str(error)
