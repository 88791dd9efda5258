"""Compare all ways to calibrate a camera, on simulated points or on one's own, and see when each fails."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import Source
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import PhotoOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Answer, Outcome

if TYPE_CHECKING:
    from pathlib import Path

    from calibrant.studies.page import Study

EXAMPLE = 'cb.study_methods(noise="0.1px", trials=0)'
MOST_NOISE_PX = 50.0
"""Beyond it, points 30 mm apart change places."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Compare the direct linear transform, Tsai's and Zhang's methods with the full solution on the same points.

    calibrant study methods
    calibrant study methods --noise 0 --lens pinhole
    calibrant study methods photos/*.jpg --target chessboard:9x6:25mm

    On simulated points: reprojection error, errors against the truth, time, and where each method fails, one
    condition at a time. On your own points: the same against the full solution of all views.
    """

    photos: PhotoOptions = PhotoOptions()
    points_file: PointsOptions = PointsOptions()
    noise: Annotated[str, Option("PX")] = "0.1px"
    """Noise of the simulated points, per axis."""
    points: Annotated[int, Option("N")] = 63
    """Points of the simulated targets, about."""
    views: Annotated[int, Option("N")] = 6
    """Simulated views."""
    lens: Annotated[str, Option("MODEL:TERM")] = "brown:-0.1"
    """True lens: pinhole, brown:-0.1, division:-0.1 ..."""
    trials: Annotated[int, Option("N")] = 5
    """Scenes for each value of what makes methods fail; 0: none."""
    seed: Annotated[int, Option("N")] = 0
    """Another seed draws other scenes."""
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[Path]:
    """The photos or the file of points; nothing for simulated points."""
    if not _own_points(request):
        return []
    source = _study_source(request, SILENT)
    return source.inputs(source.files())


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The study. Raises: InputError for numbers out of range, and for photos as `intrinsics`."""
    from calibrant.studies import page

    done = _observed(request, listener) if _own_points(request) else _simulated(request, listener)
    answer = Answer(done, partial(page.study_text, done))
    return Outcome(answer=answer, summary=partial(page.tables, done), page=partial(page.page, done))


def _own_points(request: Request) -> bool:
    return bool(request.photos.images or request.photos.target or request.points_file.observations)


def _study_source(request: Request, listener: Listener) -> Source:
    return Source.of(request.photos, request.search, listener, points=request.points_file)


def _observed(request: Request, listener: Listener) -> Study:
    """All methods on a real camera's points."""
    from calibrant.studies.study import observed

    source = _study_source(request, listener)
    found = source.read(source.files())
    session.load_solver(listener)
    given = request.points_file.observations
    return observed(found, name=str(given) if given is not None else found.target or "photos")


def _simulated(request: Request, listener: Listener) -> Study:
    """All methods on simulated points, and each condition under which they fail."""
    from calibrant.studies.scenes import Conditions
    from calibrant.studies.study import steps, synthetic

    _check_counts(request)
    noise = _noise(request.noise)
    conditions = Conditions(request.seed, noise, request.points, request.views, lens=request.lens)
    session.load_solver(listener)
    total = steps(request.trials)
    count = iter(range(1, total + 1))
    with listener.progress("Studying") as step:
        return synthetic(conditions, trials=request.trials, step=lambda title: step(next(count), total, title))


def _noise(text: str) -> float:
    """Pixels with their unit; 0 needs none. Raises: InputError."""
    if text.strip() in ("0", "0px"):
        return 0.0
    value = pixels(text, option="--noise") or 0.0
    if value > MOST_NOISE_PX:
        raise InputError(f"--noise {text}: points this noisy change places; at most {MOST_NOISE_PX:g}px")
    return value


def _check_counts(request: Request) -> None:
    """Raises: InputError naming the number out of range."""
    from calibrant.studies.scenes import LEAST_POINTS

    if not LEAST_POINTS <= request.points <= 10_000:
        raise InputError(f"--points {request.points}: a simulated target has {LEAST_POINTS} to 10000 points")
    if not 1 <= request.views <= 1000:
        raise InputError(f"--views {request.views}: simulate 1 to 1000 views")
    if not 0 <= request.trials <= 1000:
        raise InputError(f"--trials {request.trials}: 0 (no sweeps) to 1000 scenes a value")
