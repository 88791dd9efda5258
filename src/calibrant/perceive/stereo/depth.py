"""Depth of every pixel that two cameras match, with its uncertainty by the matches and by the calibration.

The left pixel is exact, by definition; its match is found along the row. So the point X, left camera's frame, obeys

    project(theta_l, X) = u_l,    u(R_r T_left_right^-1 X) = u_r,

u the coordinate along the rectified rows, and to first order, with D = du/dq at q = T_left_right^-1 X, G = du/du_own,

    [J_l; D R^T] dX = [-J_theta_l dtheta_l; -dd - G J_theta_r dtheta_r - D (R^T hat(X - t) domega - R^T dt)]

dd the error of the disparity. The second source is shared by all pixels of a picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.data.cloud import Cloud
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import so3
from calibrant.perceive.colour_scale import ColourScale
from calibrant.perceive.stereo.disparity import Disparity, Matcher, disparity, semi_global
from calibrant.perceive.stereo.drawing import joined
from calibrant.perceive.stereo.rectification import Rectification
from calibrant.perceive.stereo.sparse import ENOUGH, NEAR_ROW, Sparse, sparse_matches
from calibrant.perceive.undistort import Maps

AT_ONCE = 20_000
"""Pixels whose Jacobians by all of the calibration are held at once: some hundred megabytes."""
_STEP = 1e-6
WIDE = 0.25
"""Part of the picture's width that is searched where nothing tells the distances."""
OUTSIDE = 0.02
"""Part of the depths at each end whose colours are those of the ends."""
LEAST_CONFIDENCE = 0.25
"""Both directions apart by a pixel and grey values four times as noisy as usual are each as far as matches go."""


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth of the left rectified picture's pixels (h, w); NaN where it is not known.

    points (h, w, 3): metres, left camera's own frame; by_matches, by_calibration (h, w): 1 sigma of their z, metres;
    disparity: in the rectified pictures; sparse: the features that told the range and the rows.
    """

    pair: Rectification
    points: Array
    by_matches: Array
    by_calibration: Array
    disparity: Disparity
    sparse: Sparse

    @property
    def known(self) -> Mask:
        """Where there is a point (h, w)."""
        return np.asarray(np.isfinite(self.points[..., 2]))

    @property
    def sigma_z(self) -> Array:
        """1 sigma of z (h, w), metres, by both sources."""
        return np.hypot(self.by_matches, self.by_calibration)

    def cloud(self, left: NDArray[Any]) -> Cloud:
        """The points with the left picture's colours, `sigma_z`, its two sources, and `confidence`.

        left: the picture as the camera took it. Raises: RefusedError where nothing is known.
        """
        known = self.known
        if not known.any():
            raise RefusedError(
                "the cloud is empty: no pixel was matched in both directions. Do the pictures show the same scene at "
                "one moment, is there texture, and are the distances within --near and --far?"
            )
        image = self.pair.maps[0].apply(left)
        colours = image[..., 2::-1][known] if image.ndim == 3 else np.repeat(image[known][:, None], 3, axis=1)
        if colours.dtype != np.uint8:
            colours = (colours.astype(np.float64) * (255 / max(float(colours.max()), 1e-12))).astype(np.uint8)
        values = {
            "sigma_z": self.sigma_z[known],
            "sigma_matches": self.by_matches[known],
            "sigma_calibration": self.by_calibration[known],
            "confidence": self.disparity.confidence[known],
        }
        return Cloud(self.points[known], colours, values, self.pair.eyes.names[0])


def depth_map(
    pair: Rectification,
    images: Sequence[NDArray[Any]],
    *,
    matcher: Matcher | None = None,
    near: float | None = None,
    far: float | None = None,
    least_confidence: float = LEAST_CONFIDENCE,
) -> DepthMap:
    """The depth of a pair of pictures.

    Args: images: left and right as the cameras took them, (h, w) or (h, w, 3), any depth; matcher: by default OpenCV's
    semi-global one; near, far, metres: the distances that are looked for, by default what features of the pictures
    show; least_confidence: what is less sure is left out.
    Raises: InputError for pictures of other sizes than the cameras', near behind far; RefusedError where the sides are
    exchanged.
    """
    if pair.baseline < 0:
        left, right = pair.eyes.names
        raise InputError(
            f"{left} stands on the other side of {right}: take {right} as the left (upper) camera, --cameras "
            f"{right},{left}, with the pictures exchanged"
        )
    greys = [_rectified_grey(maps, image) for maps, image in zip(pair.maps, images, strict=True)]
    valid = [maps.valid for maps in pair.maps]
    if pair.along == 1:  # columns become rows
        greys, valid = [g.T.copy() for g in greys], [v.T.copy() for v in valid]
    shift = _shift(pair)
    sparse = sparse_matches(*greys, valid=(valid[0], valid[1]))
    _refuse_exchanged(pair, sparse, shift)
    low, high = _range(pair, sparse, shift, near, far)
    found = disparity(*greys, matcher=matcher or semi_global(low, high), valid=(valid[0], valid[1]))
    d, sigma, confidence = found.d, found.sigma, found.confidence
    if pair.along == 1:
        d, sigma, confidence = d.T, sigma.T, confidence.T
    with np.errstate(invalid="ignore"):
        d = np.where((d > shift) & (confidence >= least_confidence), d, np.nan)
    whole = _map_of(pair, Disparity(d, np.where(np.isfinite(d), sigma, np.nan), confidence), sparse)
    return whole if near is None and far is None else _between(whole, near or 0.0, np.inf if far is None else far)


def _shift(pair: Rectification) -> float:
    """Disparity of what is infinitely far, px."""
    a, b = pair.views
    return (a.cx - b.cx, a.cy - b.cy)[pair.along]


def _disparity(pair: Rectification, distance: float | None, otherwise: float) -> float:
    """That of a distance, metres, px."""
    return otherwise if distance is None else _shift(pair) + pair.views[0].f * pair.baseline / distance


def _rectified_grey(maps: Maps, image: NDArray[Any]) -> Array:
    """Grey values (h, w), 0 to 255, of a rectified picture, by cubic splines: their errors stay below the noise's."""
    from scipy.ndimage import map_coordinates

    maps.require(image)
    grey = image.astype(np.float64)
    if grey.ndim == 3:
        grey = grey[..., :3] @ [0.114, 0.587, 0.299] if grey.shape[2] >= 3 else grey[..., 0]
    if image.dtype != np.uint8:
        low, high = float(grey.min()), float(grey.max())
        grey = (grey - low) * (255 / max(high - low, 1e-12))
    u, v = (np.where(np.isnan(m), -1.0, m) for m in (maps.map_u, maps.map_v))
    return np.asarray(map_coordinates(grey, [v, u], order=3, mode="mirror"), dtype=np.float64)


def _refuse_exchanged(pair: Rectification, sparse: Sparse, shift: float) -> None:
    """Raises: RefusedError where features share rows, and lie before the cameras, the other way round alone."""
    a, b = pair.eyes.cameras[:2]
    if len(sparse.left) < ENOUGH or a.image_size != b.image_size:
        return
    given = [side if pair.along == 0 else side[:, ::-1] for side in (sparse.left, sparse.right)]
    own = [pair.own_pixels(i, side) for i, side in enumerate(given)]
    exchanged = [pair.pixels(i, own[1 - i]) for i in (0, 1)]
    shares = []
    for left, right in (given, exchanged):
        off = left - right
        with np.errstate(invalid="ignore"):
            shares.append(float(np.mean((np.abs(off[:, 1 - pair.along]) <= NEAR_ROW) & (off[:, pair.along] > shift))))
    if shares[1] > 0.5 and shares[1] > 2 * shares[0]:
        raise RefusedError(
            f"the sides are exchanged: of {len(own[0])} features that both pictures show, {100 * shares[0]:.0f} % "
            f"share a row and lie before the cameras as given, and {100 * shares[1]:.0f} % the other way round; "
            "exchange --left and --right"
        )


def _range(
    pair: Rectification, sparse: Sparse, shift: float, near: float | None, far: float | None
) -> tuple[float, float]:
    """The lowest and the highest disparity looked for, px."""
    if near is not None and far is not None and not 0 < near < far:
        raise InputError(f"near is {near:g} m and far {far:g} m; expected 0 < near < far")
    low, high = shift, shift + WIDE * pair.views[0].image_size[pair.along]
    if sparse.enough:
        # Features miss the nearest and the farthest parts: half as near and half as far again.
        d = np.clip(sparse.disparities - shift, 0, None)
        low, high = shift + np.quantile(d, 0.01) / 1.5, shift + 1.5 * np.quantile(d, 0.99)
    low, high = _disparity(pair, far, float(low)), _disparity(pair, near, float(high))
    return low, max(high, low + 16)


def _map_of(pair: Rectification, found: Disparity, sparse: Sparse) -> DepthMap:
    h, w = found.d.shape
    known = found.known
    rows, columns = np.nonzero(known)
    points = np.full((h, w, 3), np.nan)
    by_matches, by_calibration = np.full((h, w), np.nan), np.full((h, w), np.nan)
    for first in range(0, len(rows), AT_ONCE):
        v, u = rows[first : first + AT_ONCE], columns[first : first + AT_ONCE]
        uv = np.stack([u, v], axis=1).astype(np.float64)
        X, by_d, by_all = depth_points(pair, uv, found.d[v, u])
        points[v, u] = X
        by_matches[v, u] = np.abs(by_d[:, 2]) * found.sigma[v, u]
        J = by_all[:, 2]
        by_calibration[v, u] = np.sqrt(np.maximum(np.sum((J @ pair.eyes.covariance) * J, axis=1), 0.0))
    return DepthMap(pair, points, by_matches, by_calibration, found, sparse)


def _between(found: DepthMap, near: float, far: float) -> DepthMap:
    """Without the points that are nearer or farther: matchers search in steps, and farther than they are asked to."""
    z = found.points[..., 2]
    with np.errstate(invalid="ignore"):
        left_out = np.where((z >= near) & (z <= far), 0.0, np.nan)
    d = found.disparity
    return replace(
        found,
        points=found.points + left_out[..., None],
        by_matches=found.by_matches + left_out,
        by_calibration=found.by_calibration + left_out,
        disparity=Disparity(d.d + left_out, d.sigma + left_out, d.confidence),
    )


def depth_points(pair: Rectification, uv: Array, d: Array) -> tuple[Array, Array, Array]:
    """Points (n, 3), left camera's frame, of left rectified pixels (n, 2) with disparities d (n,), px.

    Returns them, their derivative by d (n, 3), and by what the covariance of the eyes is of (n, 3, p).
    """
    eyes = pair.eyes
    R_left, R_right = pair.R_rectified_camera
    a, b = pair.views
    p = a.rays(uv) * (a.f * pair.baseline / (d - _shift(pair)))[:, None]
    X = p @ R_left
    T = eyes.T_first_camera[1]
    R, t = T[:3, :3], T[:3, 3]
    q = (X - t) @ R
    left, right = eyes.cameras[:2]
    _, J_l, lens_l = left.model.project_with_jacobians(left.values, X)
    _, J_q, lens_r = right.model.project_with_jacobians(right.values, q)
    h = _STEP * np.linalg.norm(q, axis=1)
    D = np.stack(
        [
            (b.project((q + e * h[:, None]) @ R_right.T) - b.project((q - e * h[:, None]) @ R_right.T))[:, pair.along]
            / (2 * h)
            for e in np.eye(3)
        ],
        axis=1,
    )
    B = _across(q)
    G = (D[:, None, :] @ B @ np.linalg.inv(J_q @ B))[:, 0]
    M = np.linalg.inv(np.concatenate([J_l, (D @ R.T)[:, None]], axis=1))
    by_all = np.zeros((len(X), 3, len(eyes.covariance)))
    by_all[:, :, eyes.lens_columns(0)] = -M[:, :, :2] @ lens_l
    by_all[:, :, eyes.lens_columns(1)] = -M[:, :, 2:] @ (G[:, None] @ lens_r)
    turn = np.einsum("ni,nij->nj", D @ R.T, so3.hat(X - t))
    by_all[:, :, :6] = -M[:, :, 2:] @ np.concatenate([turn, -D @ R.T], axis=1)[:, None]
    return X, -M[:, :, 2], by_all


def _across(q: Array) -> Array:
    """Two axes (n, 3, 2) across each direction."""
    unit = q / np.linalg.norm(q, axis=1, keepdims=True)
    first = np.cross(unit, np.eye(3)[np.argmin(np.abs(unit), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(unit, first)], axis=2)


def coloured_depth(found: DepthMap) -> NDArray[np.uint8]:
    """The depth (above) and its sigma (below) in colours with their scales, near and sure ones red, black where
    unknown: (2 h, w and scales, 3), BGR."""
    scales = [
        (ColourScale.of(what, values, outside=OUTSIDE), values)
        for what, values in (("z", found.points[..., 2]), ("sigma", found.sigma_z))
    ]
    return joined([scale.beside(scale.colours(values)) for scale, values in scales], axis=0)
