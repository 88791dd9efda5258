"""Cameras and bodies of MuJoCo's MJCF: read as they stand at qpos0, and written so that MuJoCo loads them.

A camera looks along its -z, y up. With sensorsize its focal lengths and principal point are focal / sensorsize and
principal / sensorsize of the image, or focalpixel and principalpixel, which rule; the principal point moves left and up
for positive numbers:

    u = W/2 - principalpixel_x - 1/2,   v = H/2 - principalpixel_y - 1/2

Without sensorsize fovy is the vertical angle of view, degrees in any case, about the image's middle. Sources: MuJoCo
documentation, "XML reference", body/camera, default, frame; signs as MuJoCo 3 renders them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.results import TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import size_or_refuse, whole_size
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions, read_cameras
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.formats.scenes.looking import TURNED, focal_of, pinhole, shift_of
from calibrant.formats.scenes.mjcf_orientation import Angles, angles_of, place_of
from calibrant.formats.transforms.one import ASKS, the_transform
from calibrant.geometry import rotations
from calibrant.reading.notes import note, note_unused

_WORLD = "world"
_DEFAULT_FOVY = "45"
_PIXEL_M = 1e-6
"""The pitch of a written sensor's pixels; what it is does not change a picture."""
_MOST_BODIES = 100_000
_TARGETS = ("targetbody", "targetbodycom")


@dataclass(frozen=True)
class _Scene:
    """What holds for a whole file: angles, attributes of cameras by class, what the reader was told."""

    angles: Angles
    defaults: Mapping[str, Mapping[str, str]]
    options: ReadOptions
    source: str
    cameras: dict[str, Camera] = field(default_factory=dict)
    transforms: list[TransformEstimate] = field(default_factory=list)
    bodies: dict[str, int] = field(default_factory=dict)
    """Names of bodies with the number of joints that each has, in order."""


def _matches(document: Document) -> bool:
    return document.root is not None and document.root.tag in ("mujoco", "mujocoinclude")


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    root, source = document.root, str(document.path)
    if root is None:
        raise InputError(document.trouble or f"{source} is not XML")
    scene = _Scene(angles_of(root, source), _defaults(root), options, source)
    taken = {str(e.get("name")) for e in root.iter("camera") if e.get("name")}
    for world in root.findall("worldbody"):
        _walk(scene, world, _WORLD, np.eye(4), "", taken)
    included = [f"include {e.get('file', '')}" for e in root.iter("include")]
    if not scene.cameras and not scene.transforms:
        more = f" (what it includes is not read: {', '.join(included)})" if included else ""
        raise InputError(f"{source}: no camera and no body in it{more}")
    note_unused(
        source, [*included, *(f"<{tag}>" for tag in ("replicate", "attach") if root.find(f".//{tag}") is not None)]
    )
    joints = sum(scene.bodies.values())
    if joints:
        note(f"{source}: bodies are placed as at qpos0; {joints} joints move them")
    return read_cameras(scene.cameras, transforms=tuple(scene.transforms))


def _defaults(root: ET.Element) -> dict[str, dict[str, str]]:
    """Attributes of cameras by class; a class has those of the one around it. "" is the class of no name."""
    found: dict[str, dict[str, str]] = {"": {}}

    def gather(element: ET.Element, inherited: Mapping[str, str], top: bool) -> None:
        own = dict(inherited)
        for camera in element.findall("camera"):
            own |= camera.attrib
        if top:
            found[""] = own
        found[element.get("class", "main" if top else "")] = own
        for inner in element.findall("default"):
            gather(inner, own, False)

    for element in root.findall("default"):
        gather(element, found[""], True)
    return found


def _walk(scene: _Scene, element: ET.Element, body: str, T_body_here: Array, inherited: str, taken: set[str]) -> None:
    """Everything below an element: cameras and bodies, through frames, each placed in its body."""
    for child, T, default in _inside(scene, element, T_body_here, inherited):
        if child.tag == "camera":
            _camera(scene, child, body, T, default)
            continue
        if len(scene.bodies) >= _MOST_BODIES:
            raise InputError(f"{scene.source}: more than {_MOST_BODIES:,} bodies")
        name = child.get("name") or f"body_{len(scene.bodies) + 1}"
        # Bodies and cameras may be called alike in MuJoCo; as frames they need names of their own.
        name = f"{name}_body" if name in taken else name
        if name in scene.bodies:
            raise InputError(f"{scene.source}: two bodies are called {name!r}")
        scene.bodies[name] = sum(1 for e in child if e.tag in ("joint", "freejoint"))
        scene.transforms.append(
            as_transform(body, name, T @ place_of(child.attrib, scene.angles, _named(scene, child)))
        )
        _walk(scene, child, name, np.eye(4), child.get("childclass", default), taken)


def _inside(scene: _Scene, element: ET.Element, T: Array, default: str) -> Iterator[tuple[ET.Element, Array, str]]:
    """Cameras and bodies of an element, those of its frames too, with where they hang and their class."""
    for child in element:
        if child.tag in ("camera", "body"):
            yield child, T, default
        elif child.tag == "frame":
            inner = T @ place_of(child.attrib, scene.angles, _named(scene, child))
            yield from _inside(scene, child, inner, child.get("childclass", default))


def _named(scene: _Scene, element: ET.Element) -> str:
    return f"{scene.source}: {element.tag} {element.get('name', '')!r}"


def _camera(scene: _Scene, element: ET.Element, body: str, T_body_here: Array, inherited: str) -> None:
    where = _named(scene, element)
    chosen = element.get("class", inherited)
    if chosen not in scene.defaults:
        raise InputError(f"{where}: there is no default class {chosen!r}")
    said = {**_of_class(scene, chosen, element), **element.attrib}
    name = element.get("name") or f"camera_{len(scene.cameras)}"
    if name in scene.cameras:
        raise InputError(f"{scene.source}: two cameras are called {name!r}")
    if said.get("projection", "perspective") != "perspective" or said.get("orthographic", "false") == "true":
        raise InputError(f"{where} is orthographic: it has no focal length")
    if said.get("mode", "fixed") in _TARGETS:
        note(f"{where} turns to a body as it moves; where it looks is left out")
    else:
        T = T_body_here @ place_of(said, scene.angles, where) @ TURNED
        scene.transforms.append(as_transform(body, name, T))
    scene.cameras[name] = _intrinsics(said, scene.options.image_size, where)


def _of_class(scene: _Scene, chosen: str, element: ET.Element) -> Mapping[str, str]:
    """The class's attributes, but for an orientation where the element has one of its own."""
    turns = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
    own = any(key in element.attrib for key in turns)
    found = scene.defaults[chosen]
    lens = {"fovy", "sensorsize"} & set(element.attrib)
    dropped = {*(turns if own else ()), *({"fovy", "sensorsize"} - lens if lens else ())}
    return {key: value for key, value in found.items() if key not in dropped}


def _intrinsics(said: Mapping[str, str], image_size: Size | None, where: str) -> Camera:
    stated = finite(said.get("resolution", "1 1").split(), 2, f"{where}: resolution")
    size = size_or_refuse_named(None if tuple(stated) == (1, 1) else whole_size(*stated), image_size, where)
    if "sensorsize" not in said:
        focal = focal_of(size[1], float(finite([said.get("fovy", _DEFAULT_FOVY)], 1, f"{where}: fovy")[0]), where)
        return pinhole(size, (focal, focal), (0.0, 0.0), where)
    sensor = finite(said["sensorsize"].split(), 2, f"{where}: sensorsize")
    if not np.all(sensor > 0):
        raise InputError(f"{where}: a sensor of {said['sensorsize']}; expected two lengths above 0")
    per_length = np.array(size) / sensor
    focal_px = _in_pixels(said, "focal", per_length, where)
    if focal_px is None:
        raise InputError(f"{where}: sensorsize without focal or focalpixel says no focal length")
    moved = _in_pixels(said, "principal", per_length, where)
    shift = np.zeros(2) if moved is None else -moved
    return pinhole(size, (float(focal_px[0]), float(focal_px[1])), (float(shift[0]), float(shift[1])), where)


def size_or_refuse_named(found: Size | None, asked: Size | None, where: str) -> Size:
    """The image size, as `size_or_refuse` has it, with the camera's name in what is refused."""
    try:
        return size_or_refuse(found, asked)
    except InputError as error:
        raise InputError(f"{where}: {error} (--image-size)") from None


def _in_pixels(said: Mapping[str, str], name: str, per_length: Array, where: str) -> Array | None:
    """focal or principal in pixels: as given in these, else in lengths; None where neither is given."""
    for key, factor in ((f"{name}pixel", np.ones(2)), (name, per_length)):
        if key in said:
            return finite(said[key].split(), 2, f"{where}: {key}") * factor
    return None


def _placed(tag: str, name: str, T: Array) -> ET.Element:
    quat = rotations.quaternion_wxyz_from_matrix(T[:3, :3])
    return ET.Element(tag, {"name": name, "pos": " ".join(text_of(T[:3, 3])), "quat": " ".join(text_of(quat))})


def _camera_element(name: str, camera: Camera, T_parent_optical: Array) -> ET.Element:
    element = _placed("camera", name, T_parent_optical @ TURNED)
    p, size = camera.parameters, camera.image_size
    element.set("resolution", f"{size[0]} {size[1]}")
    element.set("sensorsize", " ".join(text_of(_PIXEL_M * n for n in size)))
    element.set("focalpixel", " ".join(text_of((p["fx"], p["fy"]))))
    element.set("principalpixel", " ".join(text_of(-s for s in shift_of(camera))))
    return element


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    """All cameras, and all other frames as bodies, in one frame."""
    world = world_of(result, options.answers.get("world"))
    frames = dict.fromkeys(name for t in result.transforms for name in (t.parent, t.child))
    names = tuple(dict.fromkeys([*result.cameras, *frames]))
    root, holder = _scene_of(world if world not in result.cameras else _WORLD)
    for name, T in places_in(result, world, names).items():
        if name in result.cameras:
            holder.append(_camera_element(name, result.cameras[name], T))
        elif name != world:
            holder.append(_placed("body", name, T))
    return _text(root)


def _write_body(result: CalibrationResult, options: WriteOptions) -> bytes:
    """One frame in its parent's body: a camera where it is one, else a body."""
    one, said = the_transform(result, options), options.answers
    root, holder = _scene_of(said.get("parent", one.parent))
    name, camera = said.get("child", one.child), result.cameras.get(one.child)
    holder.append(_placed("body", name, one.T) if camera is None else _camera_element(name, camera, one.T))
    return _text(root)


def _scene_of(body: str) -> tuple[ET.Element, ET.Element]:
    """The file's root, and the body that others are put into: the world's own, or one at its origin."""
    root = ET.Element("mujoco", model="calibrated")
    holder = ET.SubElement(root, "worldbody")
    return root, holder if body == _WORLD else ET.SubElement(holder, "body", name=body)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return (ET.tostring(root, encoding="unicode") + "\n").encode()


FORMAT = ExchangeFormat(
    name="mjcf",
    title="MuJoCo model (MJCF) with cameras",
    suffix=".xml",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole",),
    asks={"world": "the frame that all others are placed in"},
)
BODY_FORMAT = ExchangeFormat(
    name="mjcf-body",
    title="one camera or body of a MuJoCo model (MJCF)",
    suffix=".mjcf.xml",
    matches=lambda document: False,  # the first reads both
    write=_write_body,
    models=("pinhole",),
    asks={name: ASKS[name] for name in ("parent", "child")},
)
