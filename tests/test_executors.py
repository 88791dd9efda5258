"""Any executor gives the same observations: this process, a pool, a Dask cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.detection import detect
from calibrant.errors import InputError
from calibrant.executors import executor_for

TARGET = "circles:5x4:20mm"


@pytest.fixture
def images(tmp_path: Path) -> Path:
    """Pictures of a grid of dots."""
    for i in range(4):
        image = np.full((240, 320), 220, np.uint8)
        for row in range(4):
            for column in range(5):
                cv2.circle(image, (60 + 10 * i + 40 * column, 50 + 40 * row), 10, 30, -1, cv2.LINE_AA)
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
    return tmp_path


def assert_same_as_here(images: Path, workers: object) -> None:
    """Detection elsewhere gives what this process gives."""
    here, there = detect(images, target=TARGET, workers=1), detect(images, target=TARGET, workers=workers)
    assert [v.id for v in there.views] == [v.id for v in here.views] == ["0.png", "1.png", "2.png", "3.png"]
    for a, b in zip(here.views, there.views, strict=True):
        np.testing.assert_array_equal(a.uv, b.uv)


def test_threads(images: Path) -> None:
    with ThreadPoolExecutor(2) as executor:
        assert_same_as_here(images, executor)


def test_processes(images: Path) -> None:
    assert_same_as_here(images, 2)


@pytest.mark.long
@pytest.mark.parametrize("guarded", [False, True], ids=["plain", "guarded"])
def test_a_script_with_or_without_the_line_that_guards_it(images: Path, tmp_path: Path, guarded: bool) -> None:
    """A script that stands in no function asks for processes; they do not run what it did before."""
    work = f"print(len(detect({str(images)!r}, target={TARGET!r}, workers=2).views))"
    lines = ["from calibrant.detection import detect", "print('once')"]
    lines = [lines[0], "if __name__ == '__main__':", f"    {lines[1]}", f"    {work}"] if guarded else [*lines, work]
    script = tmp_path / "mine.py"
    script.write_text("\n".join(lines) + "\n")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.split()) == (0, ["once", "4"]), done.stderr


def test_dask(images: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'calibrant[fleet]'")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        assert_same_as_here(images, cluster.scheduler_address)


@pytest.mark.parametrize("workers", [0, -1, "0", "many", "http://host"])
def test_workers_that_are_none(workers: object) -> None:
    with pytest.raises(InputError, match="workers"), executor_for(workers, 10):  # type: ignore[arg-type]
        pass


def test_few_images_need_no_pool() -> None:
    with executor_for(None, 3) as executor:
        assert executor is None
    with executor_for("4", 1) as executor:
        assert executor is None


ENDLESS = """
import signal, sys, time
from calibrant.executors import executor_for
if __name__ == "__main__":
    # A shell's background job begins with Ctrl-C ignored, which its children inherit.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with executor_for(2, 9) as pool:
        print(*(pool.submit(sys.modules["os"].getpid).result() for _ in range(1)), *pool._processes, flush=True)
        for _ in range(2):
            pool.submit(time.sleep, 600)
        time.sleep(600)
"""


def test_every_process_starts_before_the_first_is_at_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is started later hears Ctrl-C while it starts; on a busy machine the first answers before that."""
    submit = ProcessPoolExecutor.submit

    def answered(pool: ProcessPoolExecutor, *args: object, **kwargs: object) -> object:
        future = submit(pool, *args, **kwargs)  # type: ignore[arg-type]
        future.result()
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", answered)
    with executor_for(2, 9) as pool:
        assert len(pool._processes) == 2  # type: ignore[union-attr]


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="a system without signals")
@pytest.mark.parametrize("signal_sent", ["SIGKILL", "SIGINT"])
def test_workers_end_with_their_parent(tmp_path: Path, signal_sent: str) -> None:
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS)
    # A group of its own: Ctrl-C in a terminal reaches parent and workers alike.
    parent = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert parent.stdout is not None
    workers = [int(word) for word in parent.stdout.readline().split()]
    assert len(set(workers)) == 2
    if signal_sent == "SIGKILL":
        os.kill(parent.pid, signal.SIGKILL)
    else:
        os.killpg(parent.pid, signal.SIGINT)
    _, said = parent.communicate(timeout=20)
    deadline = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [pid for pid in workers if Path(f"/proc/{pid}").exists()] == []
    assert said.count("Traceback") <= 1, said  # the parent's own, whose script catches nothing
