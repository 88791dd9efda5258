"""What comes out for data as users have them: are wrong answers said to be wrong, and are stated sigmas true?

    python benchmarks/what_users_have.py                                   100 seeds of every condition
    python benchmarks/what_users_have.py --only intrinsics --seeds 20      all of a kind, or one: --only zoom-1
    python benchmarks/what_users_have.py --only zoom-1 --seed 17           one run, with what its checks say
    python benchmarks/what_users_have.py --list                            names of the conditions
    python benchmarks/what_users_have.py --only clean --seeds 1000 --json clean.json

The photos and robots are those of benchmarks/users, which shares no equation with the calibrator. A seed gives the same
camera, board and poses in every condition that draws alike. How to read the table: benchmarks/README.md.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from fnmatch import fnmatch
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from users import hand_eye, intrinsics
from users.promises import promises
from users.runs import Figures, Run, figures

HEAD = (
    "| condition | ok / warn / refused / error | silent + hidden | mean, all (median) | mean, ok (median) | 95 % hold "
    "| sigma / least, all; ok | ms | what warned |"
)


@lru_cache
def conditions() -> tuple[Any, ...]:
    return (*intrinsics.conditions(), *(c for c in hand_eye.conditions() if c.possible))


def named(words: list[str] | None) -> list[Any]:
    """Conditions that a word names, or whose names it is a part of where it names none."""
    every = conditions()
    if not words:
        return list(every)
    chosen: list[Any] = []
    for w in words:
        exact = [c for c in every if w in (c.name, c.name.split("/")[1])]
        chosen += exact or [c for c in every if w in c.name or fnmatch(c.name, w)]
    return [c for c in every if c in chosen]


def run(condition: Any, seed: int) -> Run:
    return (hand_eye if isinstance(condition, hand_eye.Condition) else intrinsics).run(condition, seed)


def row(f: Figures) -> str:
    v = f.verdicts
    warned = ", ".join(f"{name} {n}" for name, n in list(f.warned.items())[:5])
    return (
        f"| {f.name} | {v['ok']} / {v['warn']} / {v['refused']} / {v['error']} | {f.silent} + {f.hidden} "
        f"| {f.mean:.3g} ({f.median:.2g}) | {f.mean_ok:.3g} ({f.median_ok:.2g}) | {100 * f.covered:.0f} % "
        f"| {f.growth:.2f}; {f.growth_ok:.2f} | {f.ms:.0f} | {warned} |"
    )


def tell(condition: Any, seed: int) -> None:
    """One run in words."""
    r = run(condition, seed)
    scores = ", ".join(f"{s:.1f}" for s in r.scores)
    print(f"{condition.name} ({condition.words}), seed {seed}: {r.verdict}{', SILENT' if r.silent else ''}")
    print(
        f"  e^T C^-1 e {r.error:.3g} of {r.dof}; errors in sigma {scores}; sigma / least {r.growth:.2f}; {r.ms:.0f} ms"
    )
    for words in r.words:
        print(f"  {words}")


def run_named(job: tuple[str, int]) -> Run:
    """For workers: conditions hold functions, which do not travel."""
    name, seed = job
    return run(named([name])[0], seed)


def tables(chosen: list[Any], seeds: range, workers: int) -> Iterator[Figures]:
    print(HEAD + "\n" + "|---" * (HEAD.count("|") - 1) + "|")
    with ExitStack() as stack:
        pool = stack.enter_context(ProcessPoolExecutor(workers, get_context("spawn"))) if workers > 1 else None
        for condition in chosen:
            jobs = [(condition.name, seed) for seed in seeds]
            runs = map(run_named, jobs) if pool is None else pool.map(run_named, jobs, chunksize=5)
            f = figures(condition.name, list(runs))
            print(row(f), flush=True)
            yield f


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="*", help="names of conditions, or parts of names")
    parser.add_argument("--seeds", type=int, default=100, help="runs of each condition")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--workers", type=int, default=1, help="processes that share the seeds")
    parser.add_argument("--seed", type=int, help="this seed alone, in words")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--list", action="store_true", help="names of the conditions")
    options = parser.parse_args()
    chosen = named(options.only)
    if not chosen:
        sys.exit(f"no condition is called {' '.join(options.only)}; --list names them")
    if options.list:
        print("\n".join(f"{c.name:32} {c.words}" for c in chosen))
    elif options.seed is not None:
        for condition in chosen:
            tell(condition, options.seed)
    else:
        run(chosen[0], 0)  # compiled, before any time is taken
        found = list(tables(chosen, range(options.first, options.first + options.seeds), options.workers))
        print()
        for f in found:
            if f.silent:
                print(f"silent: {f.name}, seeds {' '.join(map(str, f.silent_seeds[:20]))}")
        kinds = {k: frozenset(c.name for c in chosen if getattr(c, k, False)) for k in ("known", "clean", "told")}
        for words, kept, why in promises(found, kinds):
            print(f"{'PASS' if kept else 'NO  '} {words}{f': {why}' if why else ''}")
        if options.json:
            options.json.write_text(json.dumps([asdict(f) for f in found], indent=1, default=float), encoding="utf-8")


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
