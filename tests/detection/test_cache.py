"""The second run detects nothing again; nothing out of date or cut short is ever used."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.data import Observations
from calibrant.detection import cache as cache_module
from calibrant.detection import detect, pipeline
from calibrant.detection.cache import Cache, key_of
from calibrant.detection.detection import Detection
from calibrant.errors import InputError
from calibrant.reading.notes import heard
from calibrant.targets.registry import parse_target

BOARD = parse_target("chessboard:5x4:20mm")


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """Three pictures of a board and one of nothing."""
    folder = tmp_path / "images"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for i in range(3):
        squares = np.add.outer(np.arange(5), np.arange(6)) % 2
        board = np.kron(squares, np.ones((40, 40))) * 180 + 40
        image = np.full((300, 400), 220.0)
        image[30 + 10 * i :, 40 + 5 * i :][:200, :240] = board
        cv2.imwrite(str(folder / f"{i}.png"), np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8))
    cv2.imwrite(str(folder / "9.png"), np.full((300, 400), 128, np.uint8))
    return folder


def refuse(*_: object) -> None:
    raise AssertionError("an image was searched that was known already")


def same(a: Observations, b: Observations) -> bool:
    """Whether two observations hold the same numbers, to the last bit."""
    return [m.reason for m in a.missed] == [m.reason for m in b.missed] and all(
        v.id == w.id and np.array_equal(v.uv, w.uv) and np.array_equal(v.sigma_px, w.sigma_px)
        for v, w in zip(a.views, b.views, strict=True)
    )


def test_the_second_run_searches_nothing(images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = detect(images, target=BOARD, cache=tmp_path / "kept")
    monkeypatch.setattr(pipeline, "detect_file", refuse)
    assert same(detect(images, target=BOARD, cache=tmp_path / "kept"), first)
    # Under another name it is the same picture.
    (images / "1.png").rename(images / "renamed.png")
    views = detect(images, target=BOARD, cache=tmp_path / "kept").views
    assert [v.id for v in views] == ["0.png", "2.png", "renamed.png"]
    # And its copy is searched no more, but counts once.
    (images / "copy.png").write_bytes((images / "renamed.png").read_bytes())
    again = detect(images, target=BOARD, cache=tmp_path / "kept")
    assert len(again.views) == 3
    assert [m.id for m in again.missed] == ["9.png", "renamed.png"]


def test_what_changes_the_answer_changes_the_key(images: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = images / "0.png"
    keys = {key_of(file, BOARD, False), key_of(file, BOARD, True), key_of(file, BOARD.scaled(2.0), False)}
    keys.add(key_of(images / "1.png", BOARD, False))
    monkeypatch.setattr(cache_module, "code_fingerprint", lambda: "another version")
    keys.add(key_of(file, BOARD, False))
    assert len(keys) == 5
    assert key_of(images / "missing.png", BOARD, False) is None


def test_an_interrupted_run_goes_on_where_it_stopped(images: Path, tmp_path: Path) -> None:
    def stop(done: int, count: int, name: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        detect(images, target=BOARD, cache=tmp_path / "kept", progress=stop)
    kept = list((tmp_path / "kept").rglob("*.json"))
    assert len(kept) == 2
    assert not list((tmp_path / "kept").rglob(".*"))
    assert same(detect(images, target=BOARD, cache=tmp_path / "kept"), detect(images, target=BOARD))


def test_a_file_cut_short_is_made_anew(images: Path, tmp_path: Path) -> None:
    first = detect(images, target=BOARD, cache=tmp_path / "kept")
    for file in (tmp_path / "kept").rglob("*.json"):
        file.write_text(file.read_text()[:20])
    assert same(detect(images, target=BOARD, cache=tmp_path / "kept"), first)


def test_a_detection_reads_back_whole(tmp_path: Path) -> None:
    kept = Cache.at(tmp_path)
    rng = np.random.default_rng(0)
    found = Detection(np.arange(5), rng.normal(size=(5, 2)), rng.uniform(size=5), notes=("a note",))
    missed = Detection.nothing("nothing there", looks_like="9x6 inner corners")
    moved = replace(found, covariance_px=rng.normal(size=(5, 2, 2)), smeared=True)
    for key, detection in (("aa11", found), ("bb22", missed), ("cc33", moved)):
        kept.put(key, (640, 480), detection)
        back = kept.get(key)
        assert back is not None
        size, again = back
        assert size == (640, 480)
        assert np.array_equal(again.uv, detection.uv)
        assert (again.reason, again.notes, again.looks_like) == (
            detection.reason,
            detection.notes,
            detection.looks_like,
        )
        assert (again.sigma_px is None) == (detection.sigma_px is None)
        assert (again.covariance_px is None) == (detection is not moved)
        assert again.covariance_px is None or np.array_equal(again.covariance_px, moved.covariance_px)
        assert again.smeared == (detection is moved)


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot keep detections"):
        Cache.at(tmp_path / "file" / "folder")


def shifted(file: Path) -> None:
    file.write_text(file.read_text().replace("[[", "[[1", 1))


def of_another(file: Path) -> None:
    others = [f for f in file.parent.parent.rglob("*.json") if f != file]
    file.write_bytes(others[0].read_bytes())


def a_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def deep(file: Path) -> None:
    file.write_text("[" * 100_000)


@pytest.mark.parametrize("damage", [shifted, of_another, a_folder, a_pipe, deep], ids=lambda f: f.__name__)
def test_an_entry_that_was_damaged_or_planted_costs_time_alone(
    images: Path, tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    first = detect(images, target=BOARD, cache=tmp_path / "kept")
    damage(sorted((tmp_path / "kept").rglob("*.json"))[0])
    with heard():
        assert same(detect(images, target=BOARD, cache=tmp_path / "kept"), first)


def test_a_full_disk_ends_no_run(images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> object:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cache_module, "draft", full)
    with heard() as notes:
        found = detect(images, target=BOARD, cache=tmp_path / "kept")
    assert len(found.views) == 3
    assert notes == [
        f"detections are not kept in {tmp_path / 'kept'}: no space left on device; later runs search these photos again"
    ]
