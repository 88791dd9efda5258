"""When the messages of a series were taken, by their headers or by when they were received; clocks that jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.errors import InputError

HEADER, RECEIVED = "header", "received"
STAMPS = (HEADER, RECEIVED)
JUMP_S = 0.2
"""A clock that is set while it runs jumps by this or more; delays of the recording come and go."""
_AROUND = 10
"""Messages to either side whose delays are compared: one that was held up for a while is among them."""
_TIMES_USUAL = 10.0
"""A jump is so many times what delays change by from message to message."""


def seconds_of(
    stamps_ns: Sequence[int | None], received_ns: Sequence[int], *, what: str, stamps: str = HEADER
) -> Array:
    """Times (n,) in seconds since 1970 as the recording has them. what: the series, for messages.

    Where no header has a time, or stamps is "received", those of the recording count.
    Raises: InputError where the clock of the headers jumps.
    """
    received = np.array(received_ns, np.int64)
    if stamps == RECEIVED or not any(stamps_ns):
        return np.asarray(received * 1e-9)
    told = np.array([s or 0 for s in stamps_ns], np.int64)
    _refuse_jump(told, received, what)
    return np.asarray(told * 1e-9)


def _refuse_jump(stamps: Indices, received: Indices, what: str) -> None:
    """Raises: InputError where the headers' clock, seen by the recording's, is set forward or back for good."""
    order = np.argsort(received, kind="stable")
    delay = (received - stamps)[order] * 1e-9
    steps = np.abs(np.diff(delay))
    usual = float(np.median(steps)) if len(steps) else 0.0
    for i in np.flatnonzero(steps > max(JUMP_S, _TIMES_USUAL * usual)):
        before, after = delay[max(0, i + 1 - _AROUND) : i + 1], delay[i + 1 : i + 1 + _AROUND]
        jump = float(np.median(before) - np.median(after))
        if abs(jump) > JUMP_S:
            at = (received[order][i + 1] - received.min()) * 1e-9
            raise InputError(
                f"the clock of {what} jumps {'forward' if jump > 0 else 'back'} by {abs(jump):.3f} s, {at:.1f} s after "
                "the recording began: it was set while it ran. Record again with clocks that run through (chrony, "
                "PTP), cut the bag there, or take the recorder's own times: --stamps received"
            )
