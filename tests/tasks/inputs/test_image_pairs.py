"""Images of two cameras paired by name, by time, by order; what has no partner is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrant.errors import InputError
from calibrant.tasks.inputs.by_side import named_by_side, one_by_side, several_by_side
from calibrant.tasks.inputs.image_pairs import paired_images


def files(*names: str) -> list[Path]:
    return [Path(n) for n in names]


@pytest.mark.parametrize(
    ("left", "right", "pairs"),
    [
        (("l/1.png", "l/2.png"), ("r/1.png", "r/2.png"), ((0, 0), (1, 1))),
        (("left01.jpg", "left02.jpg"), ("right02.jpg", "right01.jpg"), ((0, 1), (1, 0))),
        (("cam0_0001.png", "cam0_0002.png"), ("cam1_0002.png", "cam1_0003.png"), ((1, 0),)),
        (("7-L.png", "8-L.png", "9-L.png"), ("7-R.png", "9-R.png"), ((0, 0), (2, 1))),
        (("left.png",), ("right.png",), ((0, 0),)),
        (("left_1.png", "left_02.png"), ("right_01.png", "right_2.png"), ((0, 0), (1, 1))),
    ],
)
def test_by_name(left: tuple[str, ...], right: tuple[str, ...], pairs: tuple[tuple[int, int], ...]) -> None:
    found = paired_images(files(*left), files(*right))
    assert (found.rule, found.pairs) == ("name", pairs)


def test_pairs_are_counted_in_words() -> None:
    assert paired_images(files("left.png"), files("right.png")).words == "1 pair by name"
    assert paired_images(files("left1.png", "left2.png"), files("right1.png", "right2.png")).words == "2 pairs by name"


def test_what_has_no_partner_is_named() -> None:
    found = paired_images(files("left1.png", "left2.png", "left4.png"), files("right1.png", "right2.png", "right3.png"))
    assert (found.alone_left, found.alone_right) == ((2,), (2,))
    assert "1 of the left camera without a partner: left4.png" in found.words
    assert "1 of the right camera without a partner: right3.png" in found.words


def test_by_time_stamps() -> None:
    """Shutters a few milliseconds apart, a frame lost on one side: the nearest within half a period."""
    start = 1403636579763555584
    left = files(*(f"{start + k * 50_000_000}.png" for k in range(6)))
    right = files(*(f"{start + k * 50_000_000 + 2_000_017}.png" for k in (0, 1, 3, 4, 5)))
    found = paired_images(left, right)
    assert found.rule == "time"
    assert found.pairs == ((0, 0), (1, 1), (3, 2), (4, 3), (5, 4))
    assert found.alone_left == (2,)


def test_by_order_is_said_and_needs_equal_numbers() -> None:
    found = paired_images(files("a.png", "b.png"), files("x.png", "y.png"))
    assert (found.rule, found.pairs) == ("order", ((0, 0), (1, 1)))
    assert "by order, because their names do not tell" in found.words
    with pytest.raises(InputError, match=r"3 of the left camera .* and 2 of the right"):
        paired_images(files("a.png", "b.png", "c.png"), files("x.png", "y.png"))
    asked = paired_images(files("left2.png", "left1.png"), files("right1.png", "right2.png"), rule="order")
    assert asked.pairs == ((0, 0), (1, 1))


def test_a_rule_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="no names meet"):
        paired_images(files("a.png", "b.png"), files("x.png", "y.png"), rule="name")
    with pytest.raises(InputError, match="time stamps"):
        paired_images(files("a.png", "b.png"), files("x.png", "y.png"), rule="time")


def test_values_by_side() -> None:
    assert one_by_side(["brown", "left:kannala_brandt"], option="--model") == {
        "left": "kannala_brandt",
        "right": "brown",
    }
    assert one_by_side(["right=rational"], option="--model") == {"right": "rational"}
    assert several_by_side(["left:k3,right:focal", "aspect"], option="--fix") == {
        "left": ("k3", "aspect"),
        "right": ("focal", "aspect"),
    }
    assert named_by_side(["left=a.json"], option="--camera") == {"left": Path("a.json")}
    for values, words in ((["brown", "rational"], "both sides has one"), (["left:a", "left:b"], "the left camera has")):
        with pytest.raises(InputError, match=words):
            one_by_side(values, option="--model")
    with pytest.raises(InputError, match="say of which camera"):
        named_by_side(["a.json"], option="--camera")
    with pytest.raises(InputError, match="of the left camera or of both"):
        several_by_side(["left:k3,p1"], option="--fix")
