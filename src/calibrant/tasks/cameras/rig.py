"""Calibrate cameras that are fixed to each other: images matched, boards found in each, one problem, review."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from calibrant.errors import InputError
from calibrant.tasks.cameras.rig_pictures import ONLY_BOARD, RigPictures
from calibrant.tasks.cameras.rig_solving import RigAsked, Sizes, require_times, solved_rig
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.sharpest import refuse_beside_bag, taken_together
from calibrant.tasks.inputs.by_camera import (
    boards_by_name,
    files_by_camera,
    images_by_camera,
    one_by_camera,
    several_by_camera,
)
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.bags import BagOptions
from calibrant.tasks.options.choices import MODELS, PAIR_RULES
from calibrant.tasks.options.images import CornerOptions, PointsOptions, RigSearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import split_names
from calibrant.tasks.outcome import Outcome

if TYPE_CHECKING:
    from calibrant.cameras import Camera

V = TypeVar("V")
_TIMES_CURE = "give videos, images with time stamps in their names, --times FILE, or numbered images and --fps RATE"
EXAMPLE = (
    'cb.rig(images={"left": "left.mp4", "top": "top.mp4", "right": "right.mp4"}, '
    'target="charuco:5x7:36mm:18mm:DICT_6X6_250")'
)


@dataclass(frozen=True, kw_only=True)
class Request:
    """Calibrate cameras that are fixed to each other, from images or videos of boards that they took at once.

    calibrant rig --images left=left.mp4 --images right=right.mp4 --target chessboard:9x6:25mm --out rig.json

    Finds all lenses and where every camera stands in one problem, with the uncertainty of both; says who saw the board
    together with whom, what the cameras' clocks are off by, and which cameras nothing ties to the others.

    What holds for one camera has its name before it: --model wide:kannala_brandt, --fix left:k3, --camera top=top.json.
    """

    images: Annotated[tuple[str, ...], Option("NAME=IMAGES", "-i")] = ()
    """Images, a folder, a pattern or a video of each camera, by its name: left=photos/left. Once for each."""
    recording: BagOptions = BagOptions()
    target: Annotated[tuple[str, ...], Option("SPEC", "-t")] = ()
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file; for
    one camera, such as a thermal one that sees it inverted: thermal=SPEC."""
    board: Annotated[tuple[str, ...], Option("NAME=SPEC")] = ()
    """One of several boards, each with a name; every camera is searched for all of them."""
    rigid: Annotated[tuple[str, ...], Option("NAMES")] = ()
    """Boards that are fixed to each other: front,back. The others are moved each by itself."""
    points: PointsOptions = PointsOptions()
    pairs: Annotated[str, Option("RULE", choices=PAIR_RULES)] = "auto"
    """What was taken at once: by name or number (frames of videos: by theirs), by the time stamps in the names, by
    order; auto: the first of these that fits."""
    camera: Annotated[tuple[str, ...], Option("NAME=FILE")] = ()
    """Known camera (any format), held within its uncertainty: left=left.json."""
    initial: Annotated[tuple[str, ...], Option("NAME=FILE")] = ()
    """Start from this camera file, and hold what --fix holds as it has it: right=right.yml."""
    model: Annotated[tuple[str, ...], Option("NAME", choices=MODELS)] = ()
    """Camera model of all, brown unless given, or of one: wide:kannala_brandt."""
    fix: Annotated[tuple[str, ...], Option("NAMES", names=True)] = ()
    """Hold these: fx fy cx cy k1 k2 k3 p1 p2, aspect, radial, tangential, focal, principal; of one camera: left:k3."""
    reference: Annotated[str | None, Option("NAME")] = None
    """The camera whose frame is the rig's: the first unless given."""
    time_offsets: bool = False
    """Find how much later than the reference's each camera's pictures are taken; the board must move."""
    readout: bool = False
    """Find the time between the first and the last row of each camera's pictures (rolling shutter)."""
    fps: Annotated[float | None, Option("RATE")] = None
    """Pictures a second, of numbered images, or of videos that state another rate."""
    times: Annotated[Path | None, Option("FILE")] = None
    """CSV of when each picture was taken: camera, image (or its number, frame) and time, seconds, a row each. With
    --pairs time they also say what was taken at once."""
    search: RigSearchOptions = RigSearchOptions()
    corners: CornerOptions = CornerOptions()


def reads(request: Request) -> list[Path]:
    """The images or the file of points, and the cameras that are given."""
    return _inputs(request, _pictures(request, SILENT))


def _inputs(request: Request, pictures: RigPictures) -> list[Path]:
    names = _names(request, pictures)
    given = (files_by_camera(v, names, option=o) for v, o in _lens_files(request))
    return [*pictures.inputs, *(file for files in given for file in files.values())]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The rig, reviewed. Raises: InputError; RefusedError with the result that failed its checks."""
    from calibrant.data.verdicts import refuse_if_failed

    pictures = _pictures(request, listener)
    clocks = [o for o, asked in (("--time-offsets", request.time_offsets), ("--readout", request.readout)) if asked]
    require_times(pictures, clocks, _TIMES_CURE)
    result = solved_rig(pictures, partial(_asked, request), listener)
    result = replace(result, inputs=session.file_records(_inputs(request, pictures)))
    result = session.with_misses(result)
    refuse_if_failed(result)
    return Outcome(result=result)


def _pictures(request: Request, listener: Listener) -> RigPictures:
    """What the options say. Raises: InputError for options that contradict each other, or cameras without images."""
    images = images_by_camera(request.images)
    file = request.points.observations
    request.recording.check()
    bag = None
    if request.recording.bag is not None:
        refuse_beside_bag(
            **{"--images": images, "--observations": file, "--times": request.times, "--fps": request.fps}
        )
        bag = taken_together(request.recording)
        images = dict(bag.files)
    if (file is None) == (not images):
        what = "give --images or --observations FILE, not both" if images else "no images: --images NAME=IMAGES"
        raise InputError(f"{what}; a rig takes those of two cameras or more")
    if request.times is not None and (file is not None or request.fps is not None):
        other = (
            "--observations, whose points have no pictures" if file is not None else "--fps, which tells other times"
        )
        raise InputError(f"--times says when each image was taken: leave out {other}")
    if file is None and len(images) < 2 and not request.rigid:
        raise InputError(f"--images names one camera, {', '.join(images)}; a rig has two or more")
    if file is not None and (request.board or request.target or request.search.mirror):
        raise InputError("--observations FILE holds points as they are: leave --target, --board and --mirror out")
    for name in split_names(request.search.mirror):
        if name not in images:
            raise InputError(f"--mirror {name}: there is no camera of that name; there are {', '.join(images)}")
    return RigPictures(
        images=images,
        specs=_specs(request, tuple(images)),
        observations=file,
        rule=request.pairs if bag is None else "time",
        recorded=None if bag is None else bag.times,
        fps=request.fps,
        table=request.times,
        search=request.search,
        corners=request.corners,
        listener=listener,
    )


def _specs(request: Request, cameras: tuple[str, ...]) -> dict[str, dict[str, str]]:
    """By camera, the boards it is searched for by name. Raises: InputError for none, or both kinds of option."""
    if request.board and request.target:
        raise InputError("give --target, one board for all, or --board NAME=SPEC for each of several, not both")
    boards = boards_by_name(request.board)
    if boards:
        return {camera: dict(boards) for camera in cameras}
    own = one_by_camera(request.target, cameras, option="--target", every="every camera")
    for camera in cameras:
        if camera not in own:
            raise InputError(
                f"camera {camera} has no board: --target SPEC for all, such as chessboard:9x6:25mm, or {camera}=SPEC"
            )
    return {camera: {ONLY_BOARD: own[camera]} for camera in cameras}


def _names(request: Request, pictures: RigPictures) -> tuple[str, ...]:
    """Names of the cameras: of the images, or in the file of points."""
    if pictures.images:
        return tuple(pictures.images)
    from calibrant.data.result_file import read_observations

    return tuple(read_observations(pictures.observations or Path()).image_sizes)


def _lens_files(request: Request) -> tuple[tuple[tuple[str, ...], str], ...]:
    return (request.camera, "--camera"), (request.initial, "--initial")


def _asked(request: Request, sizes: Sizes) -> RigAsked:
    names = tuple(sizes)
    known, guessed = (_cameras(values, option, sizes) for values, option in _lens_files(request))
    return RigAsked(
        cameras=known,
        initial=guessed,
        model=_same_for_all(one_by_camera(request.model, names, option="--model"), names, "brown"),
        fix=_same_for_all(several_by_camera(request.fix, names, option="--fix"), names, ()),
        reference=request.reference,
        time_offsets=request.time_offsets,
        readout=request.readout,
        rigid=tuple(split_names([group]) for group in request.rigid),
    )


def _same_for_all(values: Mapping[str, V], names: tuple[str, ...], default: V) -> V | Mapping[str, V]:
    """One value where all cameras have it."""
    every = [values.get(name, default) for name in names]
    return every[0] if all(v == every[0] for v in every) else dict(zip(names, every))


def _cameras(values: tuple[str, ...], option: str, sizes: Mapping[str, tuple[int, int]]) -> dict[str, Camera]:
    from calibrant.formats.cameras.read import read_camera

    files = files_by_camera(values, tuple(sizes), option=option)
    return {name: read_camera(file, image_size=sizes[name], name=name) for name, file in files.items()}
