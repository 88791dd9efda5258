"""Cameras, rigs and transforms from one program's file to another's: what is read, what is written, what is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import by_name
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Check
    from calibrant.formats.exchange.exchange_format import ExchangeFormat, WriteOptions

EXAMPLE = 'cb.convert("camchain.yaml", "camera.cameramodel", camera="cam0")'
OWN = "calibrant"


@dataclass(frozen=True, kw_only=True)
class SaidOptions:
    """What the files do not say themselves."""

    image_size: Annotated[str | None, Option("WxH")] = None
    """Size of the images, e.g. 1280x960, where the file does not hold it."""
    unit: Annotated[str | None, Option("mm|cm|m|…")] = None
    """Unit of the file's lengths, where it does not say it; and of those written, where the format leaves it open."""
    answer: Annotated[tuple[str, ...], Option("NAME=VALUE...")] = ()
    """What the format that is read asks beside these, e.g. index=1; its message names them."""
    choose: Annotated[tuple[str, ...], Option("NAME=VALUE...")] = ()
    """What the format that is written leaves open, e.g. world=left; docs/file-formats.md names them."""

    @property
    def unit_m(self) -> float | None:
        """Metres per unit. Raises: InputError for no unit of length."""
        from calibrant.targets.lengths import parse_length

        return None if self.unit is None else parse_length(f"1{self.unit}", what="--unit")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Convert cameras, rigs and transforms between the files of other programs.

    calibrant convert camchain.yaml rig.json
    calibrant convert rig.json left.cameramodel --camera left
    calibrant convert hand-eye.json camera.launch.py --to ros2-launch --transform gripper:camera

    What is in the file is found out from its content. Without OUT, prints what it holds. --to names the format; where
    the ending of OUT can be one format's alone, it is not needed. docs/file-formats.md lists them all.
    """

    source: Annotated[Path, Option("IN", positional=True)]
    """The file or folder to read."""
    target: Annotated[Path | None, Option("OUT", positional=True, output="either")] = None
    """The file or folder to write."""
    to: Annotated[str | None, Option("FORMAT")] = None
    """The format to write, by name."""
    read_as: Annotated[str | None, Option("FORMAT")] = None
    """The format to read, where the content alone is not to decide."""
    camera: Annotated[str | None, Option("NAME")] = None
    """The one camera to take of several."""
    transform: Annotated[str | None, Option("PARENT:CHILD")] = None
    """The one transform to write, for formats that hold one."""
    said: SaidOptions = SaidOptions()
    approximate: bool = False
    """Where the format has no such camera model, write the nearest that it has, and say by how much it differs."""


def reads(request: Request) -> list[Path]:
    """The file to read; of a folder none, since its formats choose."""
    return [] if request.source.is_dir() else [request.source]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """What the file holds, and the file of the other program.

    Raises: InputError for files that cannot be read, formats that cannot be told, and models that a format cannot say.
    """
    form = None if request.target is None else _format(request.target, request.to)
    found = _read(request)
    if form is None or request.target is None:
        return Outcome(result=found)
    sayable = _sayable(found, form, approximate=request.approximate)
    options = _write_options(request, request.target, form)
    return Outcome(result=sayable, documents=_documents(request.target, form, sayable, options))


def _read(request: Request) -> CalibrationResult:
    from calibrant.formats.exchange.exchange_format import ReadOptions
    from calibrant.formats.exchange.read import read_any
    from calibrant.tasks.pictures import size_of

    said = request.said
    options = ReadOptions(
        image_size=None if said.image_size is None else size_of(said.image_size),
        unit_m=said.unit_m,
        camera=request.camera,
        answers=by_name("--answer", said.answer),
    )
    found = read_any(request.source, options, form=request.read_as)
    if request.camera is None or len(found.cameras) == 1:
        return found
    if request.camera not in found.cameras:
        raise InputError(f"{request.source}: cameras {', '.join(found.cameras)}, none of them {request.camera!r}")
    return replace(found, cameras={request.camera: found.cameras[request.camera]})


def _format(target: Path, to: str | None) -> ExchangeFormat:
    """The format to write. Raises: InputError where neither --to nor the ending tells."""
    from calibrant.formats.exchange.registry import FORMATS, format_named

    if to is not None:
        form = format_named(to)
        if form.write is None:
            raise InputError(f"{form.title} is read, not written")
        return form
    written = [f for f in map(format_named, FORMATS) if f.write is not None and f.name != OWN]
    fitting = [f for f in written if f.suffix and target.name.lower().endswith(f.suffix)]
    longest = max((len(f.suffix) for f in fitting), default=0)
    fitting = [f for f in fitting if len(f.suffix) == longest]
    if target.suffix.lower() == ".json" and longest <= len(".json"):
        return format_named(OWN)
    if len(fitting) == 1:
        return fitting[0]
    listed = ", ".join(f.name for f in fitting or written)
    raise InputError(f"which format shall {target.name} have? Give --to with one of: {listed}")


def _sayable(result: CalibrationResult, form: ExchangeFormat, *, approximate: bool) -> CalibrationResult:
    """The result with cameras that the format has words for, and a check for each that had to be brought near.

    Raises: InputError where it has none and nothing was said of approximating.
    """
    from calibrant.cameras.approximation.nearest import in_words_of, nearest_of
    from calibrant.data.results import verdict_of

    cameras: dict[str, Camera] = {}
    checks: list[Check] = []
    for name, camera in result.cameras.items():
        same = in_words_of(camera, form.models, lacks=form.lacks) if form.models else camera
        if same is not None:
            cameras[name] = same
            continue
        found = nearest_of(camera, form.models, lacks=form.lacks)
        near = found.camera.model.name
        text = f"{found.rms_px:.3g} px RMS and {found.most_px:.3g} px at most over the image" + (
            f"; {100 * found.outside:.2g} % of the image lies outside of what it can show" if found.outside else ""
        )
        if not approximate:
            raise InputError(
                f"{form.title} has no {camera.model.name} camera {_with_terms(camera, form)}({name}); the nearest it "
                f"has, {near}, would be off by {text}. Take that with --approximate, or write another format"
            )
        cameras[name] = found.camera
        checks.append(_near_check(name, camera, near, found.rms_px, text))
    if not checks:
        return replace(result, cameras=cameras)
    said = (*result.checks, *checks)
    return replace(result, cameras=cameras, checks=said, verdict=verdict_of(said))


def _with_terms(camera: Camera, form: ExchangeFormat) -> str:
    """Which terms it is that the format has not, where it has the model but for these."""
    named = [name for name in form.lacks.get(camera.model.name, ()) if camera.parameters[name]]
    return f"with {', '.join(named)} " if camera.model.name in form.models and named else ""


def _near_check(name: str, camera: Camera, near: str, rms_px: float, text: str) -> Check:
    from calibrant.data import Check

    words = f"{name} is a {camera.model.name} camera, written as the nearest {near}: off by {text}"
    return Check(f"approximation of {name}", "warn", words, rms_px)


def _write_options(request: Request, target: Path, form: ExchangeFormat) -> WriteOptions:
    from calibrant.formats.exchange.exchange_format import WriteOptions

    pair = None
    if request.transform is not None:
        parent, colon, child = request.transform.partition(":")
        if not (parent and colon and child):
            raise InputError(f"--transform takes PARENT:CHILD, got {request.transform!r}")
        pair = (parent, child)
    said = request.said
    chosen = form.known_answers(by_name("--choose", said.choose), option="--choose")
    return WriteOptions(
        transform=pair,
        unit_m=said.unit_m,
        stem=target.name.partition(".")[0],
        approximate=request.approximate,
        answers=chosen,
    )


def _documents(
    target: Path, form: ExchangeFormat, result: CalibrationResult, options: WriteOptions
) -> tuple[Document, ...]:
    """The file, or the folder's files."""
    if form.write is None:
        raise InputError(f"{form.title} is read, not written")
    written = form.write(result, options)
    if isinstance(written, bytes):
        return (Document(target, written),)
    return tuple(Document(target / name, partial(bytes, content), target) for name, content in written.items())
