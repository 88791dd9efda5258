"""A rig as a bag: what the cameras' own videos give."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.made_bags import written_bag

import calibrant as cb
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_grey
from calibrant.geometry import se3

SPEC = "charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted"
CAMERAS = ("cam_0", "cam_1", "cam_2", "cam_3")
PERIOD_S = 1 / 6


@pytest.mark.long
def test_four_cameras_as_a_bag_are_the_same_rig(shared_data: Callable[[str], Path], tmp_path: Path) -> None:
    folder = shared_data("multicam_caliscope_charuco") / "post_optimization/calibration/extrinsic"
    videos = {name: folder / f"{name}.mp4" for name in CAMERAS}
    with written_bag(tmp_path, "mcap") as (bag, writer):
        pictures = {name: expand([str(video)]) for name, video in videos.items()}
        for k in range(max(map(len, pictures.values()))):
            for name, files in pictures.items():
                if k < len(files):
                    topic = f"/{name}/image_raw/compressed"
                    writer.compressed(topic, load_grey(files[k]), k * PERIOD_S, "mono8; png compressed ")
    by_files = cb.rig(images={name: str(video) for name, video in videos.items()}, target=SPEC)
    by_bag = cb.rig(bag=bag, image_topic={name: f"/{name}/image_raw" for name in CAMERAS}, target=SPEC)
    assert by_bag.rms_px == pytest.approx(by_files.rms_px, rel=1e-6)
    for found, expected in zip(by_bag.transforms, by_files.transforms, strict=True):
        assert (found.parent, found.child) == (expected.parent, expected.child)
        sigma = np.sqrt(np.diag(expected.covariance))
        # The same pixels: what is left is where the solver stops.
        assert np.all(np.abs(se3.local(expected.matrix, found.matrix)) < 1e-3 * sigma)
    for name in CAMERAS:
        change = np.abs(by_bag.cameras[name].values - by_files.cameras[name].values)
        assert np.all(change < 1e-3 * np.sqrt(np.diag(by_files.cameras[name].covariance)) + 1e-12)
