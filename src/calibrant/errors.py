"""Errors of calibrant: one root, few children, each with the exit status the command line gives it.

A message says what failed, what was found, what was expected and what to do next.
"""

from __future__ import annotations

from collections.abc import Iterable


class CalibrantError(Exception):
    """Root of every error that calibrant raises on purpose.

    >>> import calibrant as cb
    >>> try:
    ...     cb.parse_target("chess:9x6:25mm")
    ... except cb.CalibrantError as error:
    ...     error.exit_status
    2
    """

    exit_status = 1


class InputError(CalibrantError):
    """The input or the arguments cannot be used: a missing file, a wrong shape, an unknown name.

    >>> import calibrant as cb
    >>> try:
    ...     cb.parse_target("chessboard:9x6:25")
    ... except cb.InputError as error:
    ...     "no unit" in str(error)
    True
    """

    exit_status = 2


class RefusedError(CalibrantError):
    """The data are readable but cannot determine the result, or contradict it: the calibration is refused.

    `result` is the calibration that failed its checks, where it got that far, or what the doctor found in the data; it
    is for diagnosis, not for use.

        >>> import calibrant as cb
        >>> try:
        ...     result = cb.hand_eye(images="photos", poses="poses.csv", target="chessboard:9x6:25mm")  # doctest: +SKIP
        ... except cb.RefusedError as refusal:
        ...     print(refusal)  # what the data contradict or do not determine, and what to do
    """

    result: object | None = None


class DetectionError(InputError):
    """A target was not found where one was promised."""


class MissingExtraError(CalibrantError):
    """An optional dependency is needed; the message names the extra to install."""

    exit_status = 2


class DeviceError(CalibrantError):
    """A robot or a camera does not answer, stopped by itself, or gives what it should not."""


class CancelledError(CalibrantError):
    """The work was asked to stop, and stopped; no result was written. See `calibrant.cancel`."""

    exit_status = 130


def causes(said: Iterable[str]) -> str:
    """Several causes in one message: a line each, the one to act on first; each once."""
    return "\n".join(dict.fromkeys(said))
