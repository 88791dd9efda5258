"""Cameras of USD scenes (.usda, .usdc, .usdz): read through usd-core (extra `usd`), written as text without it.

A camera looks along its -z, y up. focalLength, apertures and their offsets are in tenths of the scene's unit, so that
their ratios alone count; an offset moves the view right or up, and so the principal point left or down:

    fx = focalLength / horizontalAperture W,   u = W/2 - horizontalApertureOffset / horizontalAperture W - 1/2
    fy = focalLength / verticalAperture H,     v = H/2 + verticalApertureOffset / verticalAperture H - 1/2

Matrices of USD stand transposed (rows are vectors); metersPerUnit is 0.01 where a stage does not say it. Image sizes
are those of RenderProducts that name a camera. Numbers of a lens are of 32 bits in USD: seven digits. Sources: OpenUSD
API documentation, UsdGeomCamera ("Units of Measure for Camera Properties"), UsdRenderProduct (resolution,
aspectRatioConformPolicy), UsdGeom "Encoding Stage Linear Units".
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import size_or_refuse, whole_size
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, Size, WriteOptions, answer
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.formats.exchange.rotation_numbers import finite
from calibrant.formats.scenes.entries import placed_cameras, rigid
from calibrant.formats.scenes.looking import TURNED, pinhole, shift_of
from calibrant.reading.notes import note

if TYPE_CHECKING:
    from collections.abc import Iterator

_MARKS = (b"#usda", b"PXR-USDC")
_MOST_PRIMS = 1_000_000
_APERTURES = ("horizontal", "vertical", "both")
_SAME_ASPECT = 1e-4
_ALL_PIXELS = "adjustPixelAspectRatio"
_SENSOR = 0.36
"""Width of a written sensor: 36 mm in tenths of a metre."""


@dataclass(frozen=True)
class _Product:
    """What a RenderProduct says of its camera's pictures."""

    size: Size
    policy: str


def _matches(document: Document) -> bool:
    zipped = document.path.suffix.lower() == ".usdz" and document.head.startswith(b"PK")
    return zipped or document.head.lstrip().startswith(_MARKS)


def _opened(source: str) -> Any:
    """The stage. Raises: InputError where usd-core is not installed, or does not read the file."""
    try:
        from pxr import Tf, Usd
    except ImportError:
        raise InputError(f'{source} is a USD scene, which usd-core reads: pip install "calibrant[usd]"') from None
    try:
        stage = Usd.Stage.Open(source)
    except (Tf.ErrorException, RuntimeError) as error:
        raise InputError(f"{source}: usd-core does not read it{_words_of(error)}") from None
    if stage is None:
        raise InputError(f"{source}: usd-core does not read it")
    return stage


def _words_of(error: Exception) -> str:
    """The end of what usd-core says; nothing where it quotes bytes of the file that are no text."""
    try:
        return f" ({str(error).strip().splitlines()[-1][:120]})"
    except (UnicodeDecodeError, IndexError):
        return ""


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    stage = _opened(source)
    from pxr import Tf

    try:
        return _scene(stage, options, source)
    except Tf.ErrorException as error:  # values that are not of their attribute's type
        raise InputError(f"{source}: usd-core does not read it{_words_of(error)}") from None


def _scene(stage: Any, options: ReadOptions, source: str) -> CalibrationResult:
    from pxr import Usd, UsdGeom

    time = Usd.TimeCode.EarliestTime()
    places = UsdGeom.XformCache(time)
    unit_m = _unit_m(stage, options.unit_m, source)
    prims = _cameras_of(stage, source)
    products = _products(stage, source)
    found: dict[str, tuple[Camera, Array | None]] = {}
    for name, prim in prims.items():
        where = f"{source}: {name}"
        T = rigid(np.array(places.GetLocalToWorldTransform(prim), dtype=np.float64).T, where)
        T[:3, 3] *= unit_m
        if UsdGeom.Xformable(prim).TransformMightBeTimeVarying():
            note(f"{where} moves; its place at the earliest time is taken")
        found[name] = _lens(prim, time, products.get(str(prim.GetPath())), options, where), T @ TURNED
    if not found:
        raise InputError(f"{source}: no camera in the scene")
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y:
        note(f"{source}: the scene's y is up")
    return placed_cameras(found)


def _unit_m(stage: Any, said: float | None, source: str) -> float:
    from pxr import UsdGeom

    if said is not None:
        return said
    unit_m = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        note(f"{source}: no metersPerUnit in the scene; USD takes centimetres then (--unit)")
    if not 0 < unit_m < 1e12:
        raise InputError(f"{source}: metersPerUnit is {unit_m:g}; expected a number above 0")
    return unit_m


def _traversed(stage: Any, source: str) -> Iterator[Any]:
    for i, prim in enumerate(stage.Traverse()):
        if i >= _MOST_PRIMS:
            raise InputError(f"{source}: more than {_MOST_PRIMS:,} prims")
        yield prim


def _cameras_of(stage: Any, source: str) -> dict[str, Any]:
    """Camera prims by the name that is shown, else by their own, else by their path."""
    from pxr import UsdGeom

    found: dict[str, Any] = {}
    for prim in _traversed(stage, source):
        if prim.IsA(UsdGeom.Camera):
            shown = str(prim.GetMetadata("displayName") or prim.GetName())
            found[str(prim.GetPath()) if shown in found else shown] = prim
    return found


def _products(stage: Any, source: str) -> Mapping[str, _Product]:
    """Pictures by the path of their camera; none where two sizes are said for one."""
    found: dict[str, _Product | None] = {}
    for prim in _traversed(stage, source):
        if prim.GetTypeName() not in ("RenderProduct", "RenderSettings"):
            continue
        resolution, camera = prim.GetAttribute("resolution"), prim.GetRelationship("camera")
        if not (resolution and resolution.HasAuthoredValue() and camera):
            continue
        policy = prim.GetAttribute("aspectRatioConformPolicy")
        said = _Product(whole_size(*resolution.Get()), str(policy.Get()) if policy else "")
        for path in map(str, camera.GetTargets()):
            found[path] = said if found.get(path, said) == said else None
    return {path: product for path, product in found.items() if product is not None}


def _lens(prim: Any, time: Any, product: _Product | None, options: ReadOptions, where: str) -> Camera:
    from pxr import UsdGeom

    camera = UsdGeom.Camera(prim)
    if str(camera.GetProjectionAttr().Get(time)) == "orthographic":
        raise InputError(f"{where} is orthographic: it has no focal length")
    try:
        size = size_or_refuse(None if product is None else product.size, options.image_size)
    except InputError as error:
        raise InputError(f"{where}: {error} (--image-size)") from None
    read = (
        camera.GetFocalLengthAttr(),
        camera.GetHorizontalApertureAttr(),
        camera.GetVerticalApertureAttr(),
        camera.GetHorizontalApertureOffsetAttr(),
        camera.GetVerticalApertureOffsetAttr(),
    )
    f, wide, high, right, up = finite((attribute.Get(time) for attribute in read), 5, f"{where}: lens").tolist()
    if not (f > 0 and wide > 0 and high > 0):
        raise InputError(f"{where}: focalLength {f:g}, apertures {wide:g} x {high:g}; expected lengths above 0")
    width, height = size
    across, down = _pixels_per_length(wide, high, size, product, answer(options.answers, "aperture", _APERTURES), where)
    return pinhole((width, height), (f * across, f * down), (-right * across, up * down), where)


def _pixels_per_length(
    wide: float, high: float, size: Size, product: _Product | None, said: str | None, where: str
) -> tuple[float, float]:
    """Pixels per unit of aperture, across and down.

    Raises: InputError where the apertures' ratio is not the image's, and nothing says which of them counts.
    """
    width, height = size
    all_pixels = product is not None and product.policy == _ALL_PIXELS
    if said is None and (all_pixels or abs(wide * height / (high * width) - 1) < _SAME_ASPECT):
        said = "both"
    if said is None:
        raise InputError(
            f"{where}: apertures of {wide:g} x {high:g} for images of {width}x{height} px: which of them counts is the "
            "renderer's choice. Say --answer aperture=horizontal (Omniverse, Isaac Sim), vertical, or both (pixels "
            "that are not square)"
        )
    across, down = width / wide, height / high
    return {"both": (across, down), "horizontal": (across, across), "vertical": (down, down)}[said]


def _identifiers(names: tuple[str, ...]) -> dict[str, str]:
    """A name that USD takes for each, no two alike."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII) or "camera"
        plain = f"_{plain}" if plain[0].isdigit() else plain
        while plain in found.values():
            plain += "_"
        found[name] = plain
    return found


def _camera_text(name: str, identifier: str, camera: Camera, T_world_optical: Array) -> str:
    p, (width, height) = camera.parameters, camera.image_size
    right, down = shift_of(camera)
    f, per_x, per_y = _SENSOR * p["fx"] / width, _SENSOR / width, _SENSOR / width * p["fx"] / p["fy"]
    matrix = ", ".join(f"({', '.join(text_of(row))})" for row in (T_world_optical @ TURNED).T)
    lens = {
        "focalLength": f,
        "horizontalAperture": width * per_x,
        "verticalAperture": height * per_y,
        "horizontalApertureOffset": -right * per_x,
        "verticalApertureOffset": down * per_y,
    }
    shown = "" if name == identifier else f" (\n        displayName = {json.dumps(name)}\n    )"
    return (
        f'    def Camera "{identifier}"{shown}\n    {{\n'
        + "".join(f"        float {key} = {text_of([value])[0]}\n" for key, value in lens.items())
        + '        token projection = "perspective"\n'
        "        float2 clippingRange = (0.01, 10000)\n"
        f"        matrix4d xformOp:transform = ( {matrix} )\n"
        '        uniform token[] xformOpOrder = ["xformOp:transform"]\n'
        "    }\n"
    )


def _product_text(identifier: str, camera: Camera) -> str:
    return (
        f'    def RenderProduct "{identifier}"\n    {{\n'
        f"        rel camera = </World/{identifier}>\n"
        f"        uniform int2 resolution = ({camera.image_size[0]}, {camera.image_size[1]})\n"
        f'        uniform token aspectRatioConformPolicy = "{_ALL_PIXELS}"\n'
        "    }\n"
    )


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    if not result.cameras:
        raise InputError("no camera in it; a USD scene is written of cameras")
    world = world_of(result, options.answers.get("world"))
    places = places_in(result, world, tuple(result.cameras))
    names = _identifiers(tuple(places))
    cameras = "".join(_camera_text(name, names[name], result.cameras[name], T) for name, T in places.items())
    products = "".join(_product_text(names[name], result.cameras[name]) for name in places)
    head = '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n\n'
    scene = f'def Xform "World"\n{{\n{cameras}}}\n\ndef Scope "Render"\n{{\n{products}}}\n'
    return (head + scene).encode()


FORMAT = ExchangeFormat(
    name="usd",
    title="USD scene with cameras",
    suffix=".usda",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole",),
    asks={
        "aperture": f"which aperture counts where their ratio is not the image's, {', '.join(_APERTURES)}",
        "world": "the frame that is the scene's world",
    },
)
