"""No board is reported where there is none."""

from __future__ import annotations

import pytest
from tests.detection.clutter import cluttered

from calibrant.detection.registry import detector_for
from calibrant.targets.registry import parse_target

SPECS = (
    "chessboard:9x6:25mm",
    "charuco:5x7:36mm:18mm:DICT_6X6_250",
    "circles:7x11:40mm:asymmetric",
    "circles:10x10:25mm:bigdot",
    "circles:9x6:25mm",
    "aprilgrid:6x6:88mm:0.3:36h11",
    "marker:50mm:DICT_APRILTAG_36h11:10",
)
FEW = 6
"""One picture of each kind; the benchmark takes 200."""


@pytest.mark.parametrize("spec", SPECS)
def test_no_board_is_seen_in_clutter(spec: str) -> None:
    target = parse_target(spec)
    detector = detector_for(target.kind)
    assert [seed for seed in range(FEW) if detector.detect(cluttered(seed), target).found] == []
