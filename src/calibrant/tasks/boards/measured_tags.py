"""Tags at unknown places, measured from photos of one camera: a rig of one, and the bundle's file that it comes to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.sources import kept
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.images import SearchOptions
from calibrant.tasks.options.words import split_names
from calibrant.tasks.outcome import Document, Outcome

if TYPE_CHECKING:
    from rich.console import RenderableType

    from calibrant.data import CalibrationResult, Observations
    from calibrant.targets.marker import Marker

EXAMPLE = "marker:50mm:DICT_APRILTAG_36h11:3,4,7"


@dataclass(frozen=True)
class TagPhotos:
    """spec: the tags, with all their ids; out: the YAML file to write."""

    spec: str
    images: tuple[str, ...]
    camera: Path
    out: Path
    search: SearchOptions

    def files(self) -> list[Path]:
        """The photos. Raises: InputError where there are none."""
        from calibrant.detection.images.files import expand

        files = expand(list(self.images))
        keep = kept([f.name for f in files], split_names(self.search.exclude), what="image")
        return [f for f, k in zip(files, keep) if k]


def measured_tags(asked: TagPhotos, listener: Listener) -> Outcome:
    """The bundle's file, and how well it is known.

    Raises: InputError for a spec that names no tags; RefusedError where photos do not tie them.
    """
    from calibrant.calibrate.cell.rig import calibrate_rig
    from calibrant.formats.cameras.read import read_camera
    from calibrant.targets.bundle import bundle_text

    tags = _tags(asked.spec)
    if asked.out.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--out {asked.out}: what photos tell of tags is a YAML file; name one, such as bundle.yaml")
    seen = _seen(asked, tags, listener)
    size = next(iter(seen.image_sizes.values()))
    lens = read_camera(asked.camera, image_size=size)
    session.load_solver(listener)
    with listener.status("Calibrating …"):
        result = calibrate_rig(_by_tag(seen, tags), cameras={"camera": lens}, rigid=[tuple(tags)])
    result = replace(result, inputs=session.file_records([*asked.files(), asked.camera]))
    first = next(iter(tags))
    places = {tags[first].id: None} | {tags[name].id: result.transform(first, name) for name in list(tags)[1:]}
    text = bundle_text(
        {tag.id: (tag.dictionary, tag.side) for tag in tags.values()},
        {i: None if T is None else T.matrix for i, T in places.items()},
        {i: None if T is None else T.sigma_translation_mm for i, T in places.items()},
    )
    return Outcome(documents=(Document(asked.out, text.encode()),), summary=partial(_said, asked.out, result))


def _tags(spec: str) -> dict[str, Marker]:
    """The tags of marker:SIDE:DICTIONARY:IDS by their names. Raises: InputError for another spec, or one tag."""
    from calibrant.targets.marker import Marker
    from calibrant.targets.registry import parse_target

    head, _, ids = spec.rpartition(":")
    names = [word.strip() for word in ids.split(",") if word.strip()]
    if not spec.startswith("marker:") or len(names) < 2 or len(set(names)) < len(names):
        raise InputError(
            f"--from-photos measures tags: a spec with the ids of two or more, such as {EXAMPLE}; got {spec!r}"
        )
    tags = [parse_target(f"{head}:{name}") for name in names]
    return {f"tag{tag.id}": tag for tag in tags if isinstance(tag, Marker)}


def _seen(asked: TagPhotos, tags: Mapping[str, Marker], listener: Listener) -> Observations:
    """All tags in all photos. Raises: InputError naming tags that none shows."""
    from calibrant.targets.bundle import Bundle

    # Tags are found one by one: where they stand to each other plays no part yet.
    corners = tuple((tag.id, tuple(map(tuple, tag.points.tolist()))) for tag in tags.values())
    bundle = Bundle(str(asked.out), next(iter(tags.values())).dictionary, tuple(sorted(corners)))
    seen = session.detect_boards(
        asked.files(),
        bundle,
        mirror_x=asked.search.mirror_x,
        workers=asked.search.workers,
        cache=asked.search.cache,
        listener=listener,
    )
    shown = {int(i) // 4 for view in seen.views for i in view.point_ids}
    missing = [name for name, tag in tags.items() if tag.id not in shown]
    if missing:
        raise InputError(
            f"{', '.join(missing)} is in none of {len(asked.files())} photos; leave its id out, or add some"
        )
    return seen


def _by_tag(seen: Observations, tags: Mapping[str, Marker]) -> dict[str, Observations]:
    """The views of each tag, in its own frame, under the moment of their photo."""
    out = {}
    for name, tag in tags.items():
        views = []
        for view in seen.views:
            mine = view.point_ids // 4 == tag.id
            if mine.any():
                part = view.subset(mine)
                corner = part.point_ids - 4 * tag.id
                views.append(replace(part, points=tag.points[corner], point_ids=corner, moment=view.id))
        out[name] = replace(seen, views=tuple(views), missed=(), target=tag.spec)
    return out


def _said(out: Path, result: CalibrationResult) -> Sequence[RenderableType | CalibrationResult]:
    from rich.text import Text

    return (result, Text(f"{out}: the tags as one target, for --target"))
