"""The photos of now that a verification is given, and the target in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import DetectionError, InputError
from calibrant.tasks.inputs.sources import Source, kept
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.verify.sides import Compare

if TYPE_CHECKING:
    from calibrant.data import Observations


def every_photo(photos: NamedPhotoOptions, search: SearchOptions) -> list[tuple[Path, bool]]:
    """All photos that are named, and whether each is kept. Raises: InputError for none."""
    from calibrant.data.file_names import distinct_names
    from calibrant.detection.images.files import expand

    if not photos.images:
        raise InputError("no photos were given: take some of now and name them with --images")
    files = expand(list(photos.images))
    names = list(distinct_names(files).values())
    return list(zip(files, kept(names, split_names(search.exclude), what="image")))


def photo_files(photos: NamedPhotoOptions, search: SearchOptions) -> list[Path]:
    """The photos of now. Raises: InputError for none."""
    return [file for file, keep in every_photo(photos, search) if keep]


def target_seen(
    compare: Compare, files: list[Path], search: SearchOptions, listener: Listener, *, optional: bool
) -> Observations | None:
    """The target in the photos of now; None where no target is named, and where an optional one is in no photo."""
    if compare.target is None:
        return None
    search = replace(search, exclude=())  # left out already
    source = Source(tuple(map(str, files)), compare.target, None, search, None, listener)
    try:
        found = source.read(files)
    except DetectionError:
        if not optional:
            raise
        return None
    name = compare.name
    views = tuple(replace(v, camera=name) for v in found.views)
    sizes = dict.fromkeys((name,), next(iter(found.image_sizes.values())))
    missed = tuple(replace(m, camera=name) for m in found.missed)
    return replace(found, views=views, image_sizes=sizes, missed=missed)
