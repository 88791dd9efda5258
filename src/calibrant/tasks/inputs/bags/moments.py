"""The moments of a bag in which robot and picture stand still: one picture of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError
from calibrant.reading.notes import note
from calibrant.tasks.inputs.bags.motion import RobotMotion, covered
from calibrant.tasks.inputs.bags.topics import Recorded

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.geometry.motion import Motion

MARGIN_S = 0.1
"""Pictures so near to a stretch's ends may have been taken on the move, where the clocks differ."""
FEWEST = 3
_SPARSE_S = 0.5
"""Poses further apart than this are snapshots, one for each picture, not a motion that was recorded."""
_NEAR = 0.25
"""Of the time between snapshots: a picture further from every one of them belongs to none."""
_SIDE_PX = 160
_CHANGE_GREY, _TIMES_USUAL = 1.0, 4.0
"""What two pictures of a moment may differ by, rms: grey levels beyond what noise makes of most moments' pictures."""


@dataclass(frozen=True, eq=False)
class StillPictures:
    """pictures: one of each moment; T (n, 4, 4) the robot's pose at each; words: how they were found."""

    pictures: Recorded
    T: Array
    words: str


def still_pictures(robot: RobotMotion, recorded: Recorded, *, offset: float) -> StillPictures:
    """One picture of every still moment, in time.

    Args: offset: what is added to the pictures' times to be the robot's, seconds.
    Raises: RefusedError where there are fewer than three moments; InputError where nothing was recorded together.
    """
    motion = robot.motion
    t = recorded.seconds + offset
    covered(robot, recorded.seconds, offset=offset, what=recorded.topic)
    stretches = _of_different_poses(motion, motion.still())
    chosen = [(k, a, b) for a, b in stretches if (k := _middle(t, a, b)) is not None]
    kept, changing = _unchanging(recorded, t, chosen)
    if len(kept) < FEWEST and motion.step > _SPARSE_S:
        return _snapshots(motion, recorded, t)
    if len(kept) < FEWEST:
        raise RefusedError(_none_still(motion, stretches, len(chosen), changing))
    if changing:
        named = ", ".join(recorded.files[k].name for k in changing)
        note(f"pictures that still change while the robot's poses stand are left out: {named}")
    keep = [k for k, _, _ in kept]
    room = min(min(t[k] - a, b - t[k]) for k, a, b in kept)
    words = (
        f"{len(keep)} still moments of {robot.words}, a picture of each, {1e3 * room:.0f} ms or more within its "
        "moment: clocks that differ by less change nothing. By how much they differ is not found from still moments; "
        "pictures on the move tell it (calibrant time-offset --bag, or --moments moving)"
    )
    return StillPictures(recorded.only(keep), motion.at(t[keep]), words)


def _middle(t: Array, begin: float, end: float) -> int | None:
    """The picture nearest to the middle of a stretch, and away from its ends."""
    import numpy as np

    margin = min(MARGIN_S, (end - begin) / 4)
    k = int(np.argmin(np.abs(t - (begin + end) / 2)))
    return k if begin + margin <= t[k] <= end - margin else None


def _of_different_poses(motion: Motion, stretches: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Of neighbouring stretches at one pose the longest: a robot that trembles has not moved on."""
    import numpy as np

    from calibrant.geometry import se3
    from calibrant.geometry.motion import STILL_M, STILL_RAD

    out: list[tuple[float, float]] = []
    for stretch in stretches:
        if out:
            before, here = motion.at([sum(out[-1]) / 2, sum(stretch) / 2])
            away = np.abs(se3.local(before, here))
            if away[:3].max() < STILL_RAD and away[3:].max() < STILL_M:
                out[-1] = max(out[-1], stretch, key=lambda s: s[1] - s[0])
                continue
        out.append(stretch)
    return out


def _unchanging(
    recorded: Recorded, t: Array, chosen: Sequence[tuple[int, float, float]]
) -> tuple[list[tuple[int, float, float]], list[int]]:
    """The moments whose picture equals its neighbour within the same stretch but for noise, and pictures of others."""
    import numpy as np

    changes = np.full(len(chosen), np.nan)
    for i, (k, begin, end) in enumerate(chosen):
        beside = [j for j in (k - 1, k + 1) if 0 <= j < len(t) and begin <= t[j] <= end]
        if beside:
            changes[i] = max(_change(recorded, k, j) for j in beside)
    told = changes[np.isfinite(changes)]
    limit = _CHANGE_GREY + _TIMES_USUAL * float(np.median(told)) if len(told) else np.inf
    moves = np.nan_to_num(changes, nan=0.0) > limit
    return [c for c, m in zip(chosen, moves) if not m], [c[0] for c, m in zip(chosen, moves) if m]


def _change(recorded: Recorded, one: int, other: int) -> float:
    """Root mean square difference of two small pictures, grey levels."""
    import numpy as np

    from calibrant.detection.images.images import load_grey
    from calibrant.opencv import cv2

    small = []
    for k in (one, other):
        grey = load_grey(recorded.files[k])
        factor = max(1, round(max(grey.shape) / _SIDE_PX))
        size = (max(1, grey.shape[1] // factor), max(1, grey.shape[0] // factor))
        small.append(cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float64))
    if small[0].shape != small[1].shape:
        return float("inf")
    return float(np.sqrt(np.mean((small[0] - small[1]) ** 2)))


def _snapshots(motion: Motion, recorded: Recorded, t: Array) -> StillPictures:
    """Poses that were recorded once for each picture: each with the picture nearest in time."""
    import numpy as np

    pairs = [(int(np.argmin(np.abs(t - moment))), i) for i, moment in enumerate(motion.times)]
    near = [(k, i) for k, i in pairs if abs(t[k] - motion.times[i]) < _NEAR * motion.step]
    chosen = dict(sorted(near, key=lambda pair: -abs(t[pair[0]] - motion.times[pair[1]])))
    if len(chosen) < FEWEST:
        raise InputError(
            f"the robot's poses are {motion.step:.2g} s apart, too far to say how it moved between, and {len(chosen)} "
            f"pictures of {recorded.topic} were taken at one; record tf at 10 Hz or more, or a pose with every picture"
        )
    keep = sorted(chosen)
    words = f"{len(keep)} pictures, each with the pose nearest in time: poses are {motion.step:.2g} s apart"
    return StillPictures(recorded.only(keep), motion.T[[chosen[k] for k in keep]], words)


def _none_still(motion: Motion, stretches: Sequence[tuple[float, float]], seen: int, changing: Sequence[int]) -> str:
    from calibrant.geometry.motion import STILL_WINDOW_S

    lasted = motion.times[-1] - motion.times[0]
    found = f"{len(stretches)} in {lasted:.1f} s, {seen} of them with a picture"
    found += f", of which {len(changing)} still change" if changing else ""
    return (
        f"the bag has no {FEWEST} still moments: {found}. Hold the robot at each pose for half a second "
        f"({STILL_WINDOW_S:g} s is the least); or take pictures on the move (--moments moving), for which the offset "
        "of the clocks is found"
    )
