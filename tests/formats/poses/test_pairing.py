"""Poses and images: the two rules, and what is said when neither works."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.formats.poses.natural_order import natural_key
from calibrant.formats.poses.pairing import match, match_by_order, match_kept
from calibrant.formats.poses.raw import RawPoses


def test_names_pair_with_or_without_folder_and_extension() -> None:
    for poses in (["2", "0", "1"], ["2.png", "0.png", "1.png"], ["images/2.jpg", "images/0.jpg", "images\\1.jpg"]):
        found = match(poses, ["0.png", "1.png", "2.png"])
        assert found.rule == "name"
        assert found.pose_index == (1, 2, 0)
        assert found.view_index == (0, 1, 2)
        assert found.message == "3 images paired with poses by name"


def test_poses_without_an_image_are_left_out_and_reported() -> None:
    found = match(["0", "1", "5", "7"], ["1.png", "0.png"])
    assert found.pose_index == (1, 0)
    assert found.unused_poses == ("5", "7")
    assert "2 poses have no image and are left out: 5, 7" in found.message


def test_an_image_without_a_pose_is_an_error() -> None:
    with pytest.raises(
        InputError, match=r"1 of 3 images have no robot pose: 2\.png; .*called 0, 1; .*--exclude 2\.png"
    ):
        match(["0", "1"], ["0.png", "1.png", "2.png"])


def test_without_names_in_common_the_order_counts_and_it_is_natural() -> None:
    found = match(["p1", "p2", "p3"], ["img10.png", "img2.png", "img1.png"])
    assert found.rule == "order"
    assert dict(zip(found.pose_index, found.view_index)) == {0: 2, 1: 1, 2: 0}
    assert "by order" in found.message
    assert match_by_order(3, ["10", "9", "8"]).pose_index == (2, 1, 0)


def test_order_needs_equal_numbers() -> None:
    with pytest.raises(InputError, match=r"2 poses \(p1, p2\) and 3 images \(a1, a2, a10\): no name .*--exclude"):
        match(["p1", "p2"], ["a10", "a2", "a1"])
    with pytest.raises(InputError, match=r"2 poses and 1 images .*the poses have no names"):
        match_by_order(2, ["a"])


def test_nothing_to_pair_and_shared_names_are_errors() -> None:
    with pytest.raises(InputError, match="0 robot poses and 1 images: nothing to pair"):
        match([], ["a"])
    with pytest.raises(InputError, match=r"two images are both called '0': l/0\.png and r/0\.png"):
        match(["0"], ["l/0.png", "r/0.png"])


@pytest.mark.parametrize("pose", ["data", "image"])
def test_folders_pair_where_the_files_in_them_share_a_name(pose: str) -> None:
    found = match([f"2/{pose}", f"0/{pose}", f"1/{pose}"], ["0/image.png", "1/image.png", "2/image.png"])
    assert found.rule == "name"
    assert found.pose_index == (1, 2, 0)


def test_whole_names_go_before_stems() -> None:
    found = match(["a.png", "a.jpg"], ["a.jpg", "a.png"])
    assert found.pose_index == (1, 0)


def test_names_that_are_numbers_meet_by_what_they_count() -> None:
    found = match([str(i) for i in range(12)], [f"{i:02d}.png" for i in range(12)])
    assert found.rule == "name"
    assert found.pose_index == tuple(range(12))
    assert match(["007", "12"], ["12", "7"]).pose_index == (1, 0)
    # Where two of one side count alike, names are words.
    assert match(["1", "01"], ["01.png", "1.png"]).pose_index == (1, 0)


def test_natural_order() -> None:
    assert sorted(["10", "9", "b2", "B1", "a"], key=natural_key) == ["9", "10", "a", "B1", "b2"]


def poses_of(count: int, names: tuple[str, ...] | None) -> RawPoses:
    places = tuple(f"poses.csv:{i}" for i in range(count))
    return RawPoses(np.zeros((count, 3)), np.tile([0.0, 0, 0, 1], (count, 1)), names, places)


def test_the_pose_of_a_view_that_is_left_out_goes_with_it() -> None:
    views, keep = ["1.png", "10.png", "2.png", "3.png"], [True, True, True, False]
    found = match_kept(poses_of(4, None), views, keep)
    assert dict(zip(found.view_index, found.pose_index)) == {0: 0, 1: 3, 2: 1}  # 1, 2, 3 and 10 in their order
    assert "1 pose goes with what --exclude leaves out" in found.message
    # Whoever took the pose out as well, or has names, is understood as before.
    without = match_kept(poses_of(3, None), views, keep)
    assert dict(zip(without.view_index, without.pose_index)) == {0: 0, 1: 2, 2: 1}
    named = match_kept(poses_of(4, ("3", "2", "10", "1")), views, keep)
    assert named.rule == "name"
    assert named.pose_index == (3, 2, 1)
    with pytest.raises(InputError, match="paired by order"):
        match_kept(poses_of(5, None), views, keep)
