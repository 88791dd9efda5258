"""Find where an object of known shape is, from a colour picture and depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.depth_cameras import DepthRigOptions
from calibrant.tasks.options.option import Option
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.writing import check_spared

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.data import CalibrationResult, Check
    from calibrant.perceive.colour.ranges import ColourRange
    from calibrant.perceive.colour.segments import Segment
    from calibrant.perceive.object_pose.poses import ObjectPose
    from calibrant.perceive.object_pose.seen import Scene
    from calibrant.perceive.object_pose.shapes import Shape
    from calibrant.perceive.registered_depth.register import DepthRig

EXAMPLE = 'cb.locate("colour.png", depth="depth.png", camera="camera.json", object="box:54x37x5mm", colour="h:345-15")'


_OF_CAMERAS = ("depth_camera", "baseline", "sigma_disparity", "sigma_scale")


@dataclass(frozen=True, kw_only=True)
class Request:
    """Find where an object is: T_camera_object with its uncertainty, and the poses that look the same.

    calibrant locate colour.png --depth depth.png --camera camera.json --object box:54x37x5mm \\
        --colour "h:345-15 s:50-100 v:30-100" --overlay seen.png --stages steps

    Depth is of the colour picture's grid, or of a camera of its own: --camera PAIR.json --depth-camera NAME. An object
    that stands on a table is told by the plane below it, too. Errors in the files' calibration count.
    """

    picture: Annotated[Path | None, Option("IMAGE", positional=True)] = None
    """The colour picture."""
    depth: Annotated[Path | None, Option("FILE")] = None
    """Its depth: 16-bit PNG in millimetres, or .npy in metres."""
    cameras: DepthRigOptions = DepthRigOptions()
    object: Annotated[str | None, Option("SHAPE")] = None
    """Its shape: box:54x37x5mm, cube:40mm, mesh:part.stl (mesh:part.stl:mm where the unit is not plain)."""
    colour: Annotated[str | None, Option("RANGE")] = None
    """Its colour in degrees and per cent, "h:345-15 s:50-100 v:30-100", or a pixel on it, "pixel:320,240"; without it
    the object is what stands out of the table."""
    near: Annotated[str | None, Option("U,V")] = None
    """A pixel near the object that is meant, where several could be it."""
    overlay: Annotated[Path | None, Option("FILE.png", output="file")] = None
    """Draw the object over the picture."""
    stages: Annotated[Path | None, Option("DIR", output="folder")] = None
    """Write a picture of each step: smoothed, enhanced, colour, segment, edges, corners, found."""


def reads(request: Request) -> list[Path]:
    """Picture, depth, camera and a mesh. Raises: InputError where one is not given."""
    needed = {
        "the colour picture": request.picture,
        "its depth, --depth depth.png": request.depth,
        "the camera that took it, --camera camera.json": request.cameras.camera,
    }
    missing = next((words for words, path in needed.items() if path is None), None)
    if missing is not None:
        raise InputError(f"an object is located by picture, depth and camera; missing: {missing}")
    return [path for path in needed.values() if path is not None]


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The object's pose. Raises: InputError, RefusedError as the parts do."""
    files = reads(request)
    if request.overlay is not None:
        check_spared([request.overlay], files)
    if request.object is None:
        raise InputError("what is looked for? --object box:54x37x5mm, cube:40mm or mesh:part.stl")
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.detection.images.depth_files import read_depth
    from calibrant.detection.images.images import load_image
    from calibrant.perceive.object_pose.locate import locate
    from calibrant.perceive.object_pose.seen import Scene
    from calibrant.perceive.object_pose.shapes import parse_shape

    shape, words = parse_shape(request.object)
    image = _colour_picture(load_image(files[0]), files[0])
    rig = request.cameras.rig((image.shape[1], image.shape[0]))
    session.load_solver(listener)
    with listener.status("Locating the object …"):
        scene = Scene.of(image, read_depth(files[1]), rig, noise=request.cameras.noise(rig))
        colour = _colour(request, image)
        segment, others = _segment(request, scene, image, colour)
        pose = locate(scene, segment, shape, others=others)
    result = _result(request, rig, pose, words, files)
    refuse_if_failed(result)
    return Outcome(result=result, documents=_documents(request, image, colour, segment, rig, shape, pose))


def _colour_picture(image: NDArray[Any], path: Path) -> NDArray[np.uint8]:
    import numpy as np

    if image.ndim == 2:
        image = np.repeat(image[..., None], 3, axis=2)
    if image.dtype != np.uint8:
        raise InputError(f"picture {path} is of {image.dtype}; expected 8 bits. Is it the depth?")
    return np.ascontiguousarray(image[..., :3])


def _pixel(text: str, *, option: str) -> tuple[float, float]:
    try:
        u, v = (float(x) for x in text.split(","))
    except ValueError:
        raise InputError(f"{option}: {text!r} is no pixel; expected U,V, such as 320,240") from None
    return u, v


def _colour(request: Request, image: NDArray[np.uint8]) -> ColourRange | None:
    from calibrant.perceive.colour.ranges import ColourRange

    if request.colour is None:
        return None
    if request.colour.startswith("pixel:"):
        return ColourRange.of_pixel(image, _pixel(request.colour.removeprefix("pixel:"), option="--colour"))
    return ColourRange.parse(request.colour)


def _segment(
    request: Request, scene: Scene, image: NDArray[np.uint8], colour: ColourRange | None
) -> tuple[Segment, list[Segment]]:
    from calibrant.perceive.colour.segments import find_segments, the_one
    from calibrant.perceive.object_pose.standing_out import standing_out

    found = standing_out(scene) if colour is None else find_segments(image, colour)
    near = None if request.near is None else _pixel(request.near, option="--near")
    one = the_one(found, near=near, what=f"the object ({request.object})")
    return one, [s for s in found if s is not one]


def _result(request: Request, rig: DepthRig, pose: ObjectPose, words: str, files: list[Path]) -> CalibrationResult:
    from calibrant.data import CalibrationResult, TransformEstimate
    from calibrant.data.details import LocatedObject
    from calibrant.data.results import verdict_of
    from calibrant.data.verdicts import stamp

    checks = _checks(pose)
    found = LocatedObject(
        pose.name,
        words,
        (pose.figures["centre_u_px"], pose.figures["centre_v_px"]),
        int(pose.figures["area_px"]),
        tuple(tuple(tuple(float(x) for x in row) for row in S) for S in pose.symmetries),  # type: ignore[misc]
        pose.undetermined,
        int(pose.figures["faces"]),
        float(pose.figures["overlap"]),
    )
    given = {
        **{name: getattr(request, name) for name in ("object", "colour", "near")},
        **{name: getattr(request.cameras, name) for name in _OF_CAMERAS},
    }
    asked = {name: value for name, value in given.items() if value is not None}
    return stamp(
        CalibrationResult(
            "located",
            verdict_of(checks),
            checks=checks,
            cameras={"camera": rig.colour},
            transforms=(TransformEstimate("camera", "object", pose.matrix, pose.covariance),),
            options=asked,
            details=(found,),
            inputs=session.file_records(files),
        )
    )


def _checks(pose: ObjectPose) -> tuple[Check, ...]:
    from calibrant.data import Check

    overlap = pose.figures["overlap"]
    out = [
        Check(
            "fit", "ok", f"drawn where it was found, the object covers {100 * overlap:.0f} % of what is seen", overlap
        )
    ]
    out += [Check("seen", "warn", note) for note in pose.notes]
    out += [Check("undetermined", "warn", f"the data do not tell {words}") for words in pose.undetermined]
    return tuple(out)


def _documents(
    request: Request,
    image: NDArray[np.uint8],
    colour: ColourRange | None,
    segment: Segment,
    rig: DepthRig,
    shape: Shape,
    pose: ObjectPose,
) -> Iterator[Document]:
    from calibrant.perceive.object_pose.stages import NAMES, drawn, stages

    if request.overlay is not None:
        picture = partial(drawn, image, rig.colour, shape, pose)
        yield Document(request.overlay, lambda: _encoded(picture(), request.overlay))
    if request.stages is not None:
        pictures = stages(image, colour, segment.mask, camera=rig.colour, shape=shape, pose=pose)
        for name, step in zip(NAMES, pictures, strict=True):
            yield Document(request.stages / f"{name}.png", partial(_encoded, step, None))


def _encoded(picture: NDArray[np.uint8], path: Path | None) -> bytes:
    from calibrant.opencv import cv2

    return bytes(cv2.imencode(".png" if path is None else path.suffix or ".png", picture)[1])
