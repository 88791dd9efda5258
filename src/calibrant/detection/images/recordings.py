"""Recordings as images, whatever they are: videos and bags give frames, whose names are a file's and a number.

A new kind of recording is a module with these functions and one line in `source_of`; nothing else learns of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from numpy.typing import NDArray

from calibrant.formats.bags.kinds import is_bag

if TYPE_CHECKING:
    from collections.abc import Callable


class Frames(Protocol):
    """What a kind of recording does."""

    @property
    def frames(self) -> Callable[[Path, int | None], list[Path]]:
        """Names of the frames that stand for the recording, of every n."""
        ...

    @property
    def frame_count(self) -> Callable[[Path], int]:
        """How many frames it has."""
        ...

    @property
    def frame_rate(self) -> Callable[[Path], float | None]:
        """Frames a second, where it states them."""
        ...

    @property
    def read_frame(self) -> Callable[[Path, int], NDArray[Any]]:
        """A frame (h, w), or (h, w, 3 or 4) BGR."""
        ...


def source_of(recording: Path) -> Frames:
    """What reads this recording. A bag's reader and OpenCV's are loaded for their own alone."""
    if is_bag(recording):
        from calibrant.formats.bags import pictures

        return pictures
    from calibrant.detection.images import video

    return video
