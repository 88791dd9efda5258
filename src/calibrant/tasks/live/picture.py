"""A picture as sensor_msgs has it, raw or compressed, in grey values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

COMPRESSED = "compressed"
"""In place of an encoding: `data` is the file of a sensor_msgs/CompressedImage."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A message: topic, stamp seconds, frame: the camera's optical one; the others are the message's own fields.

    data (n,): rows of `step` bytes each, or a compressed file and `format` what the message says of it.
    """

    topic: str
    stamp: float
    frame: str
    width: int
    height: int
    encoding: str
    step: int
    data: NDArray[np.uint8]
    is_bigendian: bool = False
    format: str = ""

    def grey(self) -> NDArray[np.uint8]:
        """(height, width). Raises: InputError naming the topic, for an encoding that is not read or bytes that do not
        fit."""
        from calibrant.detection.images.images import to_grey8
        from calibrant.formats.bags.encodings import decoded_compressed, decoded_image

        decoded = decoded_compressed if self.encoding == COMPRESSED else decoded_image
        return to_grey8(decoded(self, self.topic))
