"""Detections kept between runs: a file an image, named by what was looked at and by what looked.

The name is the SHA-256 of the image's bytes, the target, the options, and the code and libraries that detect; so
nothing that is kept can be out of date, and nothing needs to be thrown away by hand. A file is written beside its place
and moved there, so that an interrupted run leaves only whole ones.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from calibrant.detection.detection import Detection
from calibrant.detection.images.files import frame_of
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.targets.target import Target
from calibrant.version import __version__

Size = tuple[int, int]


@dataclass(frozen=True)
class Cache:
    """A folder of detections."""

    folder: Path

    @classmethod
    def at(cls, folder: str | Path) -> Cache:
        """The cache in a folder, made if need be. Raises: InputError when it cannot be written."""
        path = Path(folder).expanduser()
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot keep detections in {path}: {error.strerror or error}; give another folder"
            ) from None
        if not os.access(path, os.W_OK):
            raise InputError(f"cannot keep detections in {path}: it is not writable; give another folder")
        return cls(path)

    def get(self, key: str) -> tuple[Size, Detection] | None:
        """The image's size and its detection; None when it is not kept, or not readable."""
        try:
            content = json.loads(self._file(key).read_text(encoding="utf-8"))
            return _decoded_detection(content)
        except (FileNotFoundError, json.JSONDecodeError, KeyError, ValueError):
            # A file that someone has cut short is looked for again and written anew.
            return None

    def put(self, key: str, size: Size, detection: Detection) -> None:
        """Keep a detection. Raises: InputError when the folder cannot be written."""
        file = self._file(key)
        draft = file.with_name(f".{file.name}.{os.getpid()}")
        try:
            file.parent.mkdir(exist_ok=True)
            draft.write_text(json.dumps(_encoded(size, detection)), encoding="utf-8")
            draft.replace(file)
        except OSError as error:
            raise InputError(f"cannot keep detections in {self.folder}: {error.strerror or error}") from None

    def _file(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:]}.json"


def default_folder() -> Path:
    """Where this user's programs keep what can be made again."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "calibrant" / "detections"


def key_of(file: Path, target: Target, mirror_x: bool, refinement: Refinement = DEFAULT) -> str | None:
    """The name under which a file's detection is kept; None when the file cannot be read."""
    frame = frame_of(file)
    source, number = (file, None) if frame is None else frame
    try:
        status = source.stat()
        digest = _content(str(source), status.st_mtime_ns, status.st_size)
    except OSError:
        return None
    parts = (digest, str(number), repr(target), str(mirror_x), repr(refinement), code_fingerprint())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@lru_cache(maxsize=64)
def _content(file: str, changed_ns: int, size: int) -> str:
    """SHA-256 of a file; asked again for every frame of a video."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """SHA-256 of the detectors' own code, the targets' and the versions below them."""
    digest = hashlib.sha256(f"{__version__} {cv2.__version__} {np.__version__}".encode())
    here = Path(__file__).parent
    for file in sorted([*here.rglob("*.py"), *(here.parent / "targets").rglob("*.py")]):
        digest.update(file.relative_to(here.parent).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _encoded(size: Size, detection: Detection) -> dict[str, Any]:
    sigma = detection.sigma_px
    return {
        "size": list(size),
        "point_ids": detection.point_ids.tolist(),
        "uv": detection.uv.tolist(),
        "sigma_px": None if sigma is None else sigma.tolist(),
        "reason": detection.reason,
        "notes": list(detection.notes),
        "looks_like": detection.looks_like,
        "another": detection.another,
    }


def _decoded_detection(content: Mapping[str, Any]) -> tuple[Size, Detection]:
    sigma = content["sigma_px"]
    width, height = content["size"]
    return (int(width), int(height)), Detection(
        np.array(content["point_ids"], np.int64),
        np.array(content["uv"], np.float64).reshape(-1, 2),
        None if sigma is None else np.array(sigma, np.float64),
        content["reason"],
        tuple(content["notes"]),
        content["looks_like"],
        bool(content["another"]),
    )
