"""`calibrant vanishing`: the camera's rotation, and its focal length, from a scene's straight edges."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o


def vanishing(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="A photo of a building, a room, a machine.")],
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera", "-c", metavar="FILE", show_default=False,
            help="The camera (any format); without it: --focal unknown.",
        ),
    ] = None,
    focal: Annotated[
        str, typer.Option("--focal", metavar="known|unknown", help="unknown: find the focal length as well.")
    ] = "known",
    overlay: Annotated[
        Path | None,
        typer.Option(
            "--overlay", metavar="FILE.png", show_default=False,
            help="Draw the edges over the photo, coloured by direction.",
        ),
    ] = None,
    out: o.Out = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Find how a camera is turned against a scene of three orthogonal directions, from one photo.

    calibrant vanishing street.jpg --camera camera.json --overlay lines.png

    Prints the rotation camera -> scene (x right, y down, z ahead) with its uncertainty, how many edges follow each
    direction and where they meet, and how far from right angles the directions are. Without a camera the focal length
    is found too.
    """
    from calibrant.cli import session
    from calibrant.tasks.cameras import vanishing as vanishing_run

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    inputs = [image, *([camera] if camera is not None else [])]
    outputs.spare(inputs)
    if overlay is not None:
        session.check_writable(overlay, force=force)
        session.Outputs(overlay).spare(inputs)
        vanishing_run.check_picture(overlay)
    session.load_solver(quiet=quiet or json)
    found, result = vanishing_run.solved(image, camera, focal)
    session.finish(result, outputs)
    if overlay is not None:
        vanishing_run.draw(image, found, overlay)
        if not (quiet or json):
            typer.echo(f"Drawn: {overlay}")
