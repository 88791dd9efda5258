"""Other implementations to agree with, each asked in an environment of its own: two wheels of OpenCV do not mix."""

from __future__ import annotations

import io
import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Peer:
    """A Python that has another implementation: its module or attribute, and how to come by it."""

    python: Path
    imports: str
    cure: str

    def ask(self, script: str, given: bytes) -> bytes:
        """What a script prints in that Python when it reads `given`; the test is skipped where it cannot be asked."""
        reason = _missing(self)
        if reason is not None:
            pytest.skip(reason)
        run = subprocess.run([self.python, "-c", script], input=given, capture_output=True, check=False)
        assert run.returncode == 0, run.stderr.decode()
        return run.stdout

    def arrays(self, script: str, **given: np.ndarray) -> dict[str, np.ndarray]:
        """`answer(**given)` of a script that defines it, arrays in and a dictionary of arrays out."""
        content = io.BytesIO()
        np.savez(content, **given)  # type: ignore[arg-type]
        frame = "import io, sys, numpy as np\nout = io.BytesIO()\n"
        call = "np.savez(out, **answer(**np.load(io.BytesIO(sys.stdin.buffer.read()))))\n"
        answer = self.ask(frame + script + call + "sys.stdout.buffer.write(out.getvalue())\n", content.getvalue())
        with np.load(io.BytesIO(answer)) as arrays:
            return dict(arrays)


@cache
def _missing(peer: Peer) -> str | None:
    """Why a peer cannot be asked; None when it can."""
    if not peer.python.exists():
        return f"{peer.python} is not there: {peer.cure}"
    run = subprocess.run([peer.python, "-c", peer.imports], capture_output=True, text=True, check=False)
    return None if run.returncode == 0 else f"{peer.python} cannot `{peer.imports}`: {peer.cure}"


MRCAL = Peer(Path("/usr/bin/python3"), "import mrcal", "Debian's python3-mrcal lives with the system's Python")
OPENCV_CONTRIB = Peer(
    ROOT / ".nox" / "opencv_contrib" / "bin" / "python",
    "from cv2 import omnidir",
    "`nox -s opencv_contrib` makes it",
)
"""OpenCV with its contrib modules, whose wheel would overwrite the plain one that calibrant requires."""
