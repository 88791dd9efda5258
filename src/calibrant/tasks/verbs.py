"""The same work from Python: each task of the registry as a function, whose arguments are the options of its Request.

    import calibrant as cb
    result = cb.intrinsics("photos/*.jpg", target="chessboard:9x6:25mm", model="brown")

The verdict, the checks and every number are those of the command with the same options. `verbs.pyi` beside this file
tells type checkers the signatures; `signatures.py` writes it.
"""

from __future__ import annotations

import inspect
import textwrap
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrant import advice
from calibrant.errors import CalibrantError
from calibrant.tasks.options.fields import Field, build, spread
from calibrant.tasks.registry import TASKS, Entry, Task, reads_of, run_task
from calibrant.tasks.writing import check_folder, check_spared, check_writable, write_documents

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult
    from calibrant.tasks.outcome import Outcome

VERBS = {name.replace("-", "_").replace(" ", "_"): name for name in TASKS}
"""The command that each verb runs."""


def __getattr__(name: str) -> Any:
    if name not in VERBS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(VERBS)}")
    return verb(name)


@cache
def verb(name: str) -> Callable[..., CalibrationResult | None]:
    """The function that runs a command's task. Args: name: one of VERBS."""
    entry = TASKS[VERBS[name]]
    task = entry.load()
    signature = signature_of(task)

    def run(*args: Any, **kwargs: Any) -> CalibrationResult | None:
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{name}(): {error}; see help(calibrant.{name})") from None
        values = dict(bound.arguments)
        force = bool(values.pop("force", False))
        return _run(task, values, force=force)

    run.__name__ = run.__qualname__ = name
    run.__module__ = "calibrant"
    run.__doc__ = documentation(name, entry, task)
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    return run


def _run(task: Task, values: Mapping[str, Any], *, force: bool) -> Any:
    """The task's result; what was asked for by name is written, all or none of it."""
    try:
        outcome = _outcome(task, values, force=force)
    except CalibrantError as error:
        error.args = (in_python(str(error), task),)
        raise
    for text in outcome.warnings:
        warnings.warn(in_python(text, task), stacklevel=3)
    if outcome.result is None and outcome.refusal is not None:
        raise outcome.refusal
    return outcome.result if outcome.answer is None else outcome.answer.value


def _outcome(task: Task, values: Mapping[str, Any], *, force: bool) -> Outcome:
    """The task's outcome, its documents written."""
    from calibrant.tasks.listener import SILENT

    request = build(task.Request, values)
    named = {
        f: Path(values[f.name]) for f in spread(task.Request) if f.option.output and values.get(f.name) is not None
    }
    places = {f: path for f, path in named.items() if f.option.output in ("file", "folder")}
    check_spared(places.values(), reads_of(task, request))
    for field, path in places.items():
        if field.option.output == "file":
            check_writable(path, force=force)
        else:
            check_folder(path, option=field.name)
    outcome = run_task(task, request, SILENT)
    write_documents(outcome.documents, force=force)
    return outcome


def in_python(message: str, task: Task) -> str:
    """A message of the command in the words of its verb: what is --pose-units there is the argument pose_units here."""
    names = {field.flag: field.name for field in spread(task.Request)} | {"--force": "force=True"}
    return advice.in_python(message, names)


def signature_of(task: Task) -> inspect.Signature:
    """The options as arguments: what is positional on the command line first, all others by name."""
    fields = sorted(spread(task.Request), key=lambda f: not f.option.positional)
    parameters = [_argument(field) for field in fields]
    if any(f.option.output for f in fields):
        by_name = inspect.Parameter.KEYWORD_ONLY
        parameters.append(inspect.Parameter("force", by_name, default=False, annotation="bool"))
    return inspect.Signature(parameters, return_annotation="CalibrationResult")


def _argument(field: Field) -> inspect.Parameter:
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if field.option.positional else inspect.Parameter.KEYWORD_ONLY
    default = inspect.Parameter.empty if field.required else field.default
    return inspect.Parameter(field.name, kind, default=default, annotation=annotation_of(field))


def annotation_of(field: Field) -> str:
    """An argument's type in words: paths and texts stand for each other, one value for many."""
    text = str(field.kind) if not isinstance(field.kind, type) else field.kind.__name__
    if field.many:
        return "Words"
    text = text.replace("pathlib.Path", "Path").replace("typing.", "")
    return text.replace("Path", "str | Path") if "Path" in text else text


def documentation(name: str, entry: Entry, task: Task) -> str:
    """A verb's docstring: what the command's help says, with the arguments and an example in Python."""
    paragraphs = (inspect.getdoc(task.Request) or "").split("\n\n")
    paragraphs = [p for p in paragraphs if not p.lstrip().startswith("calibrant ")]
    said = "\n".join(
        textwrap.fill(f"{f.name}: {f.help}", 112, initial_indent="    ", subsequent_indent="        ")
        for f in sorted(spread(task.Request), key=lambda f: not f.option.positional)
    )
    paragraphs += [
        f"    >>> import calibrant as cb\n    >>> result = {task.EXAMPLE}",
        f"The same as `calibrant {VERBS[name]}` with these options: verdict, checks and numbers are equal.",
        f"Args:\n{said}",
        "Raises: InputError for what cannot be used; RefusedError, with the result, for what failed its own checks.",
    ]
    return "\n\n".join(paragraphs)
