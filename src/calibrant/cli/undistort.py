"""`calibrant undistort`: photos as a camera without distortion would have taken them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o


def undistort(
    images: o.Images = None,
    camera: Annotated[
        Path | None,
        typer.Option("--camera", "-c", metavar="FILE", help="The camera that took them.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="DIR", show_default=False,
            help="Write the pictures here, under their own names, with camera.json, the camera they then are of.",
        ),
    ] = None,
    alpha: Annotated[
        float | None,
        typer.Option(
            "--alpha", metavar="0..1", show_default=False,
            help="0: no pixel without a source; 1: every source pixel is shown; between: as OpenCV.",
        ),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="FILE", help="Make pictures of this camera.", show_default=False),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option("--size", metavar="WxH", help="Size of the pictures, e.g. 1280x960.", show_default=False),
    ] = None,
    focal: Annotated[
        str | None,
        typer.Option("--focal", metavar="PX", help="Their focal length, e.g. 800px.", show_default=False),
    ] = None,
    maps: Annotated[
        Path | None,
        typer.Option(
            "--maps", metavar="FILE", show_default=False,
            help="Write the maps for cv2.remap: .npz, or .yml or .yml.gz in OpenCV's format.",
        ),
    ] = None,
    mirror_x: o.MirrorX = False,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Undistort photos.

    calibrant undistort photos/*.jpg --camera camera.json --out straight --alpha 0

    Without --alpha, --to, --size or --focal the pictures keep the camera's size and its scale at the axis. 16 bits stay
    16 bits. Prints which part of the pictures has no source.
    """
    from calibrant.tasks.cameras import undistort as undistort_run

    undistort_run.run(
        undistort_run.Request(
            images=tuple(images or ()),
            camera=camera,
            out=out,
            output=undistort_run.OutputChoice(alpha, to, size, focal),
            maps=maps,
            mirror_x=mirror_x,
            json=json,
            quiet=quiet,
            force=force,
        )
    )
