"""Pictures of a bag for cameras alone, as of videos: all of a short one, of a long one the sharpest of every n."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.reading.notes import note
from calibrant.tasks.inputs.bags.topics import Recorded, recorded_pictures
from calibrant.tasks.inputs.picture_times import PictureTimes
from calibrant.tasks.options.bags import BagOptions

if TYPE_CHECKING:
    from calibrant.arrays import Array


def only_camera(options: BagOptions, images: Sequence[str]) -> tuple[str, ...]:
    """Pictures of the camera asked for. Raises: InputError as `recorded_pictures`; for photos beside the bag, or
    several cameras."""
    if images:
        raise InputError(f"{images[0]}: give photos or --bag FILE, not both")
    every = recorded_pictures(options)
    if len(every) > 1:
        raise InputError("this command calibrates one camera: give one --image-topic")
    (recorded,) = every.values()
    rows = _chosen([recorded], [(i,) for i in range(len(recorded.files))])
    return tuple(str(recorded.files[i]) for (i,) in rows if i is not None)


def refuse_beside_bag(**given: object) -> None:
    """Raises: InputError for an option, by its name, that says what the bag says."""
    for option, value in given.items():
        if value:
            raise InputError(
                f"{option}: the bag has the pictures and their times; give --bag FILE or {option}, not both"
            )


@dataclass(frozen=True, eq=False)
class TakenTogether:
    """files: pictures of every camera by its name; times: when each was taken, on the pictures' clock."""

    files: Mapping[str, tuple[str, ...]]
    times: PictureTimes


def taken_together(options: BagOptions, *, names: Sequence[str] = ()) -> TakenTogether:
    """Pictures of several cameras; of many moments the sharpest of every n.

    Args: names: what the cameras must be called, where the command says so.
    Raises: InputError as `recorded_pictures`; for cameras without names, or of other names.
    """
    from calibrant.tasks.inputs.image_moments import matched_images

    every = recorded_pictures(options)
    if len(every) < 2 or (names and set(every) != set(names)):
        asked = " and ".join(f"--image-topic {n}=TOPIC" for n in names or ("NAME", "OTHER"))
        raise InputError(f"which pictures are which camera's? Give {asked}; found {', '.join(every) or 'none'}")
    every = {name: every[name] for name in names or every}
    seconds = {name: dict(zip(p.files, map(float, _since(p, every)))) for name, p in every.items()}
    found = matched_images({name: p.files for name, p in every.items()}, rule="time", times=seconds)
    rows = _chosen(list(every.values()), list(found.rows))
    files = {
        name: tuple(str(p.files[i]) for row in rows if (i := row[k]) is not None)
        for k, (name, p) in enumerate(every.items())
    }
    words = f"times of {options.stamps if options.stamps == 'received' else 'the headers'} in {options.bag}"
    return TakenTogether(files, PictureTimes(seconds, words))


def _since(recorded: Recorded, every: Mapping[str, Recorded]) -> Array:
    """Seconds since the first picture of all."""
    return recorded.seconds - min(float(p.seconds[0]) for p in every.values())


def _chosen(cameras: Sequence[Recorded], rows: Sequence[tuple[int | None, ...]]) -> list[tuple[int | None, ...]]:
    """Moments: all where there are few, else of every n the one whose least sharp picture is the sharpest."""
    import numpy as np

    from calibrant.detection.images.images import load_grey
    from calibrant.detection.images.sharpness import sharpest_together, sharpness
    from calibrant.detection.images.video import MOST_FRAMES

    every = -(-len(rows) // MOST_FRAMES)
    if every < 2:
        return list(rows)
    sharp = np.full((len(cameras), len(rows)), np.nan)
    for k, camera in enumerate(cameras):
        for m, row in enumerate(rows):
            i = row[k]
            if i is not None:
                sharp[k, m] = sharpness(load_grey(Path(camera.files[i])))
    sharp = np.where(np.isnan(sharp), np.nanmedian(sharp, axis=1, keepdims=True), sharp)
    keep = sharpest_together(sharp, every)
    note(f"of {len(rows)} moments of the bag the sharpest of every {every} are taken, {len(keep)}")
    return [rows[m] for m in keep]
