"""Pictures in the wrong order: one list some places off, from some pair on, as text, backwards, two exchanged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibrant.arrays import Index
from calibrant.calibrate.cell.moments.pairs import LEAST, agreed_place, apart
from calibrant.data import Observations, View
from calibrant.diagnose.doctor.evidence.significance import CONVINCING
from calibrant.diagnose.doctor.faults.pairing import FARTHEST_SHIFT, LEAST_RUN, firsts
from calibrant.diagnose.doctor.pairs.case import PairCase
from calibrant.diagnose.doctor.pairs.finding import PairFinding, judged, listed, sure
from calibrant.formats.poses.natural_order import natural_key


@dataclass(frozen=True, eq=False)
class Order:
    """Left view a[k] belongs to right view b[k]; the others have no partner."""

    name: str
    words: str
    a: Index
    b: Index


def orders(case: PairCase) -> Iterator[Order]:
    """The orders that occur, with what they are."""
    n, right = len(case), case.right
    every = np.arange(n)
    for shift in [s for k in range(1, FARTHEST_SHIFT + 1) for s in (k, -k)]:
        a = np.arange(max(0, -shift), n - max(0, shift))
        yield Order("pairs-shifted", f"{right}'s pictures come {_places(shift)}", a, a + shift)
    for first in firsts(n):
        for shift in (1, -1):
            a = np.array([k for k in range(n) if k < first or (k + shift < n and k + shift >= first)])
            b = np.where(a < first, a, a + shift)
            words = f"from {case.names(first)[1]} on {right}'s pictures come {_places(shift)}"
            yield Order("pairs-shifted", words, a, b)
    names = [case.names(k)[1] for k in range(n)]
    text, natural = sorted(range(n), key=lambda k: names[k]), sorted(range(n), key=lambda k: natural_key(names[k]))
    if text != natural:
        forward = np.empty(n, dtype=np.intp)
        forward[text] = natural
        yield Order("pairs-sorted-as-text", "one list is sorted as text (0, 1, 10, 11, 2 …)", every, forward)
    yield Order("pairs-backwards", f"{right}'s pictures are listed backwards", every, every[::-1])


def _places(shift: int) -> str:
    places = "one place" if abs(shift) == 1 else f"{abs(shift)} places"
    return f"{places} too {'late' if shift > 0 else 'early'}"


def examine(case: PairCase) -> PairFinding | None:
    """Is there an order in which far more of the pairs agree?"""
    if len(case) < LEAST_RUN or not case.wrong.any():
        return None
    fits, best = int((~case.wrong).sum()), None
    every = list(orders(case))
    for order in every:
        tried = case.found.take(order.a, order.b)
        if len(tried) < LEAST:
            continue
        place = agreed_place(tried)
        wrong = apart(tried, place)
        good = int((~wrong).sum())
        if good > max(fits + 1, len(tried) / 2, 0 if best is None else best[1].fits):
            changed = (order.a != order.b) & ~wrong
            if changed.any():
                best = order, judged(case, tried, place, wrong, changed, 4 * len(every))
    if best is None or best[1].p > CONVINCING:
        return None
    order, found = best
    example = next((f"{case.names(i)[0]} goes with {case.names(j)[1]}" for i, j in zip(order.a, order.b) if i != j), "")
    message = (
        f"{order.words}: {example}. Paired so, {found.fits} of {len(found.found)} pairs agree on where {case.right} "
        f"stands instead of {fits} of {len(case)}, to {found.loop.text} instead of {case.loop.text}"
    )
    return PairFinding(
        order.name,
        "fail",
        message,
        sure(found.p),
        case.loop,
        found.loop,
        proposal="pair them so: --apply does, or leave out what has no partner and name both of a pair alike",
        repair=partial(paired_again, case=case, a=order.a, b=order.b),
    )


def exchanged_partners(case: PairCase) -> PairFinding | None:
    """Pictures of one side in each other's place: among the pairs that do not agree, right views that fit others."""
    wrong = np.flatnonzero(case.wrong)
    if len(wrong) < 2 or len(wrong) > len(case) / 2:
        return None
    a, b = (m.ravel() for m in np.meshgrid(wrong, wrong, indexing="ij"))
    fits = ~apart_at(case, a, b)
    partner = {int(i): int(j) for i, j, ok in zip(a, b, fits) if ok and i != j}
    if not partner or len(set(partner.values())) < len(partner):
        return None
    order = np.arange(len(case))
    free = [k for k in wrong.tolist() if k not in partner]
    left = [j for j in wrong.tolist() if j not in partner.values()]
    order[list(partner)] = list(partner.values())
    order[free] = left
    tried = case.found.take(np.arange(len(case)), order)
    changed = np.zeros(len(case), dtype=bool)
    changed[list(partner)] = True
    found = judged(case, tried, case.place, apart(tried, case.place), changed, len(a))
    if found.p > CONVINCING:
        return None
    words = [f"{case.names(i)[0]} goes with {case.names(j)[1]}" for i, j in partner.items()]
    message = f"pictures stand in each other's place: {listed(words)}. Paired so they agree with the other pairs, "
    message += f"to {found.loop.text} instead of {case.loop.text}"
    ids = tuple(case.names(k)[1] for k in partner)
    cure = "pair them so: --apply does, or exchange their names"
    repair = partial(paired_again, case=case, a=np.arange(len(case)), b=order)
    return PairFinding(
        "pairs-exchanged", "warn", message, sure(found.p), case.loop, found.loop, ids, proposal=cure, repair=repair
    )


def apart_at(case: PairCase, a: Index, b: Index) -> np.ndarray:
    """Whether left views a with right views b (k,) contradict the place that most pairs agree on."""
    n = len(case)
    good = np.flatnonzero(~case.wrong)
    both = case.found.take(np.concatenate([good, a]), np.concatenate([good, b]))
    return np.asarray(apart(both, case.place)[len(good) :]) if len(good) else np.ones(min(n, len(a)), dtype=bool)


def paired_again(observations: Observations, *, case: PairCase, a: Index, b: Index) -> Observations:
    """The views with right views b as of the moments of left views a; right views without a partner stand alone."""
    moment = {case.seen[1][j].id: case.seen[0][i].moment for i, j in zip(a.tolist(), b.tolist())}
    taken = {*moment.values(), *(v.moment for v in case.seen[1])}

    def again(v: View) -> View:
        if v.camera != case.right:
            return v
        if v.id in moment:
            return replace(v, moment=moment[v.id])
        return replace(v, moment=f"{v.moment} {case.right} alone") if v.moment in taken else v

    return replace(observations, views=tuple(again(v) for v in observations.views))
