"""What a result says in words: its title, and the verdict in one line with its reason."""

from __future__ import annotations

from calibrant.data import CalibrationResult, Check
from calibrant.reports.kinds.registry import kind_of
from calibrant.reports.parts.phrases import focal_known
from calibrant.reports.parts.rows import view_rows

STATUS_WORDS = {"ok": "ok", "warn": "warning", "fail": "FAILED"}
VERDICT_WORDS = {"ok": "GOOD", "warn": "USE WITH CARE", "refused": "DO NOT USE"}
FEW = 4
"""Checks that passed and are still read; more are folded."""
_SEVERITY = {"fail": 0, "warn": 1, "ok": 2}
_CAUSES = ("board-", "lens-model", "one-camera", "shutter", "image-shear", "target-size", "moved")
"""How names of checks begin that say what is wrong. What others see, points left out or a residual with structure, may
come of it."""


def title(result: CalibrationResult) -> str:
    """What kind of result this is."""
    return kind_of(result).title


def verdict_word(result: CalibrationResult) -> str:
    """The verdict in one word, or three."""
    kind = kind_of(result)
    if kind.judged is not None:
        return kind.judged(result)[0]
    return kind.verdicts.get(result.verdict, VERDICT_WORDS[result.verdict])


def sorted_checks(result: CalibrationResult) -> list[Check]:
    """The checks, the worst first; of equally bad ones those that name a cause before what may come of it."""
    return sorted(result.checks, key=lambda check: (_SEVERITY[check.status], not check.name.startswith(_CAUSES)))


def verdict_sentence(result: CalibrationResult) -> str:
    """The verdict in one sentence: what to do with the result and the reason that matters most."""
    kind = kind_of(result)
    if kind.judged is not None:
        return kind.judged(result)[1]
    failed = [c for c in result.checks if c.status == "fail"]
    warned = [c for c in sorted_checks(result) if c.status == "warn"]
    if result.verdict == "refused":
        reason = failed[0].message if failed else "the data cannot determine the result."
        return f"{_sentence(reason)}{_more(len(failed) - 1, 'failed check')}"
    if result.verdict == "warn":
        reason = f" {_sentence(warned[0].message)}" if warned else ""
        return f"{accuracy(result)}{reason}{_more(len(warned) - 1, 'warning')}"
    return f"{accuracy(result)} {_passed(result)}".strip()


_NAMES = ("fx", "fy", "cx", "cy")
"""Words that are names of a camera's parameters."""


def accuracy(result: CalibrationResult) -> str:
    """How well what was asked for is known, in one sentence."""
    return kind_of(result).answer(result) or focal_known(result) or "Done."


def _passed(result: CalibrationResult) -> str:
    rows, used = view_rows(result), sum(row.used for row in view_rows(result))
    views = f"{used} of {len(rows)} {kind_of(result).rows} used" if rows else ""
    checks = "every check passed" if result.checks else ""
    text = ", ".join(part for part in (views, checks) if part)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _sentence(text: str) -> str:
    """The text as a sentence: a capital first, but for names (a photo's, a parameter's), which stay as they are."""
    text = text.strip()
    first = text.split(maxsplit=1)[0] if text else ""
    if first.strip(",;").isalpha() and first not in _NAMES:
        text = f"{text[:1].upper()}{text[1:]}"
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _more(count: int, noun: str) -> str:
    return f" (And {count} more {noun}{'s' if count > 1 else ''}: see the checks.)" if count > 0 else ""
