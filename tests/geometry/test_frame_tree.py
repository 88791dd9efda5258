"""Ways through trees of frames: over the common frame, none between trees, and no end in a circle."""

from __future__ import annotations

from calibrant.geometry.frame_tree import ancestors, way_between

TREE = {"camera": "base", "tool": "wrist", "wrist": "arm", "arm": "base", "island": "sea", "a": "b", "b": "a"}


def test_the_way_goes_up_to_the_common_frame_and_down() -> None:
    assert way_between("camera", "tool", TREE.get) == (["camera"], ["arm", "wrist", "tool"])
    assert way_between("tool", "camera", TREE.get) == (["tool", "wrist", "arm"], ["camera"])
    assert way_between("tool", "arm", TREE.get) == (["tool", "wrist"], [])
    assert way_between("tool", "tool", TREE.get) == ([], [])
    assert way_between("tool", "island", TREE.get) is None
    assert way_between("tool", "unheard", TREE.get) is None


def test_a_circle_ends() -> None:
    assert ancestors("a", TREE.get) == ["a", "b"]
    assert way_between("a", "tool", TREE.get) is None
