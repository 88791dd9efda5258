"""The site's pages that are not in this folder: the reference, made from docstrings, and the README's kin.

mkdocs calls `on_config` and `on_files`; griffe, which reads the source without importing it, calls `HouseStyle`.
"""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path
from textwrap import dedent
from typing import Any

from griffe import Extension, Object
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import calibrant

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
SOURCE = ROOT / "src" / "calibrant"
TOLD = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changes.md": "CHANGELOG.md",
    "measurements.md": "benchmarks/README.md",
}
"""Pages that stand elsewhere in the repository, where people look for them first."""

HIDDEN = ("__main__", "cli", "compiled", "version")
"""What is no Python interface: the commands have their own page."""

SECTION = re.compile(r"^(Args|Arguments|Returns|Raises|Source|Example|Examples):(?= |$)", re.M)
DOCTEST = re.compile(r"(?:^ *>>> .*\n?(?:^ *(?!>>> ?)\S.*\n?)*)+", re.M)


class HouseStyle(Extension):
    """Docstrings here are prose: what begins with Args:, Raises: … gets a paragraph, what begins with >>> is code."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrites an object's docstring as Markdown."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(docstring: str) -> str:
    """The docstring as Markdown."""
    lines = [line if line.startswith("    ") else escaped(line) for line in docstring.splitlines()]
    text = DOCTEST.sub(lambda m: f"\n```python\n{dedent(m[0]).rstrip()}\n```\n", "\n".join(lines))
    return SECTION.sub(r"\n**\1:**", text)


def escaped(line: str) -> str:
    """A line of prose: brackets are no links, unless in backticks."""
    parts = line.split("`")
    return "`".join(part if k % 2 else part.replace("[", r"\[") for k, part in enumerate(parts))


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Puts the reference pages at the end of the contents."""
    assert config.nav is not None
    config.nav.append({"Python": [{name: f"reference/{name}.md"} for name in pages()]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the reference, one page a package and one of what `import calibrant as cb` gives, and the README's kin."""
    for name, text in pages().items():
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    for page, source in TOLD.items():
        files.append(File.generated(config, page, content=told(source)))
    return files


def told(source: str) -> str:
    """The text of a file of the repository with its links as they are on the site."""
    there = ROOT / source

    def link(match: re.Match[str]) -> str:
        path, sharp, anchor = match[1].partition("#")
        file = (there.parent / path).resolve()
        if "://" in match[1] or not path:
            return match[0]
        known = {(ROOT / s).resolve(): page for page, s in TOLD.items()} | {ROOT / "examples": "examples.md"}
        target = known.get(file) or (file.relative_to(DOCS).as_posix() if file.is_relative_to(DOCS) else path)
        return f"]({target}{sharp}{anchor})"

    return re.sub(r"\]\(([^)\s]+)\)", link, there.read_text(encoding="utf-8"))


def pages() -> dict[str, str]:
    """Markdown by the page's name."""
    out = {"calibrant": public_page()}
    for package in sorted(p for p in SOURCE.iterdir() if p.name not in HIDDEN and (p / "__init__.py").exists()):
        modules = [m for m in sorted(package.rglob("*.py")) if m.stem != "__init__" and not m.stem.startswith("_")]
        lines = [f"# {package.name}", "", first_line(package / "__init__.py"), ""]
        for module in modules:
            path = ".".join(("calibrant", *module.relative_to(SOURCE).with_suffix("").parts))
            lines += [f"::: {path}", ""]
        out[package.name] = "\n".join(lines)
    return out


def first_line(module: Path) -> str:
    """The first line of a module's docstring."""
    return (ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def public_page() -> str:
    """The page of `cb`: every public name. What is a command's verb says its options itself, when it is loaded."""
    lines = ["# import calibrant as cb", "", "The names that stay; each loads what it needs on first use.", ""]
    for name, (module, attribute) in calibrant._PUBLIC.items():
        if not attribute:
            lines += [f"## {name}", "", f"The modules of [{name}]({name}.md), loaded when they are named.", ""]
        elif module == "calibrant.tasks.verbs":
            lines += verb_section(name, getattr(calibrant, name))
        else:
            lines += [f"::: {module}.{attribute}", ""]
    return "\n".join(lines)


def verb_section(name: str, verb: Any) -> list[str]:
    """A command from Python: its signature, one argument a line, and its docstring."""
    said = inspect.signature(verb)
    arguments = []
    for parameter in said.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and "    *," not in arguments:
            arguments.append("    *,")
        arguments.append(f"    {parameter},".replace(f"'{parameter.annotation}'", str(parameter.annotation)))
    signature = ["```python", f"{name}(", *arguments, f") -> {said.return_annotation}", "```"]
    before, args, after = (inspect.getdoc(verb) or "").partition("Args:\n")
    listed = re.sub(r"^    (\w+): ", r"* **\1**: ", after, flags=re.M)
    return [f"## {name}", "", *signature, "", as_markdown(before), args, escaped(listed), ""]


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Links of a page in this folder to a file above it, as they are on the site."""
    for target, source in TOLD.items():
        markdown = markdown.replace(f"](../{source}", f"]({target}")
    return markdown
