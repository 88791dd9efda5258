"""Ctrl-C ends the taking of views, and what was taken is calibrated, through the command line's own token as well."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest
from tests.contracts.doors import TARGET, make_files

from calibrant.cancel import Token, cancellable
from calibrant.detection import live
from calibrant.tasks.boards import capture


def test_views_taken_before_ctrl_c_are_calibrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = make_files(tmp_path)
    token = Token()
    frames = live.frames_from

    def stopped(source: str) -> Iterator[live.Frame]:
        # Fewer than are calibrated on the way: the calibration comes after the stop.
        yield from islice(frames(source), capture.LEAST_VIEWS - 1)
        token.cancel()
        raise KeyboardInterrupt

    monkeypatch.setattr(live, "frames_from", stopped)
    request = capture.Request(camera=str(files.images), target=TARGET, until="0.001px")
    with cancellable(token):
        outcome = capture.run(request)
    assert outcome.result is not None
    assert len(outcome.result.views) == capture.LEAST_VIEWS - 1
