"""Images of several cameras matched by name, by time stamps, by order; when their moments were."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.inputs.by_camera import boards_by_name, images_by_camera
from calibrant.tasks.inputs.image_moments import images_by_moment, matched_images, moment_names
from calibrant.tasks.inputs.moment_times import moment_times


def files(*names: str) -> list[Path]:
    return [Path(n) for n in names]


NAMED = {
    "a": files("cam0_01.png", "cam0_02.png", "cam0_03.png"),
    "b": files("cam1_02.png", "cam1_03.png"),
    "c": files("cam2_03.png", "cam2_01.png", "cam2_04.png"),
}


def test_three_lists_by_name() -> None:
    found = matched_images(NAMED)
    assert found.rule == "name"
    assert found.rows == ((0, None, 1), (1, 0, None), (2, 1, 0), (None, None, 2))
    assert found.alone == ((), (), (2,))
    assert found.words.startswith("3 moments of 3 cameras by name, 1 of all, 2 of 2; 1 of camera c without a partner")


def test_a_list_that_meets_no_other_stays_alone() -> None:
    found = matched_images({"a": files("1.png", "2.png"), "b": files("1.png", "2.png"), "c": files("8.png", "9.png")})
    assert found.rule == "name"
    assert found.alone == ((), (), (0, 1))


def test_three_lists_by_time() -> None:
    lists = {
        name: files(*(f"{1403636579.0 + 0.1 * k + late:.3f}.png" for k in range(5) if k != lost))
        for name, late, lost in (("a", 0.0, None), ("b", 0.012, 2), ("c", -0.02, 0))
    }
    found = matched_images(lists)
    assert found.rule == "time"
    assert found.rows == ((0, 0, None), (1, 1, 0), (2, None, 1), (3, 2, 2), (4, 3, 3))
    times = list(moment_times(lists, found, fps=None).values())
    assert times == pytest.approx([0.006, 0.0973, 0.19, 0.2973, 0.3973], abs=1e-4)


def test_times_given_match_what_names_do_not() -> None:
    """Each list counts for itself and lost other pictures: by order or by name the wrong ones would meet."""
    lists = {"left": files("l0.png", "l1.png", "l2.png", "l3.png"), "right": files("r0.png", "r1.png", "r2.png")}
    times = {
        "left": dict(zip(lists["left"], [0.0, 1.0, 2.1, 3.0])),
        "right": dict(zip(lists["right"], [1.02, 2.07, 3.4])),
    }
    found = matched_images(lists, rule="time", times=times)
    assert found.rows == ((0, None), (1, 0), (2, 1), (3, 2))
    assert found.words == "3 pairs by the times given; 1 of the left camera without a partner: l0.png"
    apart = {"left": times["left"], "right": {f: t + 100 for f, t in times["right"].items()}}
    with pytest.raises(InputError, match="--times: the times of no two images of different cameras meet"):
        matched_images(lists, rule="time", times=apart)


def test_three_lists_by_order_need_equal_numbers() -> None:
    found = matched_images({"a": files("x.png", "y.png"), "b": files("p.png", "q.png"), "c": files("m.png", "n.png")})
    assert (found.rule, found.rows) == ("order", ((0, 0, 0), (1, 1, 1)))
    with pytest.raises(InputError, match=r"2 of camera a .* and 1 of camera b"):
        matched_images({"a": files("x.png", "y.png"), "b": files("p.png")})


def test_a_moment_goes_whole() -> None:
    found = matched_images(NAMED)
    keep = {f.name: f.name != "cam1_03.png" for side in NAMED.values() for f in side}
    kept = images_by_moment(NAMED, found, keep)
    assert [list(side) for side in kept.values()] == [NAMED["a"][:2], NAMED["b"][:1], NAMED["c"][1:]]
    assert len(set(moment_names(NAMED, found))) == 4


def test_numbers_are_times_by_the_rate() -> None:
    found = matched_images(NAMED)
    assert list(moment_times(NAMED, found, fps=10.0).values()) == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert moment_times(NAMED, found, fps=None) == {}
    with pytest.raises(InputError, match="above 0"):
        moment_times(NAMED, found, fps=0.0)
    nameless = {"a": files("x.png"), "b": files("x.png")}
    with pytest.raises(InputError, match="has no number"):
        moment_times(nameless, matched_images(nameless), fps=10.0)


def test_names_before_images_and_boards() -> None:
    assert images_by_camera(["a=x", "b=y", "a=z"]) == {"a": ("x", "z"), "b": ("y",)}
    assert boards_by_name(["f=chessboard:9x6:25mm"]) == {"f": "chessboard:9x6:25mm"}
    with pytest.raises(InputError, match="there is a board f already"):
        boards_by_name(["f=chessboard:9x6:25mm", "f=chessboard:8x6:25mm"])
    with pytest.raises(InputError, match="has a name here"):
        boards_by_name(["chessboard:9x6:25mm"])
