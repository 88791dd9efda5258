"""Lists of images from names, patterns, folders and videos; no image is opened, so that a wrong name is said soon."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from glob import glob, has_magic
from pathlib import Path

from calibrant.detection.images.recordings import source_of
from calibrant.errors import InputError
from calibrant.formats.bags.kinds import is_bag

EXTENSIONS = (
    *(".png", ".jpg", ".jpeg", ".jpe", ".bmp", ".dib", ".tif", ".tiff", ".webp", ".jp2"),
    *(".pbm", ".pgm", ".ppm", ".pnm", ".sr", ".ras", ".gif"),
)
"""What a folder is searched for; a file that is named is read whatever its name."""
PHONES = (".heic", ".heif", ".hif")
"""Read by an optional decoder: looked for, so that none is passed over in silence."""
VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")

_EVERY = re.compile(r"(?P<file>.+)@(?P<every>\d+)")
_FRAME = re.compile(r"\d{6,}")


def expand(paths: Iterable[str | Path] | str | Path) -> list[Path]:
    """Image files of names, patterns (`images/*.png`), folders, videos, bags, in the order given, numbers by value.

    A video stands for its frames, video.mp4@5 for the sharpest of every five; a bag for its only camera's pictures.
    A file that is named twice is taken once.
    Raises: InputError naming the file, pattern or folder that gives no image.
    """
    files: list[Path] = []
    items = list(paths) if isinstance(paths, Iterable) and not isinstance(paths, str) else [paths]
    for item in items:
        if not isinstance(item, str | Path):
            raise InputError(f"images are names of files, folders or patterns; got {item!r}")
        if item == "":  # pathlib takes it for the folder one stands in
            raise InputError("an image's name is empty, as from a shell variable that is not set; '.' is this folder")
        files += _expand_one(Path(item).expanduser())
    if not files:
        raise InputError("no images were given; name image files, a pattern such as 'images/*.png', or a folder")
    unique = {file.resolve(): file for file in reversed(files)}
    return [file for file in dict.fromkeys(files) if unique[file.resolve()] is file]


def expand_together(lists: Sequence[Iterable[str | Path]]) -> list[list[Path]]:
    """Image files of several cameras: as `expand` has them, but of videos the frames of the same numbers.

    Raises: InputError as `expand`.
    """
    named = [[Path(item).expanduser() for item in items if item != ""] for items in lists]
    videos = [video_of(items[0]) if len(items) == 1 else None for items in named]
    told = [v for v in videos if v is not None]
    if len(told) < 2 or len(told) < len(videos):
        return [expand(items) for items in lists]
    from calibrant.detection.images.video import frames_together

    return frames_together([video for video, _ in told], max((n for _, n in told if n is not None), default=None))


def natural_key(path: Path) -> list[tuple[int, int, str]]:
    """Sorts 2.png before 10.png."""
    parts = re.split(r"(\d+)", str(path))
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]


def _expand_one(path: Path) -> list[Path]:
    if is_bag(path):
        return source_of(path).frames(path, None)
    if path.is_dir():
        inside = [p for p in path.iterdir() if p.suffix.lower() in (*EXTENSIONS, *PHONES) and p.is_file()]
        if not inside:
            raise InputError(f"the folder {path} holds no images; looked for {', '.join(EXTENSIONS)}")
        return sorted(inside, key=natural_key)
    video = video_of(path)
    if video is not None:
        from calibrant.detection.images.video import frames

        return frames(*video)
    if path.exists() and not path.is_file():
        raise InputError(
            f"image {path} is a pipe or a device, which can be read once, and a picture is read more often: save it "
            "to a file first"
        )
    if path.exists() or frame_of(path) is not None:
        return [path]
    if has_magic(str(path)):
        matches = [Path(p) for p in glob(str(path), recursive=True)]
        found = [p for p in matches if p.is_file()]
        if not found:
            raise InputError(f"no file matches {path}")
        return [file for match in sorted(found, key=natural_key) for file in _expand_one(match)]
    raise InputError(f"image {path} does not exist")


def video_of(path: Path) -> tuple[Path, int | None] | None:
    """The video and n of a path to a video, with or without @n; None when it is none."""
    if path.suffix.lower() in VIDEOS and path.is_file():
        return path, None
    match = _EVERY.fullmatch(str(path))
    if match is None or Path(match["file"]).suffix.lower() not in VIDEOS:
        return None
    if not Path(match["file"]).is_file():
        raise InputError(f"video {match['file']} does not exist")
    if int(match["every"]) < 1:
        raise InputError(f"{path}: the number after @ says of how many frames one is taken; it is at least 1")
    return Path(match["file"]), int(match["every"])


def frame_of(path: Path) -> tuple[Path, int] | None:
    """The recording, a video or a bag, and frame number of a frame's name; None when it is none."""
    recording = path.parent
    if not _FRAME.fullmatch(path.name):
        return None
    is_video = recording.suffix.lower() in VIDEOS and recording.is_file()
    return (recording, int(path.name)) if is_video or is_bag(recording) else None
