"""What `calibrant dynamic` is asked: photos of both cameras, or a running one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.devices import CameraDeviceOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions

if TYPE_CHECKING:
    pass


PLACEMENTS = ("still", "moves")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Locate a camera beside the robot through the wrist camera and a target that both see.

    calibrant dynamic --wrist hand-eye.json --camera front.json --wrist-images wrist/*.png \\
        --external-images front/*.png --poses poses.csv --target charuco:5x7:36mm:18mm:DICT_6X6_250

    calibrant dynamic --live --wanted place.json --wrist hand-eye.json --camera front.json --wrist-images wrist/*.png \\
        --poses poses.csv --external-images 0 --target charuco:5x7:36mm:18mm:DICT_6X6_250
    calibrant dynamic --live --cell --seed 3

    Says how certain the place is, and which source it owes that to: the wrist's calibration, either camera's pixels,
    the external intrinsics, or the robot.
    """

    wrist: Annotated[Path | None, Option("FILE")] = None
    """The wrist camera's hand-eye result."""
    camera: Annotated[Path | None, Option("FILE")] = None
    """The external camera (any format)."""
    wrist_images: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos by the wrist camera."""
    external_images: Annotated[tuple[str, ...], Option("IMAGES")] = ()
    """Photos by the external one; with --live the running camera: its number, or a video or folder that plays it."""
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the wrist's photos."""
    target: Annotated[str | None, Option("SPEC", "-t")] = None
    """The board: chessboard:9x6:25mm (inner corners), charuco:5x7:36mm:18mm:DICT_6X6_250 (squares), or a file."""
    target_stands: Annotated[str, Option("HOW")] = "still"
    """still: in one place for all photos; moves: the n-th photos of both show its n-th place."""
    sigma_px: Annotated[str | None, Option("LENGTH")] = None
    """Noise of the external camera's corners; what its own views leave unless given."""
    live: bool = False
    """Say place and sigma after every picture of the running external camera, while it is moved; Ctrl-C ends it."""
    device: CameraDeviceOptions = CameraDeviceOptions()
    wanted: Annotated[Path | None, Option("FILE")] = None
    """With --live: a result with base -> external, the place that the camera is led to, in words."""
    pictures: Annotated[int, Option("N")] = 0
    """With --live: end after this many pictures; 0: go on until Ctrl-C, or the end of the video."""
    cell: bool = False
    """With --live: a simulated cell, whose front camera is located and then led to another place."""
    seed: Annotated[int, Option("N")] = 0
    """Which simulated cell."""
    arm: RobotOptions = RobotOptions()
    form: PoseOptions = PoseOptions()


@dataclass(frozen=True)
class Needed:
    """What photos cannot be taken in without."""

    wrist: Path
    camera: Path
    target: str


def needed(request: Request) -> Needed:
    """Raises: InputError naming the first option that is missing."""
    given = {
        "--wrist": request.wrist, "--camera": request.camera, "--wrist-images": request.wrist_images,
        "--external-images": request.external_images or (request.live and request.device.camera_device),
        "--poses": request.poses,
    }  # fmt: skip
    missing = [option for option, value in given.items() if not value]
    if missing:
        raise InputError(f"the external camera is located by {', '.join(given)}; missing: {', '.join(missing)}")
    if request.target is None:
        raise InputError("photos need the board they show: --target, such as chessboard:9x6:25mm")
    if request.wrist is None or request.camera is None:
        raise InputError("--wrist and --camera name the two cameras' files")
    return Needed(request.wrist, request.camera, request.target)


def reads(request: Request) -> list[str | Path]:
    """Both cameras' files, the photos, the poses, and the robot's file."""
    from calibrant.detection.images.files import expand

    if request.cell:
        return []
    photos = expand([*request.wrist_images, *(() if request.live else request.external_images)])
    named = [f for f in (request.wrist, request.camera, request.wanted) if f is not None]
    return [*named, *request.poses, *photos, *request.arm.files]
