"""A real fisheye of 185 degrees: BabelCalib's ov_plane, corners detected by its authors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.intrinsics.model_choice import calibrate_auto
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import Observations
from calibrant.data.details import ModelChoice
from calibrant.errors import RefusedError


def load(folder: Path, part: str) -> Observations:
    """Corners of one part. `corners[i].x` (2, n) pixels, `cspond` row 0 the 1-based index into `boards.X` (2, 484)."""
    data = loadmat(folder / f"{part}.mat", squeeze_me=True, struct_as_record=False)
    board = np.concatenate([data["boards"].X.T, np.zeros((data["boards"].X.shape[1], 1))], axis=1)
    views = data["corners"]
    return Observations.from_points(
        [board[v.cspond[0].astype(int) - 1] for v in views],
        [v.x.T.astype(float) for v in views],
        image_size=(1280, 800),
    )


OF_THE_PHOTOS = (
    "residual-structure", "image-coverage", "corner-coverage", "tilt-range", "distance-range", "board-flatness",
    "linearity",
)  # fmt: skip
"""What is asked of photos and board (corners they leave out, a board that is not flat, points that err alike, by which
terms of one lens are not told apart), whatever the model."""


@pytest.fixture(scope="module")
def parts(shared_data: Callable[[str], Path]) -> tuple[Observations, Observations]:
    folder = shared_data("fisheye_babelcalib_ov_plane")
    return load(folder, "train"), load(folder, "test")


def rms(camera: Camera, observations: Observations) -> float:
    """RMS, px, of all points with only the poses fitted."""
    points = np.array([len(v) for v in observations.views])
    return float(np.sqrt(np.average(target_poses(camera, observations.views).rms_px ** 2, weights=points)))


@pytest.fixture(scope="module")
def unified(parts: tuple[Observations, Observations]) -> Camera:
    return calibrate_intrinsics(parts[0], model="unified").camera


def test_unified_reaches_the_reference(parts: tuple[Observations, Observations], unified: Camera) -> None:
    """cv2.omnidir.calibrate gives 0.4999 px on train and 0.4865 px on test when it is fitted to test itself."""
    train, test = parts
    assert len(train.views) == 18
    assert rms(unified, train) <= 0.50
    assert len(test.views) == 7
    assert rms(unified, test) <= 0.50
    assert abs(unified.parameters["cx"] - 647.94) < 1
    assert abs(unified.parameters["cy"] - 405.85) < 1


@pytest.mark.parametrize("model", ["kannala_brandt", "extended_unified", "double_sphere"])
def test_other_wide_models_are_as_good(model: str, parts: tuple[Observations, Observations], unified: Camera) -> None:
    result = calibrate_intrinsics(parts[0], model=model)
    assert [c.name for c in result.checks if c.status != "ok" and c.name not in OF_THE_PHOTOS] == []
    assert rms(result.camera, parts[0]) <= rms(unified, parts[0])
    assert rms(result.camera, parts[1]) <= rms(unified, parts[1])


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational", "thin_prism", "tilted"])
def test_perspective_models_are_refused_in_words(model: str, parts: tuple[Observations, Observations]) -> None:
    with pytest.raises(RefusedError, match=r"degrees from the axis.*kannala_brandt"):
        calibrate_intrinsics(parts[0], model=model)


@pytest.mark.long
def test_auto_takes_a_model_that_fits(parts: tuple[Observations, Observations]) -> None:
    result = calibrate_auto(parts[0])
    assert rms(result.camera, parts[1]) <= 0.50
    assert result.held_out is not None
    assert result.held_out.px is not None
    assert result.held_out.px <= 0.50
    assert "held-out views" in result.check("model-choice").message
    assert {c.model for c in result.detail(ModelChoice).candidates} >= {"kannala_brandt", "unified"}
