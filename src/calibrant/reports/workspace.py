"""The workspace in the report: how uncertain a seen point is, place by place, and what that uncertainty is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.data import CalibrationResult
from calibrant.diagnose.budget.workspace import PlaceUncertainty, WorkspaceUncertainty
from calibrant.diagnose.look import Look
from calibrant.reports.parts.numbers import plain

_OTHER = 1.05
"""Two figures of two digits are told apart from here on."""
_LAYERS = 3
"""Heights that are drawn: bottom, middle and top of the volume."""


@dataclass(frozen=True)
class Tile:
    """One place of the map: its corner and size in drawing units, its figures, its darkness 0 … 1."""

    x: float
    y: float
    width: float
    height: float
    text: str
    darkness: float
    visible: bool


@dataclass(frozen=True)
class Layer:
    """The places at one height: seen from above, base x to the right and base y upwards; the ends of both axes, mm."""

    title: str
    tiles: tuple[Tile, ...]
    width: float
    height: float
    x_ends: tuple[str, str]
    y_ends: tuple[str, str]


@dataclass(frozen=True)
class Share:
    """A source's part of the variance at the worst place: its name, its percentage, its own 1 sigma."""

    name: str
    percent: str
    width: float
    sigma: str


def workspace_blocks(look: Look) -> list[dict[str, object]]:
    """What the page shows of the workspace that the result was asked about: a block a camera, or none."""
    result, found = look.result, look.workspaces
    return [_block(result, name if len(found) > 1 else "", one) for name, one in found.items()]


def _block(result: CalibrationResult, camera_name: str, found: WorkspaceUncertainty) -> dict[str, object]:
    low, high = float(found.sigma_mm.min()), float(found.sigma_mm.max())
    return {
        "name": camera_name,
        "base": found.base,
        "rows": [_row("worst place", found.worst), _row("middle of the volume", found.centre)],
        "mean": plain(found.mean_mm, digits=2),
        "camera": f"{plain(found.camera_mm, digits=2)} mm and {plain(found.camera_deg, digits=2)} deg "
        f"in the {found.camera_parent} frame",
        "size_given_mm": plain(found.camera_sized_mm, digits=2)
        if found.camera_mm > _OTHER * found.camera_sized_mm
        else "",
        "layers": [_layer(found, k, low, high) for k in _heights(found)],
        "low": plain(low, digits=2),
        "high": plain(high, digits=2),
        "darkest": plain(low + _span(low, high), digits=2),
        "unseen": not bool(found.visible.all()),
        "shares": _shares(found.worst),
        "notes": found.notes,
        "tolerance": result.options.get("tolerance"),
        "target_sigma": f"{plain(100 * found.target_sigma, digits=2)} %",
    }


def _row(name: str, place: PlaceUncertainty) -> dict[str, str]:
    where = ", ".join(f"{1e3 * c:.0f}" for c in place.point)
    return {
        "name": name,
        "where": where,
        "sigma": plain(place.sigma_mm, digits=2),
        "radius": plain(place.radius_mm, digits=2),
    }


def _heights(found: WorkspaceUncertainty) -> list[int]:
    layers = found.points.shape[2]
    return sorted({round(float(k)) for k in np.linspace(0, layers - 1, min(_LAYERS, layers))})


def _layer(found: WorkspaceUncertainty, k: int, low: float, high: float) -> Layer:
    points, sigma, seen = found.points[:, :, k], found.sigma_mm[:, :, k], found.visible[:, :, k]
    nx, ny = sigma.shape
    # Tiles in proportion to the volume; an axis without extent still gets a tile that can be seen.
    dx, dy = _step(points[:, 0, 0]), _step(points[0, :, 1])
    unit = max(nx * dx, ny * dy)
    w, h = 100 * dx / unit, 100 * dy / unit
    span = _span(low, high)
    tiles = tuple(
        Tile(
            i * w,
            (ny - 1 - j) * h,
            w,
            h,
            f"{_place(points[i, j])}: {plain(float(sigma[i, j]), digits=3)} mm",
            float((sigma[i, j] - low) / span),
            bool(seen[i, j]),
        )
        for i in range(nx)
        for j in range(ny)
    )
    x_ends, y_ends = _ends(points[:, 0, 0]), _ends(points[0, :, 1])
    return Layer(f"z = {1e3 * points[0, 0, 2]:.0f} mm", tiles, nx * w, ny * h, x_ends, y_ends)


def _ends(axis: np.ndarray) -> tuple[str, str]:
    return f"{1e3 * axis[0]:.0f}", f"{1e3 * axis[-1]:.0f}"


def _span(low: float, high: float) -> float:
    """From the lightest tile to the darkest, mm: differences of a few per cent are not to look like those between good
    and bad."""
    return max(high - low, 0.5 * high, 1e-12)


def _step(axis: np.ndarray) -> float:
    return float(axis[1] - axis[0]) if len(axis) > 1 else 0.02


def _place(point: np.ndarray) -> str:
    return ", ".join(f"{name} {1e3 * c:.0f}" for name, c in zip("xyz", point)) + " mm"


def _shares(place: PlaceUncertainty) -> list[Share]:
    # The shares are of the variance over all directions: a source's own sigma is the root of its part.
    ordered = sorted(place.shares.items(), key=lambda item: -item[1])
    return [
        Share(name, plain(100 * share, digits=2), 100 * share, plain(place.sigma_mm * share**0.5, digits=2))
        for name, share in ordered
    ]
