"""The views of a result for the page: errors, residual vectors, pictures and how they cover the image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibrant.arrays import Indices
from calibrant.data import CalibrationResult, View
from calibrant.diagnose.loop import LoopView, by_view
from calibrant.reports.parts.pictures import data_uris
from calibrant.reports.parts.rows import ViewRow, view_rows

if TYPE_CHECKING:
    from calibrant.diagnose.look import ViewResiduals

_PICTURE_BUDGET = 3_000_000
"""Bytes of all pictures; with points and poses the file stays under 5 MB."""
_MOST_POINTS = 40_000
"""Residual vectors in the page, some 25 bytes each; beyond it, the vectors of every k-th view are left out."""


@dataclass(frozen=True, eq=False)
class PageViews:
    """Views for the page in order, their pictures (data URIs) by view key, and what is missing, in a sentence.

    Each view has id, key, camera, used, status, reason, points, rms, mm, deg (None where unknown), size (width,
    height), uv and r (flat lists, pixels; empty where there is no pose) of its points, out: uv of those left out.
    """

    views: list[dict[str, Any]]
    pictures: dict[str, str]
    remark: str


def page_views(
    result: CalibrationResult,
    residuals: Sequence[ViewResiduals],
    loop: Sequence[LoopView],
    *,
    images: Mapping[str, Path],
) -> PageViews:
    """The views with their errors, residual vectors and pictures.

    Args: images, files by view id, in place of those the observations name.
    """
    observed = {(v.camera, v.id): v for v in (result.observations.views if result.observations else ())}
    vectors = {(r.camera, r.id): r for r in _thinned(residuals)}
    steps = by_view(loop)
    pages: list[dict[str, Any]] = []
    files: list[tuple[float, str, Path]] = []
    for row in view_rows(result) or [ViewRow(v.view, v.camera, v.mm is not None, 0, 0, None, "") for v in loop]:
        view, vector = observed.get((row.camera, row.id)), vectors.get((row.camera, row.id))
        page = _page_view(row, view, vector, steps.get((row.camera, row.id)))
        page["size"] = list(result.observations.image_sizes[view.camera]) if result.observations and view else None
        pages.append(page)
        path = images.get(row.id) or (Path(view.file) if view and view.file else None)
        if path is not None and vector is not None:
            # Pictures may run out: those to look at first are of views left out or flagged, then of the worst.
            files.append((-np.inf if row.reason else -(row.rms_px or 0.0), page["key"], path))
    files.sort(key=lambda item: item[0])
    said = result.options.get("mirror_x", False)
    # Of several cameras those are named that deliver mirror images.
    mirrored = {f[1] for f in files if said is True or (said and f[1].partition("/")[0] in said)}
    pictures, remark = data_uris([f[1:] for f in files], budget=_PICTURE_BUDGET, mirrored=mirrored)
    return PageViews(pages, pictures, remark)


def _thinned(residuals: Sequence[ViewResiduals]) -> Sequence[ViewResiduals]:
    total = sum(len(r.uv) for r in residuals)
    return residuals[:: max(1, -(-total // _MOST_POINTS))]


def _page_view(row: ViewRow, view: View | None, vector: ViewResiduals | None, step: LoopView | None) -> dict[str, Any]:
    rms = row.rms_px
    kept, out = _parted(vector, row.points_left_out)
    if rms is None and vector is not None and len(vector.uv):
        rms = vector.rms_px
    return {
        "id": row.id,
        "key": f"{row.camera}/{row.id}",
        "camera": row.camera,
        "used": row.used,
        "status": row.status,
        "reason": row.reason,
        "points": row.points or (len(view) if view is not None else 0),
        "rms": rms,
        "mm": step.mm if step is not None else None,
        "deg": step.deg if step is not None else None,
        "uv": np.round(vector.uv[kept], 1).ravel().tolist() if vector is not None else [],
        "r": np.round(vector.residuals[kept], 3).ravel().tolist() if vector is not None else [],
        "out": np.round(vector.uv[out], 1).ravel().tolist() if vector is not None else [],
    }


def _parted(vector: ViewResiduals | None, left_out: int) -> tuple[Indices, Indices]:
    """Which points of a view were used, and which the calibration left out: those with the largest residuals, as many
    as it says."""
    if vector is None:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    order = np.argsort(np.linalg.norm(vector.residuals, axis=-1), kind="stable")
    cut = max(len(order) - left_out, 0)
    return np.sort(order[:cut]), np.sort(order[cut:])
