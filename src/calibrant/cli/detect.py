"""`calibrant detect`: find a board in photos, and say where it was not found and why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.cli import options as o
from calibrant.errors import InputError

if TYPE_CHECKING:
    from rich.text import Text

    from calibrant.data import CalibrationResult, Observations, View


def detect(
    images: o.Images = None,
    target: o.Target = None,
    mirror_x: o.MirrorX = False,
    exclude: o.Exclude = None,
    refine: o.Refine = "saddle",
    window: o.Window = None,
    zero_zone: o.ZeroZone = None,
    workers: o.Workers = None,
    cache: o.Cache = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Write the observations file (JSON) here.", show_default=False
        ),
    ] = None,
    overlays: Annotated[
        Path | None,
        typer.Option(
            "--overlays",
            metavar="DIR",
            help="Draw what was found over each photo, into this folder.",
            show_default=False,
        ),
    ] = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:
    """Find a board in photos, point by point.

    calibrant detect photos/*.jpg --target chessboard:9x6:25mm --out observations.json --overlays seen

    Prints how many points each photo shows, or why none. The file goes to --observations of other commands.
    """
    from calibrant.cli import session
    from calibrant.tasks.inputs.sources import Source

    outputs = session.Outputs(out=out, json=json, quiet=quiet, force=force)
    outputs.check()
    how = o.refinement(refine, window, zero_zone)
    source = Source(
        tuple(images or ()), target, None, o.split_names(exclude), mirror_x, workers, quiet or json, cache, how
    )
    files = source.files()
    outputs.spare(source.inputs(files))
    _check_folder(overlays)
    found = source.read(files)
    pictures = {} if overlays is None else _pictures(found, overlays)
    for path in pictures:
        if path.exists() and not force:
            raise InputError(f"{path} exists already; give another folder, or --force to replace it")
    if not quiet and not json:
        from rich.console import Console

        console = Console()
        console.print(table(found), soft_wrap=True)
        for note in found.notes:
            console.print(f"\n{note}", markup=False, highlight=False)
    result = _result(found, session.file_records(source.inputs(files)), mirror_x=mirror_x)
    if out is not None:
        result.write(out, force=force)
    if overlays is not None:
        overlays.mkdir(exist_ok=True)
    for path, view in pictures.items():
        session.write_bytes(path, _drawn(view, mirror_x=mirror_x))
    if json:
        from calibrant.data.result_file import result_text

        typer.echo(result_text(result))
    elif not quiet and (out or pictures):
        drawn = [f"{len(pictures)} pictures in {overlays}"] if pictures else []
        typer.echo(f"\nWritten: {', '.join([*([str(out)] if out else []), *drawn])}")


def table(found: Observations) -> Text:
    """Every photo in the order of its name: how many points of how many, or the reason why there are none."""
    from rich.cells import cell_len
    from rich.text import Text

    from calibrant.formats.poses.natural_order import natural_key

    total = _total(found)
    rows = {v.id: (f"{len(v)} of {total}", _noise(v), "found", "") for v in found.views}
    rows |= {m.id: ("0", "", f"not found: {m.reason}", "red") for m in found.missed}
    # One text: a table of Rich's own takes a millisecond a row, longer than to read what was found before.
    out = Text()
    out.append(f"{found.target}: found in {len(found.views)} of {len(rows)} photos\n\n", "bold")
    name_width = max(len("photo"), *(cell_len(name) for name in rows))
    count_width = max(len("points"), *(len(count) for count, *_ in rows.values()))
    out.append(f"{'photo':{name_width}}  {'points':>{count_width}}  {'1σ px':>7}\n", "dim")
    for name in sorted(rows, key=natural_key):
        count, noise, words, style = rows[name]
        out.append(f"{name}{' ' * (name_width - cell_len(name))}  {count:>{count_width}}  {noise:>7}  ")
        out.append(f"{words}\n", style)
    out.rstrip()
    return out


def _total(found: Observations) -> int:
    """How many points the target has; of own points, whose files are all that is known, how many were seen at all."""
    from calibrant.targets.point_folder import PointFolder
    from calibrant.targets.registry import parse_target

    target = parse_target(found.target) if found.target else None
    if target is None or isinstance(target, PointFolder):
        return len({label for view in found.views for label in view.point_ids.tolist()})
    return len(target.points)


def _noise(view: View) -> str:
    """The median of the detector's own sigma, where it states one."""
    if view.sigma_px is None:
        return ""
    ordered = sorted(view.sigma_px.tolist())
    return f"{ordered[len(ordered) // 2]:.2g}"


def _check_folder(folder: Path | None) -> None:
    """Raises: InputError when the pictures cannot go there."""
    if folder is None or folder.is_dir():
        return
    if folder.exists():
        raise InputError(f"--overlays {folder} is a file; give a folder")
    if not folder.parent.is_dir():
        raise InputError(f"--overlays {folder}: there is no folder {folder.parent}; make it first")


def _pictures(found: Observations, folder: Path) -> dict[Path, View]:
    """File of each view's picture; folders in a view's name, which tell photos of one name apart, become part of it."""
    return {folder / (view.id.replace("/", "_") + ".png"): view for view in found.views}


def _drawn(view: View, *, mirror_x: bool) -> bytes:
    from calibrant.detection.images.images import load_grey
    from calibrant.detection.images.overlay import draw
    from calibrant.opencv import cv2

    image = load_grey(view.file or view.id)
    return bytes(cv2.imencode(".png", draw(image[:, ::-1] if mirror_x else image, view))[1])


def _result(found: Observations, inputs: tuple[dict[str, str], ...], *, mirror_x: bool) -> CalibrationResult:
    """The content of an observations file."""
    from calibrant.cli import session
    from calibrant.data import CalibrationResult, ViewResult
    from calibrant.data.verdicts import stamp

    views = tuple(ViewResult(v.id, True, len(v), camera=v.camera) for v in found.views)
    options = {"mirror_x": True} if mirror_x else {}
    result = CalibrationResult("observations", "ok", views=views, options=options, inputs=inputs, observations=found)
    return stamp(session.with_misses(result))
