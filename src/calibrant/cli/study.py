"""`calibrant study`: experiments to learn from. `methods` compares all ways to calibrate a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from calibrant.cli import options as o

app = typer.Typer(help="Experiments to learn from: what each method gives, and when it fails.", no_args_is_help=True)

OutJson = Annotated[
    Path | None,
    typer.Option("--out", "-o", metavar="FILE.json", help="Write every figure (JSON) here.", show_default=False),
]
ReportPage = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE.html", help="Write tables and curves (HTML) here.", show_default=False),
]
JsonFigures = Annotated[bool, typer.Option("--json", help="Print every figure (JSON) on standard output.")]
MOST_NOISE_PX = 50.0
"""Beyond it, points 30 mm apart change places."""


@app.callback()
def study() -> None:
    """Experiments to learn from: what each method gives, and when it fails."""


@app.command("methods")
def methods(
    images: o.Images = None,
    target: o.Target = None,
    observations: o.ObservationsFile = None,
    noise: Annotated[str, typer.Option("--noise", metavar="PX", help="Noise of the simulated points, per axis.")]
    = "0.1px",
    points: Annotated[int, typer.Option("--points", metavar="N", help="Points of the simulated targets, about.")] = 63,
    views: Annotated[int, typer.Option("--views", metavar="N", help="Simulated views.")] = 6,
    lens: Annotated[
        str, typer.Option("--lens", metavar="MODEL:TERM", help="True lens: pinhole, brown:-0.1, division:-0.1 ...")
    ] = "brown:-0.1",
    trials: Annotated[
        int, typer.Option("--trials", metavar="N", help="Scenes for each value of what makes methods fail; 0: none.")
    ] = 5,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Another seed draws other scenes.")] = 0,
    workers: o.Workers = None,
    cache: o.Cache = None,
    out: OutJson = None,
    report: ReportPage = None,
    json: JsonFigures = False,
    quiet: o.Quiet = False,
    force: o.Force = False,
    debug: o.Debug = False,
) -> None:  # fmt: skip
    """Compare the direct linear transform, Tsai's and Zhang's methods with the full solution on the same points.

    calibrant study methods
    calibrant study methods --noise 0 --lens pinhole
    calibrant study methods photos/*.jpg --target chessboard:9x6:25mm

    On simulated points: reprojection error, errors against the truth, time, and where each method fails, one
    condition at a time. On your own points: the same against the full solution of all views.
    """
    from calibrant.cli import session
    from calibrant.cli.progress import listener
    from calibrant.data.result_file import write_text
    from calibrant.studies import page as study_report
    from calibrant.studies import study as study_run
    from calibrant.tasks.inputs.sources import Source
    from calibrant.tasks.options.images import SearchOptions

    outputs = session.Outputs(out, report, json, quiet, force)
    outputs.check()
    silent = quiet or json
    if images or observations is not None or target is not None:
        search = SearchOptions(workers=workers, cache=cache)
        source = Source(tuple(images or ()), target, observations, search, listener=listener(silent=silent))
        files = source.files()
        outputs.spare(source.inputs(files))
        found = source.read(files)
        session.load_solver(quiet=silent)
        name = str(observations) if observations is not None else found.target or "photos"
        done = study_run.observed(found, name=name)
    else:
        from calibrant.studies.scenes import Conditions

        conditions = Conditions(seed, _noise(noise), *_counts(points, views), lens=lens)
        _check_trials(trials)
        session.load_solver(quiet=silent)
        with session.progress("Studying", quiet=silent) as step:
            total, count = study_run.steps(trials), iter(range(1, study_run.steps(trials) + 1))
            done = study_run.synthetic(conditions, trials=trials, step=lambda title: step(next(count), total, title))
    if not silent:
        from rich.console import Console

        Console().print(study_report.tables(done))
    if out is not None:
        write_text(study_report.study_text(done) + "\n", out, force=force)
    if report is not None:
        write_text(study_report.page(done), report, force=force)
    if json:
        typer.echo(study_report.study_text(done))
    elif not quiet and outputs.paths:
        typer.echo(f"\nWritten: {', '.join(str(p) for p in outputs.paths)}")


def _noise(text: str) -> float:
    """Pixels with their unit; 0 needs none. Raises: InputError."""
    from calibrant.errors import InputError

    if text.strip() in ("0", "0px"):
        return 0.0
    value = o.pixels(text, option="--noise") or 0.0
    if value > MOST_NOISE_PX:
        raise InputError(f"--noise {text}: points this noisy change places; at most {MOST_NOISE_PX:g}px")
    return value


def _counts(points: int, views: int) -> tuple[int, int]:
    from calibrant.errors import InputError
    from calibrant.studies.scenes import LEAST_POINTS

    if not LEAST_POINTS <= points <= 10_000:
        raise InputError(f"--points {points}: a simulated target has {LEAST_POINTS} to 10000 points")
    if not 1 <= views <= 1000:
        raise InputError(f"--views {views}: simulate 1 to 1000 views")
    return points, views


def _check_trials(trials: int) -> None:
    from calibrant.errors import InputError

    if not 0 <= trials <= 1000:
        raise InputError(f"--trials {trials}: 0 (no sweeps) to 1000 scenes a value")
