"""Where a command's results go, and how much it says: the options that every command has beside its Request."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.fields import Field, spread
from calibrant.tasks.options.option import Option
from calibrant.tasks.registry import Entry
from calibrant.tasks.writing import check_folder, check_spared, check_writable


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Files that a result goes to, and the words of the terminal."""

    out: Annotated[Path | None, Option("FILE", "-o", output="file")] = None
    """Write the result file (JSON) here."""
    report: Annotated[Path | None, Option("FILE.html", output="file")] = None
    """Write a report here: .html, or .pdf."""
    json: bool = False
    """Print the result (JSON) on standard output, nothing else."""
    verbose: Annotated[bool, Option(short="-v")] = False
    """Show all: the checks that passed, the methods beside the result, transforms as matrices."""
    quiet: Annotated[bool, Option(short="-q")] = False
    """Print nothing but warnings and errors."""
    strict: bool = False
    """Exit status 1 where anything warns, as for a refused result; files are written all the same."""
    force: bool = False
    """Replace existing output files."""
    debug: bool = False
    """Show the traceback of an error."""

    @property
    def silent(self) -> bool:
        """Whether nothing but the result, or nothing at all, is printed."""
        return self.quiet or self.json


def output_fields(entry: Entry) -> tuple[Field, ...]:
    """The options of OutputOptions that a command has."""
    some = {"out", "report", "json", *_JUDGED}
    has = {*entry.outputs, *(_JUDGED if entry.judged else ())}
    return tuple(f for f in spread(OutputOptions) if f.name not in some or f.name in has)


_JUDGED = ("verbose", "strict")
"""Options of commands whose answer has a verdict."""


@dataclass(frozen=True)
class Places:
    """Every file and folder that a command will write, by the option that names it."""

    files: tuple[tuple[str, Path], ...] = ()
    folders: tuple[tuple[str, Path], ...] = ()

    def check(self, *, force: bool) -> None:
        """Refuse outputs that cannot be written before any work is done. Raises: InputError naming the path."""
        seen: set[Path] = set()
        for _, path in self.files:
            check_writable(path, force=force)
            if path.resolve() in seen:
                raise InputError(f"two outputs would be written to {path}; give each a name of its own")
            seen.add(path.resolve())
        for flag, path in self.folders:
            check_folder(path, option=flag)

    def spare(self, inputs: Iterable[str | Path]) -> None:
        """Refuse to write over a file that is read, even with --force. Raises: InputError naming it."""
        check_spared((path for _, path in self.files), inputs)


def places_of(fields: Iterable[Field], values: dict[str, object], beside: str | None) -> Places:
    """The outputs that the values name. Args: beside: the name of a file that goes along with the result file."""
    named = [(f, Path(str(values[f.name]))) for f in fields if f.option.output and values.get(f.name) is not None]
    files = [(f.flag, path) for f, path in named if f.option.output == "file"]
    if beside is not None and values.get("out") is not None and "--opencv-yaml" not in dict(files):
        files.append(("--out", beside_of(Path(str(values["out"])), beside, force=bool(values.get("force")))))
    return Places(tuple(files), tuple((f.flag, path) for f, path in named if f.option.output == "folder"))


def beside_of(out: Path, name: str, *, force: bool) -> Path:
    """`name` in the folder of the result; where another result's stands there, with the result's name in front."""
    shared, own = out.parent / name, out.parent / f"{out.stem}-{name}"
    return own if own.exists() or (shared.exists() and not force) else shared
