"""Errors of calibrant: one root, few children, each with the exit status the command line gives it.

A message says what failed, what was found, what was expected and what to do next.
"""

from __future__ import annotations


class CalibrantError(Exception):
    """Root of every error that calibrant raises on purpose."""

    exit_status = 1


class InputError(CalibrantError):
    """The input or the arguments cannot be used: a missing file, a wrong shape, an unknown name."""

    exit_status = 2


class RefusedError(CalibrantError):
    """The data are readable but cannot determine the result, or contradict it: the calibration is refused.

    `result` is the calibration that failed its checks, where it got that far; it is for diagnosis, not for use.
    """

    result: object | None = None


class DetectionError(InputError):
    """A target was not found where one was promised."""


class MissingExtraError(CalibrantError):
    """An optional dependency is needed; the message names the extra to install."""

    exit_status = 2


class CancelledError(CalibrantError):
    """The work was asked to stop, and stopped; nothing was written. See `calibrant.cancel`."""

    exit_status = 130
