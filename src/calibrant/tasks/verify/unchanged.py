"""Is yesterday's calibration still good: one to three photos, with robot poses or a reference picture, against it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Document, Outcome, result_document
from calibrant.tasks.verify.photos import every_photo, photo_files, target_seen
from calibrant.tasks.verify.sides import Compare, now_compared

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations
    from calibrant.verification.unchanged.answer import Tolerance
    from calibrant.verification.unchanged.pictures import Reference
    from calibrant.verification.unchanged.result import PicturePair

EXAMPLE = 'cb.verify_unchanged("hand-eye.json", images="today/*.png", poses="today.csv")'


@dataclass(frozen=True, kw_only=True)
class Request:
    """Say whether a calibration still holds, from one to three photos: what moved, in px and mm, against its sigma.

    calibrant verify unchanged hand-eye.json --images today/*.png --poses today.csv
    calibrant verify unchanged camera.json --images today.png --reference then.png --overlay push-back.png

    Exit status 0: unchanged; 1: changed; 2: these photos cannot tell. With robot poses the target of the calibration is
    compared with where the calibration puts it. Without poses, a camera that stands still is compared with a reference
    photo of its own, which needs no target: --reference, or one that the result keeps (--keep-reference).
    """

    result: Annotated[Path, Option("RESULT.json", positional=True)]
    """The calibration: a result of hand-eye, pose, intrinsics or rig."""
    photos: NamedPhotoOptions = NamedPhotoOptions()
    poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Robot poses of the photos: a file, or one file a pose."""
    reference: Annotated[Path | None, Option("PHOTO")] = None
    """A photo of then by the same camera from the same place, with or without a target."""
    name: Annotated[str | None, Option("CAMERA")] = None
    """Which camera took the photos, where the result has several."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Changes that are certainly smaller count as none: 1mm at the workpiece, or 2px in the picture."""
    overlay: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw then over now, with arrows, to bring the camera back by hand (of the first photo)."""
    keep_reference: Annotated[Path | None, Option("FILE.json", output="file")] = None
    """Write the result again with a small copy of the first photo in it, for later comparisons."""
    form: PoseOptions = PoseOptions()
    arm: RobotOptions = RobotOptions()
    search: SearchOptions = SearchOptions()


def reads(request: Request) -> list[str | Path]:
    """The result, the photos, the poses, the reference, and the robot's file."""
    photos = photo_files(request.photos, request.search)
    reference = [] if request.reference is None else [request.reference]
    return [request.result, *photos, *request.poses, *reference, *request.arm.files]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """What changed, as a result of kind "unchanged"; a change is the outcome's refusal.

    Raises: InputError where the photos cannot tell; the same as the parts do.
    """
    from calibrant.data.file_names import distinct_names
    from calibrant.data.result_file import read_result
    from calibrant.verification.unchanged.result import Evidence, unchanged_result

    known = read_result(request.result)
    tolerance = _tolerance(request.tolerance)
    compare = Compare.of(known, request.name, request.photos.target)
    photos = every_photo(request.photos, request.search)
    files = [file for file, keep in photos if keep]
    reference = _reference(known, request, files)
    if reference is None and request.keep_reference is not None and not request.poses and not compare.placed_then:
        return _kept_alone(known, request, files)
    _check_comparable(compare, request, reference is not None)
    observations = target_seen(compare, files, request.search, listener, optional=reference is not None)
    try:
        compared = now_compared(compare, observations, request, photos, listener)
    except RefusedError as error:
        raise InputError(f"these photos cannot tell: {error}") from error
    pictures: tuple[PicturePair, ...] = ()
    # A camera on a robot sees another scene from every pose; one that stands sees its own behind what the robot moves.
    if reference is not None and (compared is None or compared.frame != "base"):
        pictures = _pictures(reference, files, request, compare, observations, compared is not None, listener)
    camera = compare.camera
    evidence = Evidence(
        camera=camera,
        compared=compared,
        pictures=pictures,
        observations=observations,
        files={name: str(f) for f, name in distinct_names(files).items()},
        distance=compare.distance,
        stated_px=compare.sigma_px,
        tolerance=tolerance,
    )
    found = unchanged_result(evidence)
    options = {key: value for key, value in _asked(request).items() if value is not None}
    found = replace(found, options=options, inputs=session.file_records(reads(request)))
    return Outcome(result=found, documents=_documents(request, known, found, reference, files), refusal=_refusal(found))


def _tolerance(text: str | None) -> Tolerance:
    """Raises: InputError for a bare number, or another unit."""
    from calibrant.targets.lengths import parse_length
    from calibrant.verification.unchanged.answer import ANY_CHANGE, Tolerance

    if text is None:
        return ANY_CHANGE
    if text.strip().endswith("px"):
        return Tolerance(px=pixels(text, option="--tolerance"))
    return Tolerance(metres=parse_length(text, what="--tolerance"))


def _reference(known: CalibrationResult, request: Request, files: list[Path]) -> Reference | None:
    """The picture of then: the one given, else the one the result keeps."""
    from calibrant.data.details import ReferencePicture
    from calibrant.verification.unchanged.pictures import kept_reference, reference_of

    if request.reference is not None:
        if request.reference.resolve() in {f.resolve() for f in files}:
            raise InputError(f"{request.reference} is the reference and a photo of now: give another photo")
        return reference_of(request.reference, mirror_x=request.search.mirror_x)
    kept = known.detail(ReferencePicture)
    return None if kept is None else kept_reference(kept)


def _check_comparable(compare: Compare, request: Request, has_reference: bool) -> None:
    """Raises: InputError where nothing says what the photos should show."""
    if request.poses and not compare.on_robot:
        raise InputError(
            "--poses goes with a hand-eye result, where a robot stands between camera and target; this one is of kind "
            f"{compare.kind!r}: leave the poses out"
        )
    if compare.on_robot and not request.poses and not has_reference:
        raise InputError(
            "a hand-eye calibration is compared at robot poses: give those of the photos (--poses FILE), or a photo of "
            "then by the camera from the same place (--reference PHOTO)"
        )
    if compare.target is None and not has_reference:
        raise InputError(
            "the result does not name its target: give it (--target SPEC), or a reference photo (--reference PHOTO)"
        )


def _pictures(
    reference: Reference,
    files: list[Path],
    request: Request,
    compare: Compare,
    observations: Observations | None,
    has_target: bool,
    listener: Listener,
) -> tuple[PicturePair, ...]:
    """What became of the reference's picture in each photo. A scene that is too plain beside a target that was found
    is no reason to give up: the target answers then."""
    from calibrant.data.file_names import distinct_names
    from calibrant.verification.unchanged.pictures import became, reference_of
    from calibrant.verification.unchanged.result import PicturePair

    names = distinct_names(files)
    outlines = {v.file: v.uv for v in observations.views} if observations is not None and has_target else {}
    out = []
    with listener.status("Comparing with the reference …"):
        for file in files:
            now = reference_of(file, mirror_x=request.search.mirror_x)
            without = [outlines[str(file)]] if str(file) in outlines else []
            if compare.then_outline is not None and without:
                without.append(compare.then_outline)
            try:
                moved = became(reference, now, without=without)
            except InputError:
                if has_target:
                    continue
                raise
            out.append(PicturePair(names[file], str(file), moved, reference.image_size))
    return tuple(out)


def _kept_alone(known: CalibrationResult, request: Request, files: list[Path]) -> Outcome:
    """Nothing to compare with yet: the first photo becomes the reference."""
    words = f"Kept {files[0].name} as the reference; nothing was compared, since there was none before."
    return Outcome(documents=_kept(request, known, files), summary=partial(_text, words))


def _text(words: str) -> str:
    return words


def _asked(request: Request) -> dict[str, str | bool | None]:
    return {
        "result": str(request.result),
        "reference": None if request.reference is None else str(request.reference),
        "tolerance": request.tolerance,
        "camera": request.name,
        "mirror_x": request.search.mirror_x or None,
    }


def _refusal(found: CalibrationResult) -> RefusedError | None:
    check = found.check("unchanged")
    if check.status != "fail":
        return None
    error = RefusedError(check.message.partition(";")[0])
    error.result = found
    return error


def _documents(
    request: Request,
    known: CalibrationResult,
    found: CalibrationResult,
    reference: Reference | None,
    files: list[Path],
) -> Iterator[Document]:
    yield from _kept(request, known, files)
    if request.overlay is not None:
        yield Document(request.overlay, partial(_overlay, found, reference, files[0], request))


def _kept(request: Request, known: CalibrationResult, files: list[Path]) -> Iterator[Document]:
    """The result with the first photo in it."""
    from calibrant.verification.unchanged.pictures import record_of, reference_of

    if request.keep_reference is not None:
        first = reference_of(files[0], mirror_x=request.search.mirror_x)
        kept = known.with_detail(record_of(first))
        yield result_document(kept, request.keep_reference)


def _overlay(found: CalibrationResult, reference: Reference | None, photo: Path, request: Request) -> bytes:
    from calibrant.opencv import cv2
    from calibrant.verification.unchanged.overlay import drawn
    from calibrant.verification.unchanged.pictures import reference_of

    suffix = ".png" if request.overlay is None else request.overlay.suffix or ".png"
    now = reference_of(photo, mirror_x=request.search.mirror_x)
    return bytes(cv2.imencode(suffix, drawn(found, reference, now))[1])
