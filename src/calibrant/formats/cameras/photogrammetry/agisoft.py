"""Agisoft Metashape's XML: sensors and cameras of a chunk (cameras.xml), or one calibration.

    x = X/Z, y = Y/Z, r^2 = x^2 + y^2, g = 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8
    x' = x g + p1 (r^2 + 2 x^2) + 2 p2 x y,  y' = y g + p2 (r^2 + 2 y^2) + 2 p1 x y
    u = w/2 + cx + x' f + x' b1 + y' b2,  v = h/2 + cy + y' f

the middle of the first pixel at (0.5, 0.5); a fisheye's x, y are those of the angle (Metashape's manual, appendix
"Camera models"). A camera's transform is T_chunk_camera, optical; the chunk's (or its component's) own rotation,
translation and scale lead to the world. Without them the lengths have no unit but the one that is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from xml.etree import ElementTree

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, placed_camera, whole_size
from calibrant.formats.cameras.foreign_lens import ASKS, nearest_by_projection
from calibrant.formats.cameras.photogrammetry.pictures import Picture, pictures_of, result_of, unit_of
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import row_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions
from calibrant.formats.exchange.rotation_numbers import ROUNDED
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

Element = ElementTree.Element
_CORNER = 0.5
_TERMS = ("k1", "k2", "k3", "k4", "p1", "p2")
_OURS = {"f": ("fx", "fy"), "b1": ("fx",), "b2": ("skew",), "p1": ("p2",), "p2": ("p1",)}
"""Parameters of ours that move with Metashape's, where the name is not the same."""
_FRAME, _FISHEYE = "frame", ("fisheye", "equidistant_fisheye")
_UNUSED = ("rolling_shutter", "corrections", "location", "rotation")


def _matches(document: Document) -> bool:
    root = document.root
    if root is None:
        return False
    if root.tag == "calibration":
        return root.find("projection") is not None
    return root.tag in ("document", "chunk") and root.find(".//sensors") is not None


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source, root = str(document.path), document.root
    if root is None:
        raise InputError("no XML of Metashape's")
    if root.tag == "calibration":
        return result_of({"camera": _camera(root, _text(root, "projection"), options)}, (), options)
    chunks = [root] if root.tag == "chunk" else root.findall("chunk")
    cameras: dict[str, Camera] = {}
    pictures: list[Picture] = []
    for chunk in chunks:
        names = _sensors(chunk, cameras, options, source)
        if options.places:
            pictures += _pictures(chunk, names, options, source)
    if not cameras:
        raise InputError("no sensor with a calibration in it: align the photos, or export the adjusted calibration")
    return result_of(cameras, pictures, options)


def _sensors(chunk: Element, cameras: dict[str, Camera], options: ReadOptions, source: str) -> dict[str, str]:
    """Names of the cameras by the sensors' numbers; the cameras are added."""
    names: dict[str, str] = {}
    for sensor in chunk.findall("./sensors/sensor"):
        number = sensor.get("id", "")
        found = sensor.findall("calibration")
        adjusted = [c for c in found if c.get("class") == "adjusted"] or found
        label = (sensor.get("label") or f"sensor {number}").strip()
        if not adjusted:
            note(f"{source}: the sensor {label!r} has no calibration, and is left out")
            continue
        name = label if label not in cameras else f"{label} ({number})"
        if name in cameras:
            raise InputError(f"two sensors are called {name!r}")
        kind = adjusted[0].get("type") or sensor.get("type") or _FRAME
        try:
            cameras[name] = _camera(adjusted[0], kind, options, sensor)
        except InputError as error:
            raise InputError(f"sensor {label!r}: {error}") from error
        cameras[name] = _with_covariance(cameras[name], sensor)
        names[number] = name
        note_unused(f"{source}: {label}", (t for t in _UNUSED if sensor.find(f".//{t}") is not None))
    return names


def _text(element: Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()


def _number(element: Element, tag: str) -> float:
    text = _text(element, tag)
    try:
        value = float(text or 0)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"<{tag}> is {text[:40]!r}, expected a number")
    return value


def _size(calibration: Element, sensor: Element | None) -> Size:
    for element in (calibration, sensor):
        at = None if element is None else element.find("resolution")
        if at is not None:
            return whole_size(at.get("width"), at.get("height"))
    return whole_size(_text(calibration, "width") or None, _text(calibration, "height") or None)


def _camera(calibration: Element, kind: str, options: ReadOptions, sensor: Element | None = None) -> Camera:
    """Raises: InputError for a projection or terms that none of ours says."""
    size = _size(calibration, sensor)
    if kind not in (_FRAME, *_FISHEYE):
        raise InputError(f"a camera of the kind {kind!r}; read are {_FRAME} and {', '.join(_FISHEYE)}")
    terms = {name: value for name in _TERMS if (value := _number(calibration, name)) != 0}
    if calibration.find("fx") is not None:
        if "p1" in terms or "p2" in terms:
            raise InputError(
                "PhotoScan's calibrations with <fx> and <fy> come with p1 and p2 in either order; export it from a "
                "newer version"
            )
        fx, fy, skew = (_number(calibration, t) for t in ("fx", "fy", "skew"))
        cx, cy = (_number(calibration, t) - _CORNER for t in ("cx", "cy"))
    else:
        fy, skew = _number(calibration, "f"), _number(calibration, "b2")
        fx = fy + _number(calibration, "b1")
        cx, cy = (n / 2 + _number(calibration, t) - _CORNER for t, n in zip(("cx", "cy"), size))
    plain = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    # Metashape's p1 and p2 are OpenCV's p2 and p1.
    lens = {{"p1": "p2", "p2": "p1"}.get(name, name): value for name, value in terms.items()}
    fisheye = kind in _FISHEYE
    model = _model(set(lens), skew, fisheye)
    if model is not None:
        return placed_camera(model, plain | lens | ({"skew": skew} if skew else {}), size, None)
    start = plain | {name: value for name, value in lens.items() if name != "k4" or fisheye}
    models = ("kannala_brandt",) if fisheye else ("unified", "rational") if skew else ("rational",)
    what = f"a {kind} camera with {', '.join([*terms, *(['b2'] if skew else [])])}"
    widest = {"widest": 0.95 * np.pi} if fisheye else {}
    return nearest_by_projection(
        _projection(plain, terms, skew, fisheye),
        models,
        start | {"skew": skew},
        size,
        options.answers,
        what=what,
        **widest,
    )


def _with_covariance(camera: Camera, sensor: Element) -> Camera:
    """The camera with what <covariance> says of f, cx, cy, b1, b2 and the terms: fx is f + b1, p1 and p2 change places.

    Raises: InputError where it is none.
    """
    at = sensor.find("covariance")
    names = [] if at is None else (at.findtext("params") or "").split()
    ours = camera.model.parameter_names
    columns = [_OURS.get(name, (name,)) for name in names]
    if at is None or not names or any(to not in ours for column in columns for to in column):
        return camera
    C = _numbers(at.findtext("coeffs"), len(names) ** 2, "the covariance").reshape(len(names), len(names))
    J = np.zeros((len(ours), len(names)))
    for i, column in enumerate(columns):
        J[[camera.model.index(to) for to in column], i] = 1.0
    return Camera(camera.model, camera.image_size, camera.values, J @ (C + C.T) @ J.T / 2)


def _model(terms: set[str], skew: float, fisheye: bool) -> str | None:
    """Our model that says it exactly."""
    if fisheye:
        return "kannala_brandt" if not skew and not terms & {"p1", "p2"} else None
    if skew:
        return "pinhole_skew" if not terms else "unified" if terms <= {"k1", "k2", "p1", "p2"} else None
    return None if "k4" in terms else "brown" if terms else "pinhole"


def _projection(
    plain: Mapping[str, float], terms: Mapping[str, float], skew: float, fisheye: bool
) -> Callable[[Array], Array]:
    """Metashape's equations."""
    k1, k2, k3, k4, p1, p2 = (terms.get(name, 0.0) for name in _TERMS)

    def project(rays: Array) -> Array:
        R = np.hypot(rays[:, 0], rays[:, 1])
        scale = np.arctan2(R, rays[:, 2]) / np.where(R > 0, R, 1.0) if fisheye else 1 / rays[:, 2]
        x, y = rays[:, 0] * scale, rays[:, 1] * scale
        r2 = x * x + y * y
        g = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        u = x * g + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
        v = y * g + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
        return np.stack([plain["cx"] + u * plain["fx"] + v * skew, plain["cy"] + v * plain["fy"]], axis=-1)

    return project


def _numbers(text: str | None, count: int, what: str) -> Array:
    try:
        values = np.array((text or "").split(), dtype=np.float64)
    except ValueError:
        values = np.zeros(0)
    if values.size != count or not np.all(np.isfinite(values)):
        raise InputError(f"{what}: expected {count} numbers, found {(text or '')[:40]!r}")
    return values


def _world(chunk: Element, component: str | None) -> tuple[Array, float] | None:
    """Rotation and translation of the chunk in the world, and its scale; None where it says none."""
    places = [c.find("transform") for c in chunk.findall("./components/component") if c.get("id") == component]
    for at in (chunk.find("transform"), *places):
        if at is None or at.find("rotation") is None:
            continue
        R = _numbers(at.findtext("rotation"), 9, "the chunk's rotation").reshape(3, 3)
        t = _numbers(at.findtext("translation"), 3, "the chunk's translation")
        scale = float(_numbers(at.findtext("scale"), 1, "the chunk's scale")[0])
        if scale <= 0:
            raise InputError(f"the chunk's scale is {scale:g}, expected above 0")
        return se3.check(se3.make(R, t), name="the chunk's transform", tolerance=ROUNDED), scale
    return None


def _pictures(chunk: Element, names: Mapping[str, str], options: ReadOptions, source: str) -> list[Picture]:
    found: list[Picture] = []
    left = 0
    told = dict[str | None, tuple[Array, float]]()
    for camera in chunk.findall("./cameras//camera"):
        text, sensor = camera.findtext("transform"), camera.get("sensor_id", "")
        if text is None or sensor not in names:
            left += 1
            continue
        label = camera.get("label") or camera.get("id") or "?"
        M = _numbers(text, 16, f"the transform of {label}").reshape(4, 4)
        if not M.any():  # PhotoScan 1.2 writes zeros for a photo that was not aligned
            left += 1
            continue
        T = se3.check(M, name=f"the transform of {label}", tolerance=ROUNDED)
        component = camera.get("component_id")
        if component not in told:
            told[component] = _world(chunk, component) or (np.eye(4), unit_of(options, source))
        world, scale = told[component]
        T[:3, 3] *= scale
        found.append(Picture(label, names[sensor], se3.inverse(world @ T)))
    if left:
        note(f"{source}: {left} pictures were not aligned, or have no sensor, and are left out")
    return found


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    """A document of one chunk, whose world is the result's."""
    root = ElementTree.Element("document", version="2.0.0")
    chunk = ElementTree.SubElement(root, "chunk", label="Chunk 1", enabled="true")
    sensors = ElementTree.SubElement(chunk, "sensors", next_id=str(len(result.cameras)))
    number = {name: str(i) for i, name in enumerate(result.cameras)}
    for name, camera in result.cameras.items():
        _sensor(sensors, number[name], name, camera)
    pictures = pictures_of(result)
    cameras = ElementTree.SubElement(chunk, "cameras", next_id=str(len(pictures)))
    for i, p in enumerate(pictures):
        at = ElementTree.SubElement(cameras, "camera", id=str(i), sensor_id=number[p.camera], label=p.name)
        ElementTree.SubElement(at, "transform").text = row_of(se3.inverse(p.T_camera_world).ravel())
    world = ElementTree.SubElement(chunk, "transform")
    for tag, values in (("rotation", np.eye(3)), ("translation", np.zeros(3)), ("scale", np.ones(1))):
        ElementTree.SubElement(world, tag).text = row_of(values.ravel())
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _sensor(sensors: Element, number: str, name: str, camera: Camera) -> None:
    p, size = camera.parameters, dict(zip(("width", "height"), map(str, camera.image_size)))
    kind = "fisheye" if camera.model.name == "kannala_brandt" else _FRAME
    sensor = ElementTree.SubElement(sensors, "sensor", id=number, label=name, type=kind)
    ElementTree.SubElement(sensor, "resolution", size)
    calibration = ElementTree.SubElement(sensor, "calibration", {"type": kind, "class": "adjusted"})
    ElementTree.SubElement(calibration, "resolution", size)
    width, height = camera.image_size
    values = {
        "f": p["fy"],
        "cx": p["cx"] + _CORNER - width / 2,
        "cy": p["cy"] + _CORNER - height / 2,
        "b1": p["fx"] - p["fy"],
        "b2": p.get("skew", 0.0),
        **{name: p[name] for name in ("k1", "k2", "k3", "k4") if name in p},
        **({"p1": p["p2"], "p2": p["p1"]} if "p1" in p else {}),
    }
    for tag, value in values.items():
        ElementTree.SubElement(calibration, tag).text = row_of((value,))


FORMAT = ExchangeFormat(
    name="agisoft",
    title="Agisoft Metashape (XML of cameras or of a calibration)",
    suffix=".xml",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown", "pinhole_skew", "kannala_brandt"),
    asks=ASKS,
)
