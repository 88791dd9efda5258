"""Own points read for images: the files beside them, and the images' size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.data import Observations
    from calibrant.targets.point_folder import PointFolder


def read_beside(images: Sequence[Path], target: PointFolder, *, mirror_x: bool, camera: str) -> Observations:
    """Observations of images whose points were found by other means.

    Raises: InputError for --mirror-x, images that cannot be read or differ in size, and as `own_observations`.
    """
    from calibrant.detection.images.images import load_grey
    from calibrant.formats.points_yaml import own_observations

    if mirror_x:
        raise InputError(
            "--mirror-x flips photos before they are searched; own points are taken as they are: leave it out"
        )
    sizes = {image: load_grey(image).shape[::-1] for image in images}
    first = images[0]
    for image, size in sizes.items():
        if size != sizes[first]:
            raise InputError(
                f"images of two sizes: {first.name} is {sizes[first][0]}x{sizes[first][1]}, {image.name} is "
                f"{size[0]}x{size[1]}; one camera takes images of one size: leave out the others"
            )
    width, height = sizes[first]
    return own_observations(images, target, image_size=(int(width), int(height)), camera=camera)


def files_beside(images: Sequence[Path], spec: str | None) -> list[Path]:
    """The files that hold the images' points; none for targets that are detected."""
    from calibrant.formats.points_yaml import file_of
    from calibrant.targets.point_folder import PointFolder
    from calibrant.targets.registry import parse_target

    target = parse_target(spec) if spec else None
    if not isinstance(target, PointFolder):
        return []
    return [file for image in images if (file := file_of(target, image.stem)) is not None]
