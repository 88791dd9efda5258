"""Where a task's observations come from: photos that it searches, or a file of points found before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import CornerOptions, PhotoOptions, PointsOptions, SearchOptions
from calibrant.tasks.options.words import split_names

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from calibrant.cameras import Camera
    from calibrant.data import Observations
    from calibrant.detection.subpixel.refinement import Refinement

_LISTED = 6
"""Names a message lists before it stops with an ellipsis."""
MIRROR_X = "--mirror-x"
"""What flips images where a command has one camera."""


@dataclass(frozen=True)
class Source:
    """The arguments that say what is observed, as given."""

    images: tuple[str, ...] = ()
    target: str | None = None
    observations: Path | None = None
    search: SearchOptions = SearchOptions()
    refinement: Refinement | None = None
    listener: Listener = SILENT
    beside: tuple[str, ...] = ()
    """Other boards that the photos show too."""
    mirror_option: str = MIRROR_X
    """What flips this camera's images, as the command that asks has it."""

    @classmethod
    def of(
        cls,
        photos: PhotoOptions,
        search: SearchOptions,
        listener: Listener,
        *,
        points: PointsOptions | None = None,
        corners: CornerOptions | None = None,
    ) -> Source:
        """What a request's groups of options say. Raises: InputError for corners that cannot be measured so."""
        return cls(
            images=photos.images,
            target=photos.target,
            observations=None if points is None else points.observations,
            search=search,
            refinement=None if corners is None else corners.refinement(),
            listener=listener,
        )

    @property
    def exclude(self) -> tuple[str, ...]:
        """Names to leave out, each on its own."""
        return split_names(self.search.exclude)

    def files(self) -> list[Path]:
        """The photos, without those excluded; none when the points are read from a file.

        Raises: InputError for arguments that contradict each other, no photos, names that are not there.
        """
        if self.observations is not None:
            self._check_file_alone()
            return []
        self.check_photos()
        return [f for f, k in self.every_file() if k]

    def check_photos(self) -> None:
        """Raises: InputError where no photos are named, or no board, or one that is none."""
        if not self.images:
            after = " (words after --exclude or --fix, up to the next option, are its values: put the images first)"
            raise InputError(
                "no images were given; name image files, a pattern such as 'images/*.png', a folder, or "
                f"--observations FILE{after if self.exclude else ''}"
            )
        if self.target is None:
            raise InputError("photos need the board they show: --target, such as chessboard:9x6:25mm")
        from calibrant.targets.registry import parse_target

        parse_target(self.target)  # a misspelt board is said before anything else is looked at

    def every_file(self) -> list[tuple[Path, bool]]:
        """All photos that are named, and whether each is kept. Raises: InputError as `files`."""
        from calibrant.data.file_names import distinct_names
        from calibrant.detection.images.files import expand

        files = expand(list(self.images))
        return list(zip(files, kept(list(distinct_names(files).values()), self.exclude, what="image")))

    def read(self, files: Sequence[Path], *, executor: Executor | None = None) -> Observations:
        """The observations: of `files`, which `files()` gave, or of the file of points. Raises: InputError.

        executor: where several sources are searched by one; else as the options say.
        """
        if self.observations is None:
            try:
                return self._search(files, executor)
            except InputError as error:
                said = str(error)
                if MIRROR_X not in said or self.mirror_option == MIRROR_X:
                    raise
                raise type(error)(said.replace(MIRROR_X, self.mirror_option)) from error
        from calibrant.data.result_file import read_observations

        found = read_observations(self.observations)
        if self.target is not None:
            self._check_target(found)
        names = [v.id for v in found.views] + [m.id for m in found.missed]
        keep = dict(zip(names, kept(names, self.exclude, what="view")))
        return replace(
            found,
            views=tuple(v for v in found.views if keep[v.id]),
            missed=tuple(m for m in found.missed if keep[m.id]),
        )

    def _search(self, files: Sequence[Path], executor: Executor | None) -> Observations:
        return session.detect_boards(
            files,
            self.target or "",
            mirror_x=self.search.mirror_x,
            workers=executor or self.search.workers,
            cache=self.search.cache,
            refinement=self.refinement,
            listener=self.listener,
            beside=self.beside,
        )

    def look_again(self, found: Observations, camera: Camera) -> Observations:
        """The observations with the corners of ChArUco boards that a known camera helps to find; only where photos are
        at hand, and itself where none was found."""
        from calibrant.targets.registry import parse_target

        # Detectors of other boards are neither loaded nor compiled.
        if self.observations is not None or parse_target(self.target or "").kind != "charuco":
            return found
        from calibrant.detection.charuco.second_look import look_again
        from calibrant.detection.subpixel.refinement import DEFAULT

        with self.listener.status("Looking again, with the camera …"):
            return look_again(
                found,
                camera,
                workers=self.search.workers,
                mirror_x=self.search.mirror_x,
                refinement=self.refinement or DEFAULT,
            )

    def inputs(self, files: Sequence[Path]) -> list[Path]:
        """Every file that was read."""
        if self.observations is not None:
            return [self.observations]
        from calibrant.tasks.inputs.own_points import files_beside

        return [*files, *files_beside(files, self.target)]

    def _check_file_alone(self) -> None:
        if self.images:
            raise InputError("give photos or --observations FILE, not both")
        if self.search.mirror_x:
            raise InputError(
                "--mirror-x flips photos; the points in --observations are taken as they are: leave it out"
            )

    def _check_target(self, found: Observations) -> None:
        from calibrant.targets.registry import parse_target

        asked = parse_target(self.target or "").spec
        if found.target is not None and asked != found.target:
            raise InputError(
                f"{self.observations} holds points of {found.target}, --target says {asked}; leave --target out, or "
                "detect again"
            )


def kept(names: Sequence[str], exclude: Sequence[str], *, what: str) -> list[bool]:
    """Which names stay; a name with its folder leaves out that one alone, where there are such.

    Raises: InputError for a name to exclude that is not there, or when nothing stays.
    """
    forms = [{name, PurePath(name).name, PurePath(name).stem} for name in names]
    out = {wanted if wanted in names else PurePath(wanted).name for wanted in exclude}
    for wanted in exclude:
        if not any({wanted, PurePath(wanted).name} & form for form in forms):
            listed = ", ".join(names[:_LISTED]) + (" …" if len(names) > _LISTED else "")
            raise InputError(f"--exclude {wanted}: no {what} of that name; there are {listed}")
    keep = [not (form & out) for form in forms]
    if not any(keep):
        raise InputError(f"--exclude leaves out all of {len(names)} {what}s; nothing is left to calibrate from")
    return keep
