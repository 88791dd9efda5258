"""The scale beside pictures of lengths: round lengths, at the height of their colours."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.perceive.colour_scale import ColourScale


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.5, 1.0, (500.0, 600.0, 700.0, 800.0, 900.0, 1000.0)),
        (0.00012, 0.00047, (0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45)),
        (0.813, 4.207, (1000.0, 1500.0, 2000.0, 2500.0, 3000.0, 3500.0, 4000.0)),
        (1.0, 1.0 + 1e-12, (1000.0,)),
    ],
)
def test_ticks_are_round(low: float, high: float, ticks: tuple[float, ...]) -> None:
    found = ColourScale("z", low, high).ticks_mm
    assert found == pytest.approx(ticks)


def test_the_bar_has_the_colours_of_its_lengths_and_the_picture_stays() -> None:
    scale = ColourScale("z", 0.5, 1.0)
    picture = scale.colours(np.linspace(0.4, 1.1, 400)[:, None] * np.ones(30))
    drawn = scale.beside(picture)
    np.testing.assert_array_equal(drawn[:, :30], picture)
    column = drawn[:, 30 + 10].astype(int)
    bar = column[np.flatnonzero(column.max(axis=1))]
    ends = scale.colours([0.5, 1.0]).astype(int)
    assert np.abs(bar[-1] - ends[1]).max() <= 8
    assert any(np.abs(row - ends[0]).max() <= 8 for row in bar[:20])
    near, far = ends
    assert near[2] > near[0]  # red
    assert far[0] > far[2]  # blue


def test_what_is_not_known_is_black_and_outliers_do_not_stretch_the_scale() -> None:
    values = np.r_[np.linspace(1.0, 2.0, 98), 50.0, np.nan]
    scale = ColourScale.of("z", values, outside=0.02)
    assert 1.9 < scale.high < 2.1
    colours = scale.colours(values)
    assert colours[-1].tolist() == [0, 0, 0]
    assert colours[-2].tolist() == scale.colours([scale.high])[0].tolist()
    nothing = ColourScale.of("z", [np.nan], outside=0.02)
    assert nothing.beside(np.zeros((50, 40, 3), np.uint8)).shape[0] == 50
