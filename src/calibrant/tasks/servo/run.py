"""Lead the arm to a taught pose, or see in simulated cells how well that goes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.devices import DeviceOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Answer, Document, Outcome
from calibrant.tasks.servo.teach import degrees

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibrant.servoing.loop import ServoOptions
    from calibrant.studies.servo_cell import ServoStudy

EXAMPLE = 'cb.servo_run(cell=True, seeds=1, control="planar")'
CONTROLS = ("image", "position", "hybrid", "planar")
DEPTHS = ("estimated", "measured", "wanted")
MOST_SEEDS = 10_000


@dataclass(frozen=True, kw_only=True)
class Request:
    """Lead the arm to the taught pose by what the camera sees; or try it in simulated cells.

    calibrant servo run target.json --robot-device ur:192.168.0.10 --camera-device realsense
    calibrant servo run --cell --seeds 20 --control image --json
    calibrant servo run --cell --seeds 5 --starts 4 --focal-error 10% --hand-eye-error 5deg --plot runs.png

    image: by points of the picture; position: by the target's pose; hybrid: 2 1/2-D; planar: x, y and the turn about
    the approach axis. Exit status 1 where a run did not arrive. A robot that could hit something moves when it was
    asked for, or with --yes.
    """

    target_file: Annotated[Path | None, Option("TARGET.json", positional=True)] = None
    """What `servo teach` wrote; with --robot-device and --camera-device."""
    devices: DeviceOptions = DeviceOptions()
    cell: bool = False
    """Try it in simulated cells: their wrist cameras are calibrated from pictures, a pose is taught, then run to."""
    control: Annotated[str, Option("NAME", choices=CONTROLS)] = "image"
    """image, position, hybrid or planar."""
    seeds: Annotated[int, Option("N")] = 1
    """Cells to try."""
    seed: Annotated[int, Option("N")] = 0
    """The first cell's number."""
    starts: Annotated[int, Option("N")] = 1
    """Starts in each cell."""
    distance: Annotated[str, Option("LENGTH")] = "200mm"
    """How far away the starts are."""
    turned: Annotated[str, Option("ANGLE")] = "30deg"
    """How much they are turned."""
    depth: Annotated[str, Option("HOW", choices=DEPTHS)] = "estimated"
    """Depth of the features: estimated by the target's pose, measured by the camera, or wanted: as it was taught."""
    tolerance: Annotated[str, Option("LENGTH")] = "0.3mm"
    """What may remain, with 99 % chance."""
    tolerance_turn: Annotated[str, Option("ANGLE")] = "0.1deg"
    """The same of the turn."""
    gain: Annotated[float, Option("GAIN")] = 1.2
    """1/s, far away; near the goal it is twice that."""
    focal_error: Annotated[str, Option("PERCENT")] = "0%"
    """Use focal lengths that are wrong by this much."""
    hand_eye_error: Annotated[str, Option("ANGLE")] = "0deg"
    """Use a mounting that is turned by this much, about any axis."""
    plot: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw what remains over time, the gain and the speed."""


def reads(request: Request) -> list[str | Path]:
    """The target file."""
    return [] if request.target_file is None else [request.target_file]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The runs in cells as a table; the run of a robot as a result. Raises: InputError; MissingExtraError without the
    extra sim; as `run_on_devices`."""
    if request.control not in CONTROLS:
        raise InputError(f"--control {request.control}: choose {', '.join(CONTROLS)}")
    if not request.cell:
        from calibrant.tasks.servo.on_devices import run_on_devices

        return run_on_devices(request, options_of(request), listener)
    for option, count in (("--seeds", request.seeds), ("--starts", request.starts)):
        if not 1 <= count <= MOST_SEEDS:
            raise InputError(f"{option} {count}: 1 to {MOST_SEEDS}")
    from calibrant.studies.servo_cell import ServoCase, servo_study, study_json
    from calibrant.targets.lengths import parse_length

    case = ServoCase(
        control=request.control,
        metres=parse_length(request.distance, what="--distance"),
        degrees=degrees(request.turned, option="--turned"),
        starts=request.starts,
        focal_error=percent(request.focal_error, option="--focal-error"),
        hand_eye_deg=degrees(request.hand_eye_error, option="--hand-eye-error"),
        depth=request.depth,  # type: ignore[arg-type]
        options=options_of(request),
    )
    with listener.progress("Servoing") as step:
        study = servo_study(range(request.seed, request.seed + request.seeds), case, step=step)
    failed = [r for r in study.runs if not r.passed]
    refusal = RefusedError(f"{len(failed)} of {len(study.runs)} runs did not arrive") if failed else None
    return Outcome(
        answer=Answer(study, partial(study_json, study)),
        documents=_plots(request, study),
        summary=partial(table, study),
        refusal=refusal,
    )


def options_of(request: Request) -> ServoOptions:
    """Raises: InputError for values out of range."""
    from calibrant.servoing.loop import ServoOptions
    from calibrant.targets.lengths import parse_length

    return ServoOptions(
        tolerance_mm=1e3 * parse_length(request.tolerance, what="--tolerance"),
        tolerance_deg=degrees(request.tolerance_turn, option="--tolerance-turn"),
        gain=request.gain,
        near_gain=2 * request.gain,
    )


def percent(text: str, *, option: str) -> float:
    """A share with its unit: 10%. Raises: InputError."""
    try:
        value = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        value = -1.0
    if not text.strip().endswith("%") or not 0 <= value < 1:
        raise InputError(f"{option} takes 0% to 99%, such as 10%; got {text!r}")
    return value


def table(study: ServoStudy) -> Any:
    """For a terminal."""
    import numpy as np
    from rich.text import Text

    from calibrant.reports.parts.blocks import Column, TextTable
    from calibrant.reports.terminal import text_table

    names = ("seed", "start", "error [mm]", "[deg]", "predicted [mm]", "pictures", "time [s]", "")
    rows = tuple(
        (str(r.seed), str(r.start), f"{r.error_mm:.3f}", f"{r.error_deg:.4f}", f"{r.predicted_mm:.3f}",
         str(r.pictures), f"{r.seconds:.1f}", r.reason)
        for r in study.runs
    )  # fmt: skip
    good = [r.error_mm for r in study.runs if np.isfinite(r.error_mm)]
    median = f", median error {np.median(good):.3f} mm" if good else ""
    note = (
        f"{sum(r.passed for r in study.runs)} of {len(study.runs)} arrived{median}; predicted with 99 % chance. "
        f"Slowest direction: {100 * study.margin:.0f} % of the speed asked for, by the errors made on purpose."
    )
    heading = f"Servoing by {study.case.control} control"
    columns = tuple(Column(name, k < len(names) - 1) for k, name in enumerate(names))
    return text_table(TextTable(heading, columns, rows, note=note)) if rows else Text("no runs")


def _plots(request: Request, study: ServoStudy) -> Iterator[Document]:
    traces = [r.trace for r in study.runs if r.trace is not None]
    if request.plot is not None and traces:
        from calibrant.reports.servo_plots import servo_png

        yield Document(request.plot, partial(servo_png, traces))
