"""Shares in messages."""

from __future__ import annotations


def percent(share: float) -> str:
    """Two digits, whole from a tenth on, never a power of ten.

    >>> percent(0.00123), percent(-0.254), percent(1.1)
    ('0.12 %', '25 %', '110 %')
    """
    share = abs(share)
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"
