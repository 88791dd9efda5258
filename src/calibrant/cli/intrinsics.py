"""`calibrant intrinsics`: calibrate a camera from photos of a board."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from calibrant.cli import options as o

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations


def intrinsics(
    images: o.Images = None,
    target: o.Target = None,
    observations: o.ObservationsFile = None,
    model: o.Model = "brown",
    fix: o.Fix = None,
    initial: Annotated[
        Path | None,
        typer.Option("--initial", metavar="FILE", help="Start from this camera file (any format).", show_default=False),
    ] = None,
    mirror_x: o.MirrorX = False,
    max_error: Annotated[
        str | None,
        typer.Option(
            "--max-error", metavar="PX", show_default=False,
            help="Leave out points with a larger error, e.g. 1.0px, and calibrate again.",
        ),
    ] = None,
    target_shape: Annotated[
        str,
        typer.Option(
            "--target-shape", metavar="flat|paraboloid|free",
            help="Estimate the board's own shape with the camera: its bend, or every point.",
        ),
    ] = "flat",
    exclude: o.Exclude = None,
    refine: o.Refine = "saddle",
    window: o.Window = None,
    zero_zone: o.ZeroZone = None,
    workers: o.Workers = None,
    cache: o.Cache = None,
    out: o.Out = None,
    opencv_yaml: Annotated[
        Path | None,
        typer.Option(
            "--opencv-yaml", metavar="FILE.yml", show_default=False,
            help="Write the camera in OpenCV's format here; with --out, without this: Intr.yml beside it "
            "(left-Intr.yml beside left.json, where there is an Intr.yml already).",
        ),
    ] = None,
    report: o.Report = None,
    json: o.Json = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Calibrate a camera from photos of a printed board.

    calibrant intrinsics photos/*.jpg --target chessboard:9x6:25mm --out camera.json --report camera.html

    Prints every parameter with its 1 and 3 sigma, each photo's error, and what was left out and why.
    """
    from calibrant.cli import session
    from calibrant.tasks.inputs.sources import Source

    opencv = opencv_yaml if opencv_yaml is not None else (_opencv_beside(out, force) if out is not None else None)
    outputs = session.Outputs(out, report, json, quiet, force, opencv)
    outputs.check()
    limit = o.pixels(max_error, option="--max-error")
    how = o.refinement(refine, window, zero_zone)
    source = Source(
        tuple(images or ()), target, observations, o.split_names(exclude), mirror_x, workers, quiet or json, cache, how
    )
    files = source.files()
    inputs = [*source.inputs(files), *([initial] if initial else [])]
    outputs.spare(inputs)
    found = source.read(files)
    session.load_solver(quiet=quiet or json)

    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
    from calibrant.diagnose.review import review
    from calibrant.formats.cameras.opencv import is_opencvs
    from calibrant.formats.cameras.read import read_camera

    size = next(iter(found.image_sizes.values()))
    start = None if initial is None else read_camera(initial, image_size=size)

    def calibrated(points: Observations) -> CalibrationResult:
        return calibrate_intrinsics(
            points, model=model, fix=o.split_names(fix), initial=start, max_error_px=limit, target_shape=target_shape
        )

    with session.explain_refusal(outputs):
        result = calibrated(found)
        more = source.look_again(found, result.camera)
        result = result if more is found else calibrated(more)
        if opencv_yaml is None and not is_opencvs(result.camera):
            outputs = replace(outputs, opencv=None)  # Intr.yml goes along with --out only where OpenCV has the model
        if mirror_x:
            result = replace(result, options={**result.options, "mirror_x": True})
        result = replace(result, inputs=session.file_records(inputs))
        session.finish(review(session.with_misses(result)), outputs)


def _opencv_beside(out: Path, force: bool) -> Path:
    """Intr.yml in the folder of the result; where another camera's stands there, with the result's name in front."""
    shared, own = out.parent / "Intr.yml", out.parent / f"{out.stem}-Intr.yml"
    return own if own.exists() or (shared.exists() and not force) else shared
