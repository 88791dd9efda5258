"""A small size of benchmarks/readers/fuzz_readers.py: files of every kind, damaged, are read or refused with words."""

from __future__ import annotations

import sys
import tempfile
from importlib import import_module
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "readers"))
fuzz = import_module("fuzz_readers")


def test_no_damaged_file_ends_in_an_internal_error() -> None:
    found = fuzz.run(160, seed=20)
    assert [f"{fault.kind} --one {fault.number}: {fault.words}" for fault in found.faults] == []
    assert (found.read > 20, found.refused > 60) == (True, True)
    assert found.slowest < fuzz.MOST_SECONDS


def test_the_corpus_is_good() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for kind in fuzz.corpus().values():
            for name, data in kind.files:
                path = Path(folder) / name
                path.write_bytes(data)
                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr("warnings.warn", lambda *args, **kwargs: None)
                    kind.use(path)
