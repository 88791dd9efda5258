from __future__ import annotations

import numpy as np
import pytest
from tests.calibrate.lens_views import SIZE, board_poses, observe

from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.calibrate.intrinsics.model_choice import Candidate, _decide, choose_model, ladder
from calibrant.cameras import Camera
from calibrant.data import Observations
from calibrant.errors import InputError

PIXELS = {"fx": 900.0, "fy": 905.0, "cx": 645.0, "cy": 507.0}
BARREL = {**PIXELS, "k1": -0.28, "k2": 0.09, "p1": 8e-4, "p2": -1e-3, "k3": -0.012}


def views(model: str, parameters: dict[str, float], *, reach_deg: float = 20, count: int = 20) -> Observations:
    camera = Camera.create(model, parameters, image_size=SIZE)
    poses = board_poses(count, reach_deg=reach_deg, distance=(0.3, 0.6))
    return observe(camera.model, camera.values, poses, sigma=0.1)


def test_an_ideal_lens_gets_the_pinhole() -> None:
    """Brown and rational describe it as well; the simplest is taken, and the words say so."""
    choice = choose_model(views("pinhole", PIXELS), ("pinhole", "brown", "rational"))
    assert choice.model == "pinhole"
    assert "brown (9)" in choice.check.message
    assert "as good, with more parameters" in choice.check.message


def test_a_distorted_lens_gets_brown() -> None:
    result = calibrate_intrinsics(views("brown", BARREL), model="auto")
    assert result.camera.model.name == "brown"
    assert result.held_out is not None
    assert result.held_out.px is not None
    # 0.1 px an axis is 0.141 px a point; held-out poses absorb a little of it.
    assert abs(result.held_out.px / (0.1 * np.sqrt(2)) - 1) < 0.15
    assert result.check("model-choice").status == "ok"


@pytest.mark.parametrize(
    ("model", "parameters", "reach_deg", "first"),
    [
        ("brown", BARREL, 20.0, "pinhole"),
        ("kannala_brandt", {**PIXELS, "fx": 400.0, "fy": 402.0, "k1": -0.02}, 75.0, "extended_unified"),
    ],
)
def test_the_ladder_follows_the_field_of_view(
    model: str, parameters: dict[str, float], reach_deg: float, first: str
) -> None:
    assert ladder(views(model, parameters, reach_deg=reach_deg))[0] == first


def test_fixed_terms_narrow_the_ladder() -> None:
    seen = views("brown", BARREL)
    assert ladder(seen, ("k6",)) == ("rational",)
    with pytest.raises(InputError, match="none has all of: xi"):
        ladder(seen, ("xi",))


def test_few_views_cannot_judge() -> None:
    with pytest.raises(InputError, match="needs 6 or more; there are 4"):
        choose_model(views("brown", BARREL, count=4), ("brown",))


def candidate(model: str, free: int, squares: list[float], bic: float) -> Candidate:
    return Candidate(model, free, 0.2, float(np.sqrt(np.mean(squares))), bic, np.array(squares))


def test_a_better_model_wins_only_beyond_its_uncertainty() -> None:
    simple = candidate("simple", 4, [0.10, 0.12, 0.11, 0.13], bic=-10)
    hardly = candidate("rich", 9, [0.11, 0.10, 0.12, 0.12], bic=-9)
    clearly = candidate("rich", 9, [0.05, 0.06, 0.055, 0.065], bic=-90)
    assert _decide((simple, hardly)).model == "simple"
    assert _decide((simple, clearly)).model == "rich"


def test_a_simpler_choice_of_the_criterion_is_a_warning() -> None:
    simple = candidate("simple", 4, [0.10, 0.12, 0.11, 0.13], bic=-90)
    rich = candidate("rich", 9, [0.05, 0.06, 0.055, 0.065], bic=-9)
    check = _decide((simple, rich)).check
    assert check.status == "warn"
    assert "BIC prefers simple" in check.message
