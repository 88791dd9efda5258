"""From image files to observations: every image on its own, in this process or in any executor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Grey
from calibrant.cancel import checkpoint
from calibrant.data import DEFAULT_CAMERA, Missed, Observations, View
from calibrant.data.file_names import distinct_names
from calibrant.data.observations import ONE_SIZE
from calibrant.detection.cache import Cache, key_of
from calibrant.detection.detection import Detection
from calibrant.detection.images.copies import copies_note, copies_of
from calibrant.detection.images.faint import flattened
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey, orientation_of
from calibrant.detection.images.likeness import notes_on_likeness
from calibrant.detection.images.moved import notes_on_motion
from calibrant.detection.registry import check_choice, detector_for, second_look
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.errors import DetectionError, InputError
from calibrant.executors import executor_for, in_order
from calibrant.expected import expect, unexpected
from calibrant.formats.images.header import UPRIGHT, WORDS
from calibrant.opencv import cv2
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Target

Progress = Callable[[int, int, str], None]
"""Called after each image with how many are done, how many there are, and the file's name."""

MOST_TOGETHER, LEAST_TASKS = 8, 30
"""Images handed to a process at once: handing over costs as much as a tenth of a small image. With so many tasks at
least, none waits long for another at the end."""
MIRRORED_LOOKS = 3
"""Images that are tried in the mirror when none shows the target: a camera mirrors all or none."""
FAINT_NOTE = "Some images show the target only after their gradient was divided out of their more than 8 bits."


@dataclass(frozen=True)
class ImageDetection:
    """What one file gave: size (width, height), or None and the reason in `detection` when it could not be read;
    orientation: EXIF's, 1 to 8."""

    file: Path
    size: tuple[int, int] | None
    detection: Detection
    orientation: int = UPRIGHT


def detect(
    images: str | Path | Iterable[str | Path],
    *,
    target: Target | str,
    workers: int | str | Executor | None = None,
    mirror_x: bool = False,
    camera: str = DEFAULT_CAMERA,
    cache: str | Path | None = None,
    refinement: Refinement = DEFAULT,
    progress: Progress | None = None,
    beside: Sequence[Target | str] = (),
) -> Observations:
    """The target in every image.

    Args: images: files, patterns, folders, videos; target: a target, or its spec; workers: how many processes, a Dask
    scheduler's address, or an executor to use (None: two where the images are many); mirror_x: images are flipped left
    to right before anything else, for cameras that deliver mirror images, and pixels are those of the flipped image;
    cache: a folder that keeps what was detected, so that the same images are not searched again; refinement: how
    the corners of chessboards and ChArUco boards are measured; progress: called after each image; beside: other targets
    that the images show too: that more show them says nothing against this one.
    An image that cannot be read, is of another size than most, a copy of another or does not show the target is listed
    in `missed` with the reason.
    Raises: InputError when no image is given, none can be read, or no size is that of most; DetectionError when no
    image shows the target, or more show one other.

        >>> import calibrant as cb
        >>> observations = cb.detect("photos/*.jpg", target="chessboard:9x6:25mm")  # doctest: +SKIP
    """
    _expect_arguments(target, mirror_x, cache, progress)
    wanted = parse_target(target) if isinstance(target, str) else target
    check_choice(wanted.kind, refinement)  # options that do not go together are said before anything is read
    files = expand(images)
    kept = None if cache is None else Cache.at(cache)
    copies = copies_of(files)
    done = []
    for result in _run(workers, [f for f in files if f not in copies], wanted, mirror_x, kept, refinement):
        done.append(result)
        if progress is not None:
            progress(len(done), len(files) - len(copies), result.file.name)
    position = {file: i for i, file in enumerate(files)}
    names = distinct_names(files)
    done = sorted([*done, *_copied(done, copies, names)], key=lambda d: position[d.file])
    size = _common_size(done)
    done = _foreign_left_out(done, size)
    found = [d for d in done if d.detection.found]
    if not found:
        raise _none_found(done, wanted, mirror_x)
    _refuse_another_target([] if beside else [d.detection for d in done], wanted)
    points, row_of = wanted.points, {int(label): row for row, label in enumerate(wanted.point_ids)}
    views = tuple(_detected_view(d, names[d.file], points, row_of, camera) for d in found)
    notes = [*_notes(done), *([copies_note(copies, names)] if copies else [])]
    return Observations(
        views=views,
        image_sizes={camera: size},
        target=wanted.spec,
        missed=tuple(
            Missed(names[d.file], d.detection.reason or "", camera, str(d.file)) for d in done if not d.detection.found
        ),
        notes=tuple(dict.fromkeys([*notes, *_notes_on_motion(found, names), *notes_on_likeness(views, size[0])])),
    )


def detect_file(file: Path, target: Target, mirror_x: bool, refinement: Refinement = DEFAULT) -> ImageDetection:
    """The target in one file; a file that cannot be read gives the reason, not an error."""
    # One image is one task: OpenCV's own threads would compete with the other processes.
    cv2.setNumThreads(1)
    try:
        grey = load_grey(file)
    except InputError as error:
        return ImageDetection(file, None, Detection.nothing(str(error)))
    h, w = grey.shape
    try:
        detection = _detect_grey(grey, target, mirror_x, refinement)
        if not detection.found and detection.looks_like is None:
            detection = _detect_faint(file, detection, target, mirror_x, refinement)
    except cv2.error as error:
        # What one picture's shape or content is too much for costs that picture, not the others.
        what = str(error.err or error).strip()
        detection = Detection.nothing(
            f"this image of {w}x{h} cannot be searched: OpenCV says {what!r}; make it smaller"
        )
    return ImageDetection(file, (w, h), detection, orientation_of(file))


def _detect_grey(grey: Grey, target: Target, mirror_x: bool, refinement: Refinement) -> Detection:
    looked_at = np.ascontiguousarray(grey[:, ::-1]) if mirror_x else grey
    return second_look(looked_at, target, detector_for(target.kind, refinement).detect(looked_at, target))


def _detect_faint(file: Path, nothing: Detection, target: Target, mirror_x: bool, refinement: Refinement) -> Detection:
    """What more than 8 bits show of a target where 8 bits of grey showed nothing; else that."""
    for grey in flattened(file):
        detection = _detect_grey(grey, target, mirror_x, refinement)
        if detection.found:
            return replace(detection, notes=(*detection.notes, FAINT_NOTE))
        if detection.looks_like is not None:
            return detection
    return nothing


def _detect_files(
    files: Sequence[Path], *, target: Target, mirror_x: bool, refinement: Refinement
) -> list[ImageDetection]:
    """The target in some files: what is handed to a process at once."""
    return [detect_file(file, target, mirror_x, refinement) for file in files]


def _notes_on_motion(found: Sequence[ImageDetection], names: Mapping[Path, str]) -> tuple[str, ...]:
    return notes_on_motion([(names[d.file], d.detection.smeared) for d in found])


def notes_on_orientation(orientations: Sequence[int]) -> list[str]:
    """What EXIF did to the images, where it turned any: the camera's axes are then those of the turned images."""
    asked = Counter(orientations)
    if set(asked) <= {UPRIGHT}:
        return []
    each = [f"{count} {WORDS[o]}" for o, count in sorted(asked.items()) if o != UPRIGHT]
    text = f"Images turned upright as their EXIF data say: {', '.join(each)}, of {len(orientations)}."
    if len(asked) > 1:
        text += (
            " A camera that was held in different ways has its axes and its principal point at different places of the "
            "images: calibrate them apart, or remove the orientation from the files."
        )
    return [text]


def _run(
    workers: int | str | Executor | None,
    files: Sequence[Path],
    target: Target,
    mirror_x: bool,
    cache: Cache | None,
    refinement: Refinement,
) -> Iterator[ImageDetection]:
    """Every file's detection: first those that are kept already, then the others as they are done, in order."""
    keys: dict[Path, str] = {}
    todo = []
    for file in files:
        key = None if cache is None else key_of(file, target, mirror_x, refinement)
        known = None if cache is None or key is None else cache.get(key)
        if known is not None:
            yield ImageDetection(file, *known, orientation_of(file))
            continue
        todo.append(file)
        if key is not None:
            keys[file] = key
    with executor_for(workers, len(todo)) as executor:
        search = partial(_detect_files, target=target, mirror_x=mirror_x, refinement=refinement)
        if executor is None:
            results: Iterator[ImageDetection] = (one for file in todo for one in search([file]))
        else:
            # What is not compiled yet is compiled here, once, and not by each of the processes.
            detector_for(target.kind, refinement)
            together = max(1, min(MOST_TOGETHER, len(todo) // LEAST_TASKS))
            results = in_order(executor, search, [todo[i : i + together] for i in range(0, len(todo), together)])
        for result in results:
            checkpoint()
            if cache is not None and result.size is not None and result.file in keys:
                cache.put(keys[result.file], result.size, result.detection)
            yield result


def _none_found(done: Sequence[ImageDetection], target: Target, mirror_x: bool) -> DetectionError:
    """Why no image shows the target, in words."""
    readable = [d for d in done if d.size is not None]
    if _found_mirrored([d.file for d in readable], target, mirror_x):
        # What it looks like otherwise is a chance likeness of the mirror image.
        option = "leave --mirror-x out" if mirror_x else "give --mirror-x"
        return DetectionError(f"0 of {len(done)} boards found; the board is seen in the mirror image: {option}")
    return DetectionError(_why_none(readable, target, len(done)))


def _found_mirrored(files: Sequence[Path], target: Target, mirror_x: bool) -> bool:
    """Do the first images show the target in the mirror?"""
    return any(detect_file(file, target, not mirror_x).detection.found for file in files[:MIRRORED_LOOKS])


def _common_size(done: Sequence[ImageDetection]) -> tuple[int, int]:
    """The size of more than half of the images that can be read.

    Raises: InputError when none can be read, or no size has so many.
    """
    readable = [d for d in done if d.size is not None]
    sizes = Counter(d.size for d in readable)
    if not sizes:
        reasons = "; ".join(d.detection.reason or "" for d in done[:3])
        raise InputError(f"none of {len(done)} images can be read: {reasons}")
    size, times = sizes.most_common(1)[0]
    if size is None or 2 * times <= len(readable):
        first = readable[0]
        other = next(d for d in readable if d.size != first.size)
        raise InputError(
            f"images of {len(sizes)} sizes: {first.file.name} is {_by(first.size)}, {other.file.name} is "
            f"{_by(other.size)}; {ONE_SIZE}: leave out the others"
        )
    return size


def _by(size: tuple[int, int] | None) -> str:
    return "unknown" if size is None else f"{size[0]}x{size[1]}"


def _foreign_left_out(done: Sequence[ImageDetection], size: tuple[int, int]) -> list[ImageDetection]:
    """The same, nothing found in images of another size than the camera's."""
    return [
        d
        if d.size in (None, size)
        else replace(
            d,
            detection=Detection.nothing(f"the image is {_by(d.size)}, most are {_by(size)}; {ONE_SIZE}"),
        )
        for d in done
    ]


def _notes(done: Sequence[ImageDetection]) -> list[str]:
    """What is to be known of the files themselves, and what their detectors say."""
    notes = notes_on_orientation([d.orientation for d in done if d.size is not None])
    return [*notes, *(note for d in done for note in d.detection.notes)]


def _copied(
    done: Sequence[ImageDetection], copies: Mapping[Path, Path], names: Mapping[Path, str]
) -> Iterator[ImageDetection]:
    """What the copies give: nothing where their original gave points, which count once."""
    by_file = {d.file: d for d in done}
    for copy, original in copies.items():
        reason = f"the same picture as {names[original]}, byte by byte: it counts once"
        first = by_file[original]
        yield replace(
            first, file=copy, detection=Detection.nothing(reason) if first.detection.found else first.detection
        )


def _refuse_another_target(detections: Sequence[Detection], target: Target) -> None:
    """Raises: DetectionError where more images show one other target than show the one asked for."""
    others = Counter(d.looks_like for d in detections if d.another and d.looks_like)
    found = sum(d.found for d in detections)
    if others and others.most_common(1)[0][1] > found:
        seen, times = others.most_common(1)[0]
        raise DetectionError(
            f"{times} of {len(detections)} images look like {seen}, you asked for {_asked(target, seen)}, which "
            f"{found} {'seems' if found == 1 else 'seem'} to show: give the target that most show, or leave the images "
            "of the other out"
        )


def _asked(target: Target, seen: str) -> str:
    """A target's spec to show beside what was seen: where it is the size that differs, the rest would hide it."""
    return target.spec.split(":")[1] if seen[0].isdigit() else target.spec


def _why_none(readable: Sequence[ImageDetection], target: Target, count: int) -> str:
    looks = Counter(d.detection.looks_like for d in readable if d.detection.looks_like)
    head = f"0 of {count} boards found"
    if looks:
        seen = looks.most_common(1)[0][0]
        return f"{head}; the images look like {seen}, you asked for {_asked(target, seen)}"
    reason, times = Counter(d.detection.reason for d in readable).most_common(1)[0]
    where = "every image" if times == count else f"{times} of the images"
    return f"{head}; {where}: {reason}"


def _expect_arguments(target: object, mirror_x: object, cache: object, progress: object) -> None:
    """Raises: InputError for an argument of another kind than `detect` takes."""
    expect(target, (str, Target), "target", "a target's spec, such as 'chessboard:9x6:25mm', or a Target")
    expect(mirror_x, bool, "mirror_x", "True or False")
    expect(cache, (str, Path, type(None)), "cache", "a folder")
    if progress is not None and not callable(progress):
        raise unexpected(progress, "progress", "a function of how many are done, how many there are, and a name")


def _detected_view(
    result: ImageDetection, name: str, points: NDArray[np.float64], row_of: Mapping[int, int], camera: str
) -> View:
    """The view of a file. Args: points (n, 3), metres, of the whole target; row_of: the row of each label in them."""
    detection = result.detection
    rows = [row_of[label] for label in detection.point_ids.tolist()]
    return View(
        id=name,
        points=points[rows],
        uv=detection.uv,
        point_ids=detection.point_ids,
        camera=camera,
        sigma_px=detection.sigma_px,
        covariance_px=detection.covariance_px,
        file=str(result.file),
    )
