"""YAML files that people write by hand: targets, robots' tables, what stands in the way. PyYAML, with bounds.

An alias repeats what its anchor names, and ten lines of them unfold into more than a computer holds; such a file needs
none. Neither is it larger than `LARGEST`: PyYAML takes some ten seconds for a megabyte.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from calibrant.errors import InputError

LARGEST = 500_000
"""Characters, some five thousand markers."""


def read_yaml(path: Path, *, what: str = "target file") -> Any:
    """What a file holds. Raises: InputError naming the file, and the line that cannot be read."""
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{what} {path} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{what} {path} cannot be read as text: {error}") from None
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from None


def parse_yaml(text: str) -> Any:
    """Mappings, lists and scalars of a YAML text. Raises: InputError naming the line that cannot be read."""
    import yaml

    class Loader(yaml.SafeLoader):
        """PyYAML's, without aliases, and with 1e-3 a number as in YAML 1.2 (PyYAML asks for 1.0e-3)."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                line = self.peek_event().start_mark.line + 1
                raise InputError(f"line {line}: an alias (*name) is not read; write out what it stands for")
            return super().compose_node(parent, index)

    number = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+.0123456789"))
    if len(text) > LARGEST:
        raise InputError(f"it has {len(text)} characters; such a file has {LARGEST} at most")
    try:
        return yaml.load(text, Loader=Loader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        cure = "; indent with spaces, not tabs" if "\\t" in str(error.problem) else ""
        raise InputError(f"line {line}: {error.problem}{cure}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(" ".join(str(error).split())) from None
    except RecursionError:
        raise InputError("its lists and mappings lie too deep in each other") from None
