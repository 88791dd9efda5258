"""The views' pictures for the report: small JPEGs as data URIs, as many and as large as the file may hold."""

from __future__ import annotations

import base64
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.reports.parts.blocks import Block

_MOST_PICTURES = 40
"""Reading a picture takes some 20 ms: more than these would make a report slow to write."""
_THREADS = 4
_WIDTHS = (960, 720, 540, 400)
_QUALITY = 72
"""Corners stay clear under the residual arrows; higher only adds bytes."""


def data_uris(
    files: Sequence[tuple[str, Path]], *, budget: int, mirrored: Collection[str] = ()
) -> tuple[dict[str, str], str]:
    """JPEG data URIs by view, and a sentence on what is missing (empty when nothing is).

    Args: files, (view key, path) in order of importance; budget, bytes of all URIs together; mirrored, the keys of
    views whose observations were made on mirrored images.
    """
    chosen, images, missing = files[:_MOST_PICTURES], {}, []
    # Decoding and resizing leave Python alone: threads take the time of the slowest.
    with ThreadPoolExecutor(_THREADS) as pool:
        for (key, path), image in zip(chosen, pool.map(_read_small, [path for _, path in chosen])):
            if image is None:
                missing.append(PureWindowsPath(path).name)  # whichever system the result is from
            else:
                images[key] = image[:, ::-1] if key in mirrored else image
        encoded: dict[str, str] = {}
        for width in _WIDTHS:
            encoded = dict(zip(images, pool.map(partial(_encode, width=width), images.values())))
            if sum(map(len, encoded.values())) <= budget:
                break
    kept = _within(encoded, budget)
    return kept, _missing_sentence(missing, len(files) - len(missing) - len(kept))


def picture_block(heading: str, image: NDArray[np.uint8], caption: str) -> Block:
    """A picture (h, w, 3), BGR, under a heading, with a sentence below."""
    return Block("picture", {"heading": heading, "uri": _encode(image, _WIDTHS[0]), "caption": caption})


def beside_block(heading: str, pairs: Sequence[tuple[str, str, NDArray[np.uint8], NDArray[np.uint8]]]) -> Block:
    """Pictures beside each other: camera and view, the picture as it was taken, and the same without distortion."""
    several = len(pairs) > 1
    shown = [
        {
            "name": f"{camera} {view}" if several else view,
            "raw": _encode(raw, _WIDTHS[1]),
            "straight": _encode(straight, _WIDTHS[1]),
        }
        for camera, view, raw, straight in pairs
    ]
    return Block("beside", {"heading": heading, "pairs": shown})


def _within(encoded: Mapping[str, str], budget: int) -> dict[str, str]:
    kept, total = {}, 0
    for key, uri in encoded.items():
        total += len(uri)
        if total > budget:
            break
        kept[key] = uri
    return kept


def _read(path: Path) -> NDArray[np.uint8] | None:
    """The picture in grey, 8 bit; None when the file is gone or no picture: the report does without it and says so."""
    from calibrant.detection.images.images import load_grey

    try:
        return np.asarray(load_grey(path), dtype=np.uint8)
    except InputError:
        return None


def _read_small(path: Path) -> NDArray[np.uint8] | None:
    """No larger than the largest that is shown: of a thousand whole pictures few fit in memory."""
    image = _read(path)
    return None if image is None else _reduced(image, _WIDTHS[0])


def _reduced(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    scale = min(1.0, width / image.shape[1])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1 else image
    return np.ascontiguousarray(small)


def _encode(image: NDArray[np.uint8], width: int) -> str:
    jpeg = cv2.imencode(".jpg", _reduced(image, width), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    return "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode("ascii")


def _missing_sentence(missing: Sequence[str], left_out: int) -> str:
    parts = []
    if missing:
        names = ", ".join(missing[:3]) + (", …" if len(missing) > 3 else "")
        many = (
            "pictures could not be read where they were"
            if len(missing) > 1
            else "picture could not be read where it was"
        )
        parts.append(f"{len(missing)} {many} ({names})")
    if left_out > 0:
        parts.append(f"{left_out} more left out to keep this file small")
    return f"{'; '.join(parts)}: those views are drawn on a blank frame." if parts else ""
