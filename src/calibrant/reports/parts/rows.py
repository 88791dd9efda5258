"""The rows of a result: every image, pose or measurement of the data set, whether it was used, and why not."""

from __future__ import annotations

from dataclasses import dataclass

from calibrant.data import CalibrationResult, ViewResult


@dataclass(frozen=True)
class ViewRow:
    """One image of the data set: whether it was used, its error, and the reason where it was left out or flagged."""

    id: str
    camera: str
    used: bool
    points: int
    points_left_out: int
    rms_px: float | None
    reason: str
    min_px: float | None = None
    max_px: float | None = None

    @property
    def status(self) -> str:
        """ "used", "used, flagged" or "left out"."""
        if not self.used:
            return "left out"
        return "used, flagged" if self.reason else "used"


def view_rows(result: CalibrationResult) -> list[ViewRow]:
    """Every image in order: the views of the result, then the images in which no target was found."""
    rows = [_view_row(view, result.camera_of(view)) for view in result.views]
    known = {(row.camera, row.id) for row in rows}
    for missed in result.observations.missed if result.observations else ():
        if (missed.camera, missed.id) not in known:
            rows.append(ViewRow(missed.id, missed.camera, False, 0, 0, None, missed.reason))
    return rows


def _view_row(view: ViewResult, camera: str) -> ViewRow:
    return ViewRow(
        *(view.id, camera, view.used, view.points, view.points_left_out, view.rms_px, view.reason or ""),
        min_px=view.min_px,
        max_px=view.max_px,
    )
