"""Metashape's XML: its equations (p1 and p2 the other way round, k4, b1, b2), chunks with their scale, fisheyes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.exchange.read import read_any
from calibrant.geometry import se3, so3
from calibrant.reading.notes import heard

F, CX, CY, B1, B2 = 3705.47, 11.67, -27.75, 0.526, -0.306
K1, K2, K3, K4, P1, P2 = -0.0919, -0.0763, 0.1163, -0.0761, -3.1e-4, 1.2e-4
R_CHUNK, T_CHUNK, SCALE = so3.exp([0.2, -0.5, 0.9]), np.array([-2499366.4, -4256836.5, 4029217.9]), 12.354
T_CAMERA = se3.make(so3.exp([0.3, 0.1, -0.7]), [1.0, -2.0, 0.5])


def xml(lens: dict[str, float], kind: str = "frame", *, placed: bool = True) -> str:
    def row(values: object) -> str:
        return " ".join(repr(float(v)) for v in np.ravel(values))  # type: ignore[arg-type]

    terms = "".join(f"<{name}>{value!r}</{name}>" for name, value in lens.items())
    chunk = (
        f"<transform><rotation locked='true'>{row(R_CHUNK)}</rotation><translation>{row(T_CHUNK)}</translation>"
        f"<scale>{SCALE}</scale></transform>"
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
 <sensors next_id="2">
  <sensor id="0" label="M3M (12.29mm)" type="{kind}"><resolution width="5280" height="3956"/>
   <property name="pixel_width" value="0.0033582"/>
   <calibration type="{kind}" class="initial"><resolution width="5280" height="3956"/><f>3600</f></calibration>
   <calibration type="{kind}" class="adjusted"><resolution width="5280" height="3956"/>{terms}</calibration>
  </sensor>
 </sensors>
 <components><component id="0" label="Component 1">{chunk if placed else ""}</component></components>
 <cameras next_id="2"><group id="0">
  <camera id="0" sensor_id="0" component_id="0" label="DJI_1"><transform>{row(T_CAMERA)}</transform></camera></group>
  <camera id="1" sensor_id="0" component_id="0" label="DJI_2"/>
 </cameras>
</chunk></document>"""


def pixel(p: np.ndarray, lens: dict[str, float], *, fisheye: bool = False) -> np.ndarray:
    """The manual's equations, from the image's corner."""
    g = {"b1": 0.0, "b2": 0.0, "k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0, "p1": 0.0, "p2": 0.0} | lens
    x, y = p[0] / p[2], p[1] / p[2]
    if fisheye:
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    r2 = x * x + y * y
    radial = 1 + g["k1"] * r2 + g["k2"] * r2**2 + g["k3"] * r2**3 + g["k4"] * r2**4
    u = x * radial + g["p1"] * (r2 + 2 * x * x) + 2 * g["p2"] * x * y
    v = y * radial + g["p2"] * (r2 + 2 * y * y) + 2 * g["p1"] * x * y
    return np.array([2640 + g["cx"] + u * g["f"] + u * g["b1"] + v * g["b2"], 1978 + g["cy"] + v * g["f"]])


BASE = {"f": F, "cx": CX, "cy": CY}
FRAME = BASE | {"b1": B1, "k1": K1, "k2": K2, "k3": K3, "p1": P1, "p2": P2}
P = np.array([0.3, -0.2, 1.1])


def written(folder: Path, text: str) -> Path:
    (folder / "cameras.xml").write_text(text)
    return folder / "cameras.xml"


@pytest.mark.parametrize(
    ("lens", "kind"),
    [
        (FRAME, "frame"),
        (BASE | {"b2": B2}, "frame"),
        (BASE | {"b1": B1, "b2": B2, "k1": K1, "k2": K2, "p1": P1, "p2": P2}, "frame"),
        (BASE | {"k1": 0.05, "k2": -0.01, "k3": 0.002, "k4": -3e-4}, "equidistant_fisheye"),
    ],
)
def test_a_point_lands_where_the_manual_says(tmp_path: Path, lens: dict[str, float], kind: str) -> None:
    found = cb.convert(written(tmp_path, xml(lens, kind)))
    uv = found.cameras["M3M (12.29mm)"].project(P) + 0.5
    np.testing.assert_allclose(uv, pixel(P, lens, fisheye=kind != "frame"), atol=1e-8)


def test_places_carry_the_chunks_scale(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, xml(FRAME)))
    world = SCALE * R_CHUNK @ (T_CAMERA @ [*P, 1])[:3] + T_CHUNK
    assert [v.id for v in found.views] == ["DJI_1"]
    np.testing.assert_allclose(se3.apply(found.views[0].T_camera_target, world), SCALE * P, atol=1e-6)
    assert any("1 pictures were not aligned" in n for n in found.notes)
    assert any("--unit" in n for n in cb.convert(written(tmp_path, xml(FRAME, placed=False))).notes)


@pytest.mark.long
@pytest.mark.parametrize("more", [{"k4": K4}, {"b2": B2}])
def test_what_no_model_says_is_refused_with_its_error_or_brought_near(tmp_path: Path, more: dict[str, float]) -> None:
    lens = FRAME | more
    file = written(tmp_path, xml(lens))
    with pytest.raises(InputError, match=r"px RMS.*answer approximate=yes"):
        cb.convert(file)
    found = cb.convert(file, answer=["approximate=yes"])
    rays = [(x, y, 1.0) for x in (-0.6, 0.0, 0.6) for y in (-0.4, 0.1, 0.4)]
    away = [found.camera.project(p) + 0.5 - pixel(np.array(p), lens) for p in rays]
    assert np.abs(away).max() < 0.2
    assert any("px RMS" in n for n in found.notes)


def test_its_covariance_comes_along(tmp_path: Path) -> None:
    C = np.diag([4.0, 1.0, 1.0, 0.25, 1e-6, 1e-8])
    C[0, 3] = C[3, 0] = 0.5
    told = " ".join(map(repr, C.ravel().tolist()))
    more = f"<covariance><params>f cx cy b1 k1 p1</params><coeffs>{told}</coeffs></covariance></sensor>"
    camera = cb.convert(written(tmp_path, xml(FRAME).replace("</sensor>", more))).cameras["M3M (12.29mm)"]
    assert camera.sigma["fx"] == pytest.approx(np.sqrt(4 + 0.25 + 2 * 0.5))
    assert (camera.sigma["fy"], camera.sigma["p2"], camera.sigma["p1"]) == (2.0, pytest.approx(1e-4), 0.0)


def test_one_calibration(tmp_path: Path) -> None:
    text = (
        "<calibration><projection>frame</projection><width>1920</width><height>1080</height><f>1430.15</f>"
        "<cx>-24.134</cx><cy>17.545</cy><b2>-4.25</b2><k1>-0.1183</k1><k2>0.2936</k2><p1>0.00033</p1><p2>0.00182</p2>"
        "<date>2017-11-14T23:30:12Z</date></calibration>"
    )
    camera = cb.convert(written(tmp_path, text)).cameras["camera"]
    assert (camera.parameters["skew"], camera.parameters["p2"]) == (-4.25, 0.00033)
    assert camera.parameters["cx"] == pytest.approx(960 - 24.134 - 0.5)


def test_round_trip(tmp_path: Path) -> None:
    before = cb.convert(written(tmp_path, xml(FRAME).replace(str(SCALE), "1.0").replace("-4256836.5", "1.5")))
    cb.convert(tmp_path / "cameras.xml", tmp_path / "again.xml", to="agisoft")
    after = cb.convert(tmp_path / "again.xml")
    assert after.camera.parameters == pytest.approx(before.camera.parameters, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(after.views[0].T_camera_target, before.views[0].T_camera_target, rtol=1e-12, atol=1e-8)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('type="frame"', 'type="spherical"', "spherical"),
        (f"<f>{F!r}</f>", "<f>wide</f>", "<f>"),
        ("<scale>12.354</scale>", "<scale>-1</scale>", "scale"),
        ('width="5280"', 'width="0"', "image size"),
        (" 0.0 0.0 0.0 1.0</transform>", "</transform>", "16 numbers"),
        ("<k1>", "<fx>3000.0</fx><k1>", "either order"),
    ],
)
def test_bad_files(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = xml(FRAME)
    assert old in text
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, text.replace(old, new)))


def test_a_photo_that_photoscan_did_not_align_is_left_out(tmp_path: Path) -> None:
    """Version 1.2 writes sixteen zeros where later ones write nothing."""
    file = tmp_path / "cameras.xml"
    zeros = '<camera id="1" sensor_id="0" label="DJI_2"><transform>' + "0 " * 16 + "</transform></camera>"
    absent = '<camera id="1" sensor_id="0" component_id="0" label="DJI_2"/>'
    file.write_text(xml({"f": F, "cx": CX, "cy": CY}).replace(absent, zeros))
    with heard() as notes:
        found = read_any(file)
    assert [view.id for view in found.views] == ["DJI_1"]
    assert any("1 pictures were not aligned" in note for note in notes)
