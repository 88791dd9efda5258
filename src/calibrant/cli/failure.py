"""What went wrong, for programs: the answer of --json where there is no result."""

from __future__ import annotations

import json
from typing import Any

from calibrant.cli.command import UsageError
from calibrant.errors import CancelledError, InputError, MissingExtraError, RefusedError

_KINDS: tuple[tuple[type[BaseException], str], ...] = (
    (UsageError, "usage"),
    (MissingExtraError, "missing-extra"),
    (InputError, "input"),
    (RefusedError, "refused"),
    (CancelledError, "interrupted"),
    (KeyboardInterrupt, "interrupted"),
)


def failure_json(error: BaseException, status: int, message: str) -> str:
    """{"error": {"kind", "message", "exit_status"}}, one document; of a refused calibration also its checks that did
    not pass.

    kind: usage, input, missing-extra, refused, interrupted, or internal for a defect of calibrant.
    """
    said: dict[str, Any] = {"kind": _kind(error, status), "message": message, "exit_status": status}
    checks = getattr(getattr(error, "result", None), "checks", ())
    doubts = [{"name": c.name, "status": c.status, "message": c.message} for c in checks if c.status != "ok"]
    if doubts:
        said["checks"] = doubts
    return json.dumps({"error": said}, ensure_ascii=False, indent=2) + "\n"


def _kind(error: BaseException, status: int) -> str:
    """What a program tells errors apart by."""
    known = next((name for kind, name in _KINDS if isinstance(error, kind)), None)
    if known is not None:
        return known
    # Standard output that cannot be written: nothing of ours is broken.
    return "input" if status == 2 else "internal"
