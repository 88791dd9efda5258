"""Pictures of what was found have the photo's name, and never the photo's file."""

from __future__ import annotations

from calibrant.tasks.inputs.picture_names import picture_names


def test_names_are_short_apart_and_not_the_photos_own() -> None:
    ids = ["00.png", "01.JPG", "left/2.png", "right/2.png", "a.png", "a.jpg", "video.mp4/000120", "plain"]
    names = picture_names(ids)
    assert names["00.png"] == "00-seen.png"
    assert names["01.JPG"] == "01-seen.png"
    assert names["left/2.png"] == "left_2-seen.png"
    assert names["a.png"] == "a_png-seen.png"
    assert names["video.mp4/000120"] == "video.mp4_000120-seen.png"
    assert len(set(names.values())) == len(ids)
    assert not set(names.values()) & set(ids)
