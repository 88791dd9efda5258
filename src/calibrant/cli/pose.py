"""`calibrant pose`: where a target is, from photos by a calibrated camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o


def pose(
    images: o.Images = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", "-c", metavar="FILE", help="The camera that took them (any format).", show_default=False
        ),
    ] = None,
    target: o.Target = None,
    observations: o.ObservationsFile = None,
    sigma_px: Annotated[
        str | None,
        typer.Option(
            "--sigma-px", metavar="PX", show_default=False,
            help="Noise of a point per axis, e.g. 0.1px; else the detector's, or that of the residuals.",
        ),
    ] = None,
    confidence: Annotated[
        float, typer.Option("--confidence", metavar="P", help="From which probability two solutions are told apart.")
    ] = 0.99,
    mirror_x: o.MirrorX = False,
    exclude: o.Exclude = None,
    workers: o.Workers = None,
    cache: o.Cache = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            "--overlay", metavar="FILE.png", show_default=False,
            help="Draw the target's axes over the photo; of several photos, into this folder.",
        ),
    ] = None,
    out: o.Out = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Find where a target is: T_camera_target with its uncertainty in millimetres and degrees.

    calibrant pose photo.png --camera camera.json --target chessboard:9x6:25mm --overlay seen.png

    Both poses are given where the photo cannot tell them apart. The camera's own uncertainty counts, where its file
    has it.
    """
    from calibrant.cli import session
    from calibrant.cli.progress import listener
    from calibrant.errors import InputError
    from calibrant.tasks.cameras import pose as pose_run
    from calibrant.tasks.inputs.sources import Source
    from calibrant.tasks.options.images import SearchOptions

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    if camera is None:
        raise InputError(
            "a pose needs the camera that took the photo: --camera camera.json (calibrant intrinsics --out)"
        )
    noise = o.pixels(sigma_px, option="--sigma-px")
    search = SearchOptions(mirror_x=mirror_x, exclude=tuple(exclude or ()), workers=workers, cache=cache)
    source = Source(tuple(images or ()), target, observations, search, listener=listener(silent=quiet or json))
    files = source.files()
    inputs = [*source.inputs(files), camera]
    outputs.spare(inputs)
    found = source.read(files)
    pictures = pose_run.pictures(found, overlay, inputs, force=force)
    session.load_solver(quiet=quiet or json)

    from calibrant.calibrate.pose.estimate import estimate_poses
    from calibrant.formats.cameras.read import read_camera

    known = read_camera(camera, image_size=next(iter(found.image_sizes.values())))
    result = estimate_poses(known, found, sigma_px=noise, confidence=confidence)
    options = {**result.options, **({"mirror_x": True} if mirror_x else {})}
    result = session.with_misses(replace(result, options=options, inputs=session.file_records(inputs)))
    session.finish(result, outputs)
    pose_run.draw(result, pictures, mirror_x=mirror_x)
    if pictures and not (quiet or json):
        typer.echo(f"Drawn: {', '.join(str(p) for p in pictures.values())}")
