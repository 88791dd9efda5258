"""ZED's .conf: resolutions, both sets of terms, where the right camera is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

EYE = "fx={f}\nfy=700.1\ncx={c}\ncy=350.5\nk1=-0.17\nk2=0.026\np1=0.0002\np2=5e-05\nk3=0.008\n\n"
STEREO = "[STEREO]\nBaseline=119.9\nTY=0.05\nTZ=0.17\nCV_HD=0.0107\nCV_VGA=0.0107\nRX_HD=0.0012\nRZ_HD=0.0014\n"
TEXT = "".join(
    f"[{side}_CAM_{mode}]\n" + EYE.format(f=700.819 + (side == "RIGHT"), c=665.465 if mode == "HD" else 340.0)
    for mode in ("HD", "VGA")
    for side in ("LEFT", "RIGHT")
).replace("cy=350.5", "cy=180.5")
EIGHT = "k1=1.5\nk2=-2.8\nk3=1.6\nk4=0.6\nk5=-2.7\nk6=1.5\np1=0.0002\np2=5e-05\n"


def written(folder: Path, text: str = TEXT + STEREO) -> Path:
    (folder / "SN1234.conf").write_text(text)
    return folder / "SN1234.conf"


def test_the_right_camera_is_to_the_right(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path))
    T = se3.inverse(found.transform("left", "right").matrix)
    np.testing.assert_allclose(T, se3.make(so3.exp([0.0012, 0.0107, 0.0014]), [-0.1199, 5e-5, 1.7e-4]), atol=1e-15)
    assert found.transform("left", "right").matrix[0, 3] > 0.119
    left = found.cameras["left"]
    assert (left.image_size, left.parameters["cx"], left.parameters["k3"]) == ((1280, 720), 665.465, 0.008)
    assert any("mode=" in n for n in found.notes)


@pytest.mark.parametrize("options", [{"image_size": "672x376"}, {"answer": ["mode=VGA"]}])
def test_another_resolution(tmp_path: Path, options: dict) -> None:
    assert cb.convert(written(tmp_path), **options).cameras["right"].parameters["cx"] == 340.0


def test_eight_terms_are_taken_whole(tmp_path: Path) -> None:
    both = "".join(f"[{side}_DISTO]\n{EIGHT}" for side in ("LEFT", "RIGHT"))
    camera = cb.convert(written(tmp_path, TEXT + both + STEREO)).cameras["left"]
    assert (camera.model.name, camera.parameters["k1"], camera.parameters["k6"]) == ("rational", 1.5, 1.5)
    four = both.replace("-2.7", "0").replace("k6=1.5", "k6=0").replace("0.0002", "0").replace("5e-05", "0")
    with pytest.raises(InputError, match="lens=fisheye"):
        cb.convert(written(tmp_path, TEXT + four + STEREO))
    found = cb.convert(written(tmp_path, TEXT + four + STEREO), answer=["lens=fisheye"])
    assert found.cameras["left"].model.name == "kannala_brandt"


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (TEXT.replace("fx=700.819", "fx=wide") + STEREO, {}, "fx"),
        (TEXT + STEREO.replace("119.9", "-119.9"), {}, "Baseline"),
        (TEXT + STEREO, {"image_size": "100x100"}, "HD 1280x720"),
        (TEXT + STEREO, {"answer": ["mode=8K"]}, "mode=8K"),
        ("[LEFT_CAM_WIDE]\nfx=1\n", {}, "none of them known"),
        ("[LEFT_CAM_HD]\nfx\n[[\n=3", {}, "sections and values"),
        (TEXT.replace("k1=-0.17", "k1=-0.17\nxi=0.3") + STEREO, {}, "xi"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, text), **options)


def test_a_baseline_in_metres(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, TEXT + STEREO.replace("119.9", "0.12").replace("TZ=0.17", "TZ=0")))
    assert found.transform("left", "right").matrix[0, 3] == pytest.approx(0.12, abs=1e-3)
