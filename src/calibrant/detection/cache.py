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
from calibrant.errors import CalibrantError, InputError
from calibrant.formats.bags.kinds import files_of, is_bag
from calibrant.opencv import cv2
from calibrant.reading.files import Most, draft, open_file, read_text, reason_of
from calibrant.reading.json_text import parse_json
from calibrant.reading.notes import note
from calibrant.targets.target import Target
from calibrant.version import __version__

Size = tuple[int, int]
_ENTRY = Most(64_000_000, "the detection of one photo")


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
        """The image's size and its detection; None when it is not kept, or not as it was written.

        What was cut short, changed, or put there by another hand costs the time to search again, and no more.
        """
        try:
            content = parse_json(read_text(self._file(key), most=_ENTRY, what="kept detection"))
            if content["sha256"] != _checksum(key, content["kept"]):
                return None
            return _decoded_detection(json.loads(content["kept"]))
        except (CalibrantError, ValueError, LookupError, TypeError, OverflowError, AttributeError):
            return None

    def put(self, key: str, size: Size, detection: Detection) -> None:
        """Keep a detection, where there is room: what cannot be kept is searched again another time."""
        file = self._file(key)
        kept = json.dumps(_encoded(size, detection))
        text = json.dumps({"sha256": _checksum(key, kept), "kept": kept})
        try:
            file.parent.mkdir(exist_ok=True)
            beside, stream = draft(file)
            try:
                with stream:
                    stream.write(text.encode())
                beside.replace(file)
            finally:
                beside.unlink(missing_ok=True)
        except OSError as error:
            note(f"detections are not kept in {self.folder}: {reason_of(error)}; later runs search these photos again")

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
        states = [(part, part.stat()) for part in (files_of(source) if is_bag(source) else [source])]
        digest = "".join(_content(str(part), status.st_mtime_ns, status.st_size) for part, status in states)
    except (OSError, InputError):
        return None
    parts = (digest, str(number), repr(target), str(mirror_x), repr(refinement), code_fingerprint())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@lru_cache(maxsize=64)
def _content(file: str, changed_ns: int, size: int) -> str:
    """SHA-256 of a file; asked again for every frame of a video."""
    with open_file(file, what="image") as stream:
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


def _checksum(key: str, kept: str) -> str:
    """SHA-256 of an entry under its key: neither a changed one nor one of another photo passes for it."""
    return hashlib.sha256(f"{key}\0{kept}".encode()).hexdigest()


def _encoded(size: Size, detection: Detection) -> dict[str, Any]:
    sigma, covariance = detection.sigma_px, detection.covariance_px
    return {
        "size": list(size),
        "point_ids": detection.point_ids.tolist(),
        "uv": detection.uv.tolist(),
        "sigma_px": None if sigma is None else sigma.tolist(),
        "covariance_px": None if covariance is None else covariance.tolist(),
        "smeared": detection.smeared,
        "reason": detection.reason,
        "notes": list(detection.notes),
        "looks_like": detection.looks_like,
        "another": detection.another,
    }


def _decoded_detection(content: Mapping[str, Any]) -> tuple[Size, Detection]:
    """Raises: ValueError, KeyError, TypeError for what no detection is."""
    sigma, covariance = content["sigma_px"], content["covariance_px"]
    width, height = content["size"]
    point_ids = np.array(content["point_ids"], np.int64)
    uv = np.array(content["uv"], np.float64).reshape(-1, 2)
    sigma_px = None if sigma is None else np.array(sigma, np.float64)
    covariance_px = None if covariance is None else np.array(covariance, np.float64)
    whole = len(point_ids) == len(uv) and (sigma_px is None or sigma_px.shape == (len(uv),))
    whole = whole and (covariance_px is None or covariance_px.shape == (len(uv), 2, 2))
    if not whole or not np.all(np.isfinite(uv)) or len(set(point_ids.tolist())) < len(uv):
        raise ValueError
    return (int(width), int(height)), Detection(
        point_ids,
        uv,
        sigma_px,
        content["reason"],
        tuple(content["notes"]),
        content["looks_like"],
        bool(content["another"]),
        covariance_px,
        bool(content["smeared"]),
    )
