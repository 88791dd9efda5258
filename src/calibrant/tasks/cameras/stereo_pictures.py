"""The images of a stereo pair: paired, searched a side by itself, and named by their moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import DetectionError, InputError
from calibrant.tasks.inputs.by_partner import numbered_by_partners
from calibrant.tasks.inputs.by_side import SIDES
from calibrant.tasks.inputs.image_moments import ImageMoments, images_by_moment, matched_images
from calibrant.tasks.inputs.picture_times import EVERY, PictureTimes, read_picture_times
from calibrant.tasks.inputs.seen_together import of_camera, together
from calibrant.tasks.inputs.shared_photos import refuse_shared_photos
from calibrant.tasks.inputs.sources import Source, kept
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.images import CornerOptions, PairSearchOptions, SearchOptions
from calibrant.tasks.options.words import split_names

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations


@dataclass(frozen=True, eq=False)
class StereoPictures:
    """sources: of each side, by name; or one file of points of both cameras (observations). rule: how images pair;
    mirrored: sides whose camera delivers mirror images; exclude: names of images whose pairs are left out; table: a
    file of when each image was taken, by which they pair; recorded: the same of
    pictures in a bag."""

    sources: Mapping[str, Source]
    observations: Path | None
    rule: str
    mirrored: tuple[str, ...]
    exclude: tuple[str, ...]
    table: Path | None = None
    recorded: PictureTimes | None = None

    @cached_property
    def every_file(self) -> dict[str, list[Path]]:
        """All images of each side. Raises: InputError as `Source.files`."""
        from calibrant.detection.images.files import expand_together

        for source in self.sources.values():
            source.check_photos()
        files = dict(zip(self.sources, expand_together([source.images for source in self.sources.values()])))
        refuse_shared_photos(files, option=lambda side: f"--{side}")
        return files

    @cached_property
    def found(self) -> ImageMoments | None:
        """The pairs; None for points found before, whose views say their moments."""
        if not self.sources:
            return None
        if self.times is None:
            return matched_images(self.every_file, rule=self.rule)
        self.times.require(self.every_file, EVERY)
        return matched_images(self.every_file, rule="time", times=self.times.seconds)

    @cached_property
    def times(self) -> PictureTimes | None:
        """What the table says. Raises: InputError as `read_picture_times`."""
        return self.recorded if self.table is None else read_picture_times(self.table, self.every_file)

    @property
    def paired(self) -> str:
        """How images were paired, in words."""
        if self.found is None:
            return ""
        return self.found.words if self.times is None else f"{self.found.words}; {self.times.words}"

    @cached_property
    def moments(self) -> dict[str, dict[Path, str]]:
        """By side, the moment of every image that is kept: a pair of which one is excluded goes whole.

        Raises: InputError for names to exclude that are not there, or when nothing stays.
        """
        if self.found is None:
            return {}
        names = [file.name for files in self.every_file.values() for file in files]
        keep = dict(zip(names, kept(names, self.exclude, what="image")))
        return images_by_moment(self.every_file, self.found, keep)

    @property
    def inputs(self) -> list[Path]:
        """Every file that is read."""
        if self.observations is not None:
            return [self.observations]
        table = [] if self.table is None else [self.table]
        return [*(f for side, source in self.sources.items() for f in source.inputs(list(self.moments[side]))), *table]

    def read(self) -> Observations:
        """What both cameras saw. Raises: InputError, DetectionError."""
        if self.observations is not None:
            return _of_two(Source(observations=self.observations).read([]), self.observations)
        return together([of_camera(self._seen(side, files), side, files) for side, files in self.moments.items()])

    def _seen(self, side: str, files: Mapping[Path, str]) -> Observations:
        """What one camera saw. Raises: DetectionError that names it, where that is nothing."""
        try:
            return self.sources[side].read(list(files))
        except DetectionError as error:
            raise DetectionError(f"camera {side}: {error}") from error

    def look_again(self, found: Observations, result: CalibrationResult) -> Observations:
        """The observations with the corners that known cameras help to find, and parts of a chessboard that the other
        camera numbers; itself where none was found."""
        more: dict[str, Observations] = {}
        for side, source in self.sources.items():
            mine = found.of_camera(side)
            again = source.look_again(mine, result.cameras[side])
            if again is not mine:
                more[side] = again
        if more:
            views = tuple(v for side in SIDES for v in more.get(side, found.of_camera(side)).views)
            found = replace(found, views=views)
        return numbered_by_partners(found, result, sources=self.sources, moments=self.moments)


def _of_two(found: Observations, file: Path) -> Observations:
    """Raises: InputError for points of other than two cameras."""
    if len(found.image_sizes) != 2:
        named = ", ".join(found.image_sizes)
        raise InputError(
            f"{file} holds points of {len(found.image_sizes)} cameras ({named}), a stereo pair has two; give --left "
            "and --right, or a result of calibrant stereo"
        )
    return found


def pictures_of(
    *,
    left: Sequence[str],
    right: Sequence[str],
    targets: Mapping[str, str],
    observations: Path | None,
    rule: str,
    table: Path | None,
    recorded: PictureTimes | None = None,
    search: PairSearchOptions,
    corners: CornerOptions,
    listener: Listener,
) -> StereoPictures:
    """What the options say. Raises: InputError for options that contradict each other, or a side without images."""
    exclude = split_names(search.exclude)
    mirrored = tuple(side for side, asked in zip(SIDES, (search.mirror_left, search.mirror_right)) if asked)
    if observations is not None:
        if left or right:
            raise InputError("give --left and --right, or --observations FILE, not both")
        if mirrored:
            raise InputError(f"--mirror-{mirrored[0]} flips images; the points in --observations are taken as they are")
        if table is not None:
            raise InputError("--times says when each image was taken: leave out --observations, whose points have none")
        return StereoPictures({}, observations, rule, (), exclude)
    if table is not None and rule not in ("auto", "time"):
        raise InputError(f"--times says which images were taken at once: leave out --pairs {rule}")
    images = dict(zip(SIDES, (tuple(left), tuple(right))))
    for side, given in images.items():
        if not given:
            raise InputError(f"no images of the {side} camera were given: --{side} IMAGES, or --observations FILE")
    sources = {
        side: Source(
            images=images[side],
            target=targets.get(side),
            search=SearchOptions(mirror_x=side in mirrored, workers=search.workers, cache=search.cache),
            refinement=corners.refinement(),
            listener=listener,
            mirror_option=f"--mirror-{side}",
        )
        for side in SIDES
    }
    return StereoPictures(sources, None, rule, mirrored, exclude, table, recorded)
