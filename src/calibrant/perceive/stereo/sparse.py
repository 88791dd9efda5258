"""Features that two rectified pictures have in common: which distances there are, whether rows and sides are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.opencv import cv2

_MOST = 4000
_RATIO = 0.8
"""The best match of a feature against its second best (Lowe 2004): above, both may be chance."""
NEAR_ROW = 3.0
"""Pixels off the row from which a match is wrong, or a calibration."""
ENOUGH = 20
"""Matches on common rows that chance does not give: of 4000 features in 480 rows, wrong ones meet their row in 1 %."""


@dataclass(frozen=True, eq=False)
class Sparse:
    """Matches: left, right (n, 2) px in the rectified pictures, and which of them share a row."""

    left: Array
    right: Array

    @property
    def on_rows(self) -> Mask:
        """Matches (n,) that share a row to `NEAR_ROW`."""
        return np.asarray(np.abs(self.row_errors) <= NEAR_ROW)

    @property
    def row_errors(self) -> Array:
        """v_left - v_right (n,), px."""
        return np.asarray(self.left[:, 1] - self.right[:, 1])

    @property
    def disparities(self) -> Array:
        """u_left - u_right of the matches that share a row, px."""
        return np.asarray((self.left[:, 0] - self.right[:, 0])[self.on_rows])

    @property
    def enough(self) -> bool:
        """Whether they tell of distances."""
        return int(self.on_rows.sum()) >= ENOUGH and float(self.on_rows.mean()) > 0.5


def sparse_matches(left: Array, right: Array, *, valid: tuple[Mask, Mask]) -> Sparse:
    """Features of both pictures (h, w), grey values 0 to 255, that are each other's best match."""
    engine = cv2.SIFT.create(nfeatures=_MOST)
    sides = []
    for image, mask in zip((left, right), valid):
        grey = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        points, what = engine.detectAndCompute(grey, mask.astype(np.uint8))
        sides.append((np.array([k.pt for k in points], dtype=np.float64).reshape(-1, 2), what))
    (a, da), (b, db) = sides
    if da is None or db is None or len(a) < 2 or len(b) < 2:
        return Sparse(np.zeros((0, 2)), np.zeros((0, 2)))
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(da, db, k=2)
    back = {m.queryIdx: m.trainIdx for m in cv2.BFMatcher(cv2.NORM_L2).match(db, da)}
    good = [m for m, n in pairs if m.distance < _RATIO * n.distance and back.get(m.trainIdx) == m.queryIdx]
    i, j = ([getattr(m, name) for m in good] for name in ("queryIdx", "trainIdx"))
    return Sparse(a[i], b[j])
