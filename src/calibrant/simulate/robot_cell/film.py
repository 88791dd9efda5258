"""A run kept for people: every picture that was taken, and a film of the cell from the side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.data import Picture
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.simulate.robot_cell.parts.spec import looking_at
from calibrant.simulate.robot_cell.pictures.views import PinholeView, Renderer

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibrant.arrays import Array

PICTURES_A_SECOND = 10
_SIZE = (480, 360)
_K = np.array([[420.0, 0, 239.5], [0, 420.0, 179.5], [0, 0, 1]])
FILM_VIEW = looking_at((1.55, -1.05, 0.95), (0.35, 0.0, 0.22))
_MOST = 1200
"""Two minutes of film; what comes later is left out."""


class Recorder:
    """Writes folder/CAMERA NNNN.png as pictures come, and folder/film.mp4 and film.gif at the end."""

    def __init__(self, folder: Path, renderer: Renderer, finish: Callable[[NDArray, NDArray, Array], NDArray]) -> None:
        self._folder, self._renderer, self._finished = folder, renderer, finish
        self._frames: list[NDArray[np.uint8]] = []
        self._next = 0.0
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot write to {folder}: {error.strerror}; choose another folder") from error

    def picture(self, camera: str, picture: Picture) -> None:
        """Keep a picture; depth beside it in 0.1 mm as 16 bits, 0 for none."""
        stem = picture.name.replace(" ", "_")
        self._write(f"{stem}.png", picture.colour)
        if picture.depth is not None:
            tenths = np.nan_to_num(np.clip(1e4 * picture.depth, 0, 65535), nan=0.0)
            self._write(f"{stem}_depth.png", np.rint(tenths).astype(np.uint16))

    def at_time(self, time_s: float) -> None:
        """A frame of the film when its time has come."""
        if time_s < self._next or len(self._frames) >= _MOST:
            return
        self._next = time_s + 1 / PICTURES_A_SECOND
        self._frames.append(film_frame(self._renderer, self._finished))

    def finish(self) -> None:
        """Write the film."""
        if not self._frames:
            return
        film = cv2.VideoWriter(
            str(self._folder / "film.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), PICTURES_A_SECOND, _SIZE
        )
        for frame in self._frames:
            film.write(frame)
        film.release()
        write_gif(self._folder / "film.gif", self._frames)

    def _write(self, name: str, image: NDArray) -> None:
        _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        (self._folder / name).write_bytes(data.tobytes())


def film_frame(renderer: Renderer, finished: Callable[[NDArray, NDArray, Array], NDArray]) -> NDArray[np.uint8]:
    """The cell from the side, BGR."""
    view = PinholeView(_K, _SIZE, FILM_VIEW)
    colour, depth = renderer.colour_and_depth(view)
    return finished(colour, depth, FILM_VIEW)


def film_camera() -> tuple[Array, tuple[int, int]]:
    """K and size of the film's camera."""
    return _K, _SIZE


def write_gif(path: Path, frames: list[NDArray[np.uint8]], *, pictures_a_second: int = PICTURES_A_SECOND) -> None:
    """Frames (h, w, 3) BGR as an endless GIF of half their size."""
    from PIL import Image

    images = [
        Image.fromarray(
            cv2.cvtColor(cv2.resize(f, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
        )
        for f in frames
    ]
    palette = [image.quantize(64) for image in images]
    palette[0].save(path, save_all=True, append_images=palette[1:], duration=1000 // pictures_a_second, loop=0)
