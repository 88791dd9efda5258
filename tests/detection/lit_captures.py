"""Small captures whose truth is known, made once."""

from __future__ import annotations

from functools import cache

import numpy as np

from calibrant.detection.structured_light.capture import Capture
from calibrant.patterns.sequence import PatternSequence
from calibrant.simulate.projector.pictures import Lighting, Lit, lit_by, photographed
from calibrant.simulate.projector.points import ProjectorPair, board_poses, example_pair
from calibrant.simulate.projector.surfaces import Plane
from calibrant.simulate.scenes import grid

SIZE = (256, 192)
POINTS = grid(9, 7, 0.03)
PAIR: ProjectorPair = example_pair(image_size=(480, 360), projector_size=SIZE)
POSE = board_poses(PAIR, POINTS, 1, np.random.default_rng(4), distance=(0.6, 0.8))[0]
BOARD = Plane(POSE, half=(0.16, 0.13), squares=(9, 7, 0.03))


@cache
def capture(code: str = "gray", **lighting: object) -> Capture:
    """A capture of the board."""
    sequence = PatternSequence(SIZE, code)
    pictures = photographed(PAIR, BOARD, sequence, np.random.default_rng(0), Lighting(**lighting))  # type: ignore[arg-type]
    return Capture("pose", sequence, np.stack(list(pictures)), sequence.names)


@cache
def truth() -> Lit:
    """What lights the middle of every pixel."""
    return lit_by(PAIR, BOARD, Lighting(samples=1))
