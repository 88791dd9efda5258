"""A photo under two cameras' names is one measurement that would count twice, a copy of it too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from calibrant.errors import InputError
from calibrant.tasks.inputs import session


def refuse_shared_photos(files: Mapping[str, Sequence[Path]], *, option: Callable[[str], str]) -> None:
    """Args: files of each list, those of one camera under its name; option: the option that named them.

    Frames count as their video, those of a bag, which has several cameras', as themselves. Raises: InputError naming
    both files, before anything is searched.
    """
    from calibrant.detection.images.files import frame_of
    from calibrant.formats.bags.kinds import is_bag

    videos = {f: place[0] for listed in files.values() for f in listed if (place := frame_of(f)) is not None}
    files = {camera: list(dict.fromkeys(videos.get(f, f) for f in listed)) for camera, listed in files.items()}
    files = {camera: [f for f in listed if not is_bag(f)] for camera, listed in files.items()}
    sizes = Counter(f.stat().st_size for listed in files.values() for f in listed)
    owner: dict[str, tuple[str, Path]] = {}
    for camera, listed in files.items():
        # Files of a size of their own are copies of none.
        for record in session.file_records(f for f in listed if sizes[f.stat().st_size] > 1):
            first, file = owner.setdefault(record["sha256"], (camera, Path(record["file"])))
            if first != camera:
                same = file.resolve() == Path(record["file"]).resolve()
                found = (
                    f"{file} is a photo of {first} and of {camera}"
                    if same
                    else f"{file} of {first} and {record['file']} of {camera} are one photo, byte by byte"
                )
                raise InputError(
                    f"{option(camera)}: {found}; each camera has photos of its own: give {camera} another folder"
                )
