"""Samples as a folder that any command reads, pictures, poses and the lens; and the hand-eye task run on it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.reading.files import reason_of
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.live.camera_config import CameraConfig
from calibrant.tasks.live.sampling import Sample
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.writing import write_documents

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult

IMAGES, POSES, LENS, RESULT = "images", "poses.csv", "camera_info.json", "result.json"
_MESSAGE = ("width", "height", "distortion_model", "d", "k", "r", "p", "binning_x", "binning_y", "roi")


def check_session(folder: Path) -> None:
    """Raises: InputError where the folder is there, or cannot be made."""
    if folder.exists():
        raise InputError(f"{folder} exists already; give the samples a new folder (session: in the configuration)")
    if not folder.parent.is_dir():
        raise InputError(f"{folder}: there is no folder {folder.parent}; make it first")


def write_sample(folder: Path, samples: Sequence[Sample], info: Mapping[str, Any] | None) -> None:
    """Put the last sample into the folder: its picture, and the poses of all, so that what is there is always whole."""
    documents = [
        Document(folder / IMAGES / samples[-1].view.id, partial(_png, samples[-1])),
        Document(folder / POSES, poses_text(samples).encode()),
    ]
    if info is not None:
        documents.append(_lens(folder, info))
    _make(folder / IMAGES)
    write_documents(documents, force=True)


def write_lens(folder: Path, info: Mapping[str, Any]) -> Path:
    """Put the fields of a camera_info message into the folder; returns the file."""
    _make(folder)
    write_documents([_lens(folder, info)], force=True)
    return folder / LENS


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be made: {reason_of(error)}") from None


def _lens(folder: Path, info: Mapping[str, Any]) -> Document:
    """JSON, which any `--camera FILE` reads."""
    return Document(folder / LENS, json.dumps({key: info[key] for key in _MESSAGE if key in info}).encode())


def poses_text(samples: Sequence[Sample]) -> str:
    """T_base_tool of each in the native form: metres, quaternion xyzw."""
    lines = ["image,x,y,z,qx,qy,qz,qw"]
    for sample in samples:
        w, x, y, z = so3.quaternion_wxyz(sample.T_base_tool[:3, :3])
        numbers = [*sample.T_base_tool[:3, 3], x, y, z, w]
        lines.append(",".join([sample.view.id, *(repr(float(value)) for value in numbers)]))
    return "\n".join(lines) + "\n"


def calibrated(config: CameraConfig, listener: Listener = SILENT) -> CalibrationResult:
    """The hand-eye task on the folder, its result written there.

    Raises: RefusedError, InputError as the task.
    """
    from calibrant.tasks.options.poses import PoseOptions
    from calibrant.tasks.outcome import result_document
    from calibrant.tasks.registry import TASKS, run_task

    task = TASKS["hand-eye"].load()
    folder = config.session
    lens = config.camera or (folder / LENS if (folder / LENS).exists() else None)
    request = task.Request(
        poses=(str(folder / POSES),),
        images=(str(folder / IMAGES),),
        target=(config.target,),
        camera=() if lens is None else (str(lens),),
        setup=() if config.setup == "auto" else (config.setup,),
        form=PoseOptions(pose_units="m", pose_rotation="quat-xyzw", pose_direction="base-gripper"),
        name=config.name,
    )
    outcome: Outcome = run_task(task, request, listener)
    if outcome.result is None:
        raise InputError("the hand-eye calibration gave no result")
    write_documents([result_document(outcome.result, folder / RESULT)], force=True)
    return outcome.result


def _png(sample: Sample) -> bytes:
    from calibrant.opencv import cv2

    return bytes(cv2.imencode(".png", sample.grey)[1])
