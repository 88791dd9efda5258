"""What a rig says of how it is tied: as much as its sigma holds, no more."""

from __future__ import annotations

import pytest

import calibrant as cb
from calibrant.simulate.stereo import stereo_scene

UNTOLD = "sigma holds nothing of it"


@pytest.mark.parametrize(("frames", "told"), [(2, False), (3, True)])
def test_few_moments_say_whether_sigma_holds_what_they_share(frames: int, told: bool) -> None:
    """On photos of a real pair, pairs drawn by two were off by 1.9 of their sigma, by three and more by 1.0."""
    result = cb.calibrate_stereo(stereo_scene(5, frames=frames, partly=False).observations)
    assert any(c.name == "moments" for c in result.checks) == told
    tied = result.check("shared-moments")
    assert tied.status == "warn"
    assert tied.message.startswith(f"left and right are tied by {frames} common moments")
    assert (UNTOLD not in tied.message) == told
