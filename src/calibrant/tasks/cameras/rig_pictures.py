"""The images of a rig's cameras: matched by their moments, every camera searched for every board by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import DetectionError, InputError
from calibrant.tasks.inputs.image_moments import ImageMoments, images_by_moment, matched_images
from calibrant.tasks.inputs.moment_times import moment_times
from calibrant.tasks.inputs.picture_times import EVERY, PictureTimes, read_picture_times
from calibrant.tasks.inputs.second_look import looked_again
from calibrant.tasks.inputs.seen_together import of_camera, together
from calibrant.tasks.inputs.shared_photos import refuse_shared_photos
from calibrant.tasks.inputs.sources import Source, kept
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.images import CornerOptions, RigSearchOptions, SearchOptions
from calibrant.tasks.options.words import split_names

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from calibrant.data import CalibrationResult, Observations

ONLY_BOARD = "target"
"""The name of a board that was given none."""


@dataclass(frozen=True, eq=False)
class RigPictures:
    """images: of each camera by name; specs: by camera, the spec of every board it is searched for, by the board's
    name; observations: a file of points of all cameras instead; fps: pictures a second, table: a file of when each
    picture was taken, where they are said; recorded: the same of pictures in a bag; known: by board and camera, what
    was found in these images before, in place of a search."""

    images: Mapping[str, tuple[str, ...]]
    specs: Mapping[str, Mapping[str, str]]
    observations: Path | None
    rule: str
    fps: float | None
    table: Path | None
    search: RigSearchOptions
    corners: CornerOptions
    listener: Listener
    recorded: PictureTimes | None = None
    known: Mapping[str, Mapping[str, Observations]] | None = None

    @property
    def mirrored(self) -> tuple[str, ...]:
        """Cameras that deliver mirror images."""
        return split_names(self.search.mirror)

    @cached_property
    def files(self) -> dict[str, list[Path]]:
        """All images of each camera. Raises: InputError for boards that are none, no images, shared ones."""
        from calibrant.detection.images.files import expand_together

        for camera, boards in self.specs.items():
            for spec in boards.values():
                Source(images=self.images[camera], target=spec).check_photos()
        files = dict(zip(self.images, expand_together(list(self.images.values()))))
        refuse_shared_photos(files, option=lambda name: f"--images {name}=…")
        return files

    @cached_property
    def found(self) -> ImageMoments | None:
        """The moments; None for points found before, whose views say theirs, and for one camera alone."""
        if len(self.images) < 2:
            return None
        if self.rule != "time" or self.own_times is None:
            return matched_images(self.files, rule=self.rule)
        self.own_times.require(self.files, EVERY)
        return matched_images(self.files, rule=self.rule, times=self.own_times.seconds)

    @cached_property
    def moments(self) -> dict[str, dict[Path, str]]:
        """By camera, the moment of every image that is kept: one of which an image is excluded goes whole.

        Raises: InputError for names to exclude that are not there, or when nothing stays.
        """
        if self.observations is not None:
            return {}
        names = sorted({file.name for files in self.files.values() for file in files})
        keep = dict(zip(names, kept(names, split_names(self.search.exclude), what="image")))
        if self.found is None:
            return {c: {f: f.name for f in files if keep[f.name]} for c, files in self.files.items()}
        return images_by_moment(self.files, self.found, keep)

    @property
    def matched(self) -> str:
        """How images were matched, in words; empty where they were not."""
        return "" if self.observations is not None or self.found is None else self.found.words

    @cached_property
    def own_times(self) -> PictureTimes | None:
        """What the table of times says. Raises: InputError as `read_picture_times`."""
        return self.recorded if self.table is None else read_picture_times(self.table, self.files)

    @property
    def times(self) -> dict[str, float] | dict[str, dict[str, float]]:
        """Seconds by moment, or by camera and moment; empty where nothing tells them.

        Raises: InputError as `moment_times`, and as `PictureTimes.by_moment`.
        """
        if self.own_times is not None:
            return self.own_times.by_moment(self.moments)
        if self.observations is not None or self.found is None:
            return {}
        return moment_times(self.files, self.found, fps=self.fps)

    @property
    def inputs(self) -> list[Path]:
        """Every file that is read: of frames their video."""
        table = [] if self.table is None else [self.table]
        if self.observations is not None:
            return [self.observations]
        from calibrant.detection.images.files import frame_of

        used = [file for files in self.moments.values() for file in files]
        return [*dict.fromkeys(place[0] if (place := frame_of(file)) else file for file in used), *table]

    def read(self) -> dict[str, Observations]:
        """What the cameras saw of each board, by its name. Raises: InputError, DetectionError naming the camera."""
        from calibrant.executors import executor_for

        if self.observations is not None:
            return {ONLY_BOARD: self._points_of(self.observations)}
        if self.known is not None:
            return {
                board: together([_of_moments(seen, c, self.moments[c]) for c, seen in by_camera.items()])
                for board, by_camera in self.known.items()
            }
        parts: dict[str, list[Observations]] = {}
        with executor_for(self.search.workers, sum(map(len, self.moments.values()))) as executor:
            for camera, moments in self.moments.items():
                for board, seen in self._read_camera(camera, moments, executor).items():
                    parts.setdefault(board, []).append(seen)
        return {board: together(parts[board]) for board in next(iter(self.specs.values())) if board in parts}

    def _read_camera(
        self, camera: str, moments: Mapping[Path, str], executor: Executor | None
    ) -> dict[str, Observations]:
        """What a camera saw of the boards that it saw; an image that shows one of them is not missed."""
        found: dict[str, Observations] = {}
        none: list[str] = []
        for board, spec in self.specs[camera].items():
            try:
                seen = self._source(camera, spec).read(list(moments), executor=executor)
            except DetectionError as error:
                none.append(str(error) if len(self.specs[camera]) == 1 else f"{board}: {error}")
                continue
            found[board] = of_camera(seen, camera, moments)
        if not found:
            raise DetectionError(f"camera {camera}: {'; '.join(none)}")
        shown = {v.file for seen in found.values() for v in seen.views}
        first = next(iter(found))
        return {
            board: replace(seen, missed=tuple(m for m in seen.missed if board == first and m.file not in shown))
            for board, seen in found.items()
        }

    def look_again(self, found: Mapping[str, Observations], result: CalibrationResult) -> Mapping[str, Observations]:
        """The observations with the corners that known cameras help to find, and parts of chessboards that other
        cameras number; itself where none was found."""
        if not self.images:
            return found
        sources = {
            board: {camera: self._source(camera, self.specs[camera][board]) for camera in seen.image_sizes}
            for board, seen in found.items()
        }
        return looked_again(found, result, sources=sources, moments=self.moments)

    def _source(self, camera: str, spec: str) -> Source:
        search = SearchOptions(mirror_x=camera in self.mirrored, workers=self.search.workers, cache=self.search.cache)
        beside = tuple(other for other in self.specs[camera].values() if other != spec)
        return Source(
            target=spec,
            search=search,
            refinement=self.corners.refinement(),
            listener=self.listener,
            beside=beside,
            mirror_option=f"--mirror {camera}",
        )

    def _points_of(self, file: Path) -> Observations:
        found = Source(observations=file).read([])
        if len(found.image_sizes) < 2:
            raise InputError(f"{file} holds views of {', '.join(found.image_sizes)} alone; a rig takes two cameras")
        return found


def _of_moments(seen: Observations, camera: str, moments: Mapping[Path, str]) -> Observations:
    """What a camera saw in the images that count, under its name and their moments."""
    files = {str(file) for file in moments}
    views = tuple(v for v in seen.views if v.file in files)
    missed = tuple(m for m in seen.missed if m.file in files)
    return of_camera(replace(seen, views=views, missed=missed), camera, moments)
