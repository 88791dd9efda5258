"""What a field of a Request says of itself beyond its name, type and help."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """Written in the annotation: `Annotated[Path | None, Option("FILE")]`.

    metavar: what its value is called in help; short: its short form, "-t"; positional: given without a name;
    names: its values are parameters' names, so that a word that can be none ends them; output: "file" or "folder" for
    one that is written, "either" for one that is the file of one picture or the folder of several; choices: words that
    a shell offers, though others may be taken.
    """

    metavar: str = ""
    short: str = ""
    positional: bool = False
    names: bool = False
    output: str = ""
    choices: tuple[str, ...] = ()
