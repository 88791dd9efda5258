"""Two cameras compared by what they see, whatever their models: in pixels over the image, and by their parameters.

At a pixel q of the first camera with its ray p(q) the second sees d(q) = project_b(R p(q)) - q elsewhere. A turn of the
camera against its mount explains a part of it, since a calibration's poses turn along: R is the implied rotation,

    minimise  sum_q |project_b(R p(q)) - q|^2   over R,

and what is left is a difference of the lenses (as mrcal's projection-diff has it, there with weights). To first order
d depends on both parameter vectors: d_b = J_b, and d_a = -P_b R P_a^+ J_a with P the derivatives by the ray; the part
that R takes up leaves by the projection I - W (W^T W)^-1 W^T, W = dd/dR. The two are taken as independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import in_words_of
from calibrant.data.details_comparison import CameraComparison, DifferenceMap, ParameterDifference
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.optimize.chances import chi2_tail

GRID = (40, 30)
"""Pixels across the image and down: a polynomial of degree 20 does not hide between them."""
_STEPS = 30
_SETTLED = 1e-12
"""Radians: a step of the rotation that moves no pixel."""
_LEAST = 20
"""Pixels that both see, below which nothing is compared."""
_NO_INFORMATION = 1e-9
"""Relative sigma of a direction below which it is held: rounding, not knowledge."""
_SECOND_ORDER = 0.01
"""Of the largest sigma: a thousandth of a pixel where the largest is a tenth, as the square of a turn of 1 mrad is."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Pixels uv (n, 2) of the first camera that both see, on the grid by `seen`; d (n, 2) before and left (n, 2) after
    the rotation (3,), radians, is removed. sensitive (2n, k): of `left`, and turning (3, k): of the rotation, by the
    parameters that have a covariance (k, k); None where one camera has none."""

    uv: Array
    seen: Mask
    d: Array
    left: Array
    rotation: Array
    covariance: Array | None
    sensitive: Array
    turning: Array

    @property
    def sigma(self) -> Array | None:
        """1 sigma (n,) of what is left at each pixel, along its worst axis."""
        if self.covariance is None:
            return None
        J = self.sensitive.reshape(len(self.uv), 2, -1)
        C = J @ self.covariance @ np.swapaxes(J, 1, 2)
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(C)[:, -1], 0.0)))

    @property
    def expected_px(self) -> float | None:
        """RMS per point over both axes that the uncertainties make of what is left."""
        if self.covariance is None:
            return None
        square = np.einsum("ik,kl,il->", self.sensitive, self.covariance, self.sensitive)
        return float(np.sqrt(max(square, 0.0) / len(self.uv)))

    @property
    def rotation_sigma(self) -> Array | None:
        """1 sigma (3,), radians."""
        if self.covariance is None:
            return None
        return np.asarray(np.sqrt(np.maximum(np.diag(self.turning @ self.covariance @ self.turning.T), 0.0)))

    @property
    def chance(self) -> float | None:
        """Of differences as large by the uncertainties alone.

        Second order terms move what is known a hundred times better than the rest, and what no parameter moves: no
        direction counts as known to less than that, and one counts as much as its sigma stands above it."""
        if self.covariance is None:
            return None
        # 2n pixels move in few directions: J C J^T = (J L)(J L)^T, and J L = U S V^T has no more than parameters.
        w, V = np.linalg.eigh(self.covariance)
        U, S, _ = np.linalg.svd(self.sensitive @ (V * np.sqrt(np.maximum(w, 0.0))), full_matrices=False)
        if not S.max(initial=0.0) > 0:
            return None
        known = _NO_INFORMATION * S.max() < S
        floor = _SECOND_ORDER * S.max()
        along = U[:, known].T @ self.left.ravel()
        beside = max(float(np.sum(self.left**2) - along @ along), 0.0)
        squares = float(np.sum(along**2 / (S[known] ** 2 + floor**2))) + beside / floor**2
        return chi2_tail(float(np.sum(S[known] ** 2 / (S[known] ** 2 + floor**2))), squares)


def compare_cameras(first: Camera, second: Camera, *, names: tuple[str, str] = ("", "")) -> CameraComparison:
    """The second camera against the first, in the first one's pixels.

    d(q) = project_b(R p_a(q)) - q, see above. Pictures of another size with the same ratio of sides are compared as if
    scaled; of another ratio, pixel by pixel as they stand. Args: names of the two.
    Raises: InputError where they share no field of view, or one has parallel rays and the other has not.

        >>> import calibrant as cb
        >>> terms = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
        >>> a = cb.Camera.create("pinhole", terms, image_size=(640, 480))
        >>> b = cb.Camera.create("pinhole", {**terms, "cx": 320.5}, image_size=(640, 480))
        >>> found = compare_cameras(a, b)
        >>> round(found.rms_px, 3), round(found.rotation_mrad[1], 2)
        (1.0, -1.1)
    """
    found = differences(first, second)
    turn, turn_sigma = found.rotation, found.rotation_sigma
    sizes = [np.linalg.norm(v, axis=1) for v in (found.d, found.left)]
    (rms, most), (left_rms, left_most) = ((float(np.sqrt(np.mean(s**2))), float(s.max())) for s in sizes)
    return CameraComparison(
        *names,
        first.model.name,
        second.model.name,
        first.image_size,
        second.image_size,
        rms_px=rms,
        most_px=most,
        rotated_rms_px=left_rms,
        rotated_most_px=left_most,
        rotation_mrad=_triple(1e3 * turn),
        rotation_sigma_mrad=None if turn_sigma is None else _triple(1e3 * turn_sigma),
        expected_px=found.expected_px,
        chance=found.chance,
        shared=float(found.seen.mean()),
        parameters=_parameters(first, second),
        map=_map(first, found),
    )


def differences(first: Camera, second: Camera) -> Differences:
    """What `compare_cameras` sums up. Raises: as it."""
    if (first.model.projection == "parallel") != (second.model.projection == "parallel"):
        raise InputError("one of the cameras has parallel rays, the other has not: they see nothing alike")
    width, height = first.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    p = first.unproject(uv)
    # Where the first camera does not see its own ray again, its model does not hold: nothing is compared there.
    seen: Mask = np.asarray(np.isfinite(p).all(axis=-1))
    seen[seen] &= first.model.valid(first.values, p[seen])
    scale = _scale(first, second)
    seen[seen] &= _sees(second, p[seen], scale)
    if int(seen.sum()) < _LEAST:
        raise InputError("the two cameras share no field of view: one of them is of another image or lens")
    uv, p = uv[seen], p[seen]
    d = _predicted(second, p, scale) - uv
    R = _implied(second, p, uv, scale)
    return _with_sensitivity(first, second, (uv, p, seen), d, R, scale)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def same_ratio(first: Camera, second: Camera) -> bool:
    """Whether one camera's picture can be the other's scaled, to a pixel."""
    (w, h), (w2, h2) = first.image_size, second.image_size
    return abs(w * h2 - w2 * h) <= max(w, h, w2, h2)


def _scale(first: Camera, second: Camera) -> Array:
    """Pixels of the first a pixel of the second, (2,)."""
    if not same_ratio(first, second):
        return np.ones(2)
    return np.asarray(np.array(first.image_size) / np.array(second.image_size))


def _predicted(camera: Camera, p: Array, scale: Array) -> Array:
    """Pixels in the first one's: pixel areas scale, and (0, 0) is the middle of the first."""
    return np.asarray((camera.project(p) + 0.5) * scale - 0.5)


def _sees(camera: Camera, p: Array, scale: Array) -> Mask:
    valid = camera.model.valid(camera.values, p)
    with np.errstate(all="ignore"):
        return np.asarray(valid & np.isfinite(_predicted(camera, p, scale)).all(axis=-1))


def _implied(camera: Camera, p: Array, uv: Array, scale: Array) -> Array:
    """R (3, 3): Gauss-Newton from no rotation; what leaves the model's field on the way does not count."""
    R = np.eye(3)
    for _ in range(_STEPS):
        turned = p @ R.T
        good = _sees(camera, turned, scale)
        if good.sum() < _LEAST:
            return np.eye(3)
        r = _predicted(camera, turned[good], scale) - uv[good]
        W = _by_rotation(camera, turned[good], scale)
        step = np.linalg.lstsq(W.reshape(-1, 3), -r.ravel(), rcond=None)[0]
        R = so3.exp(step) @ R
        if np.linalg.norm(step) < _SETTLED:
            break
    return R


def _by_rotation(camera: Camera, turned: Array, scale: Array) -> Array:
    """d pixel / d omega (n, 2, 3) of rays R p, omega along the second camera's axes."""
    _, P, _ = camera.model.project_with_jacobians(camera.values, turned)
    return np.asarray(-(scale[:, None] * P) @ so3.hat(turned))


def _with_sensitivity(
    first: Camera, second: Camera, grid: tuple[Array, Array, Mask], d: Array, R: Array, scale: Array
) -> Differences:
    uv, p, seen = grid
    turned = p @ R.T
    good = _sees(second, turned, scale)
    if not good.all():
        uv, p, d, turned = uv[good], p[good], d[good], turned[good]
        seen = seen.copy()
        seen[seen] = good
    left = _predicted(second, turned, scale) - uv
    _, P_b, J_b = second.model.project_with_jacobians(second.values, turned)
    _, P_a, J_a = first.model.project_with_jacobians(first.values, p)
    by_first = -(scale[:, None] * P_b) @ R @ np.linalg.pinv(P_a) @ J_a
    G = np.concatenate([by_first, scale[:, None] * J_b], axis=-1).reshape(2 * len(uv), -1)
    W = _by_rotation(second, turned, scale).reshape(-1, 3)
    turning = -np.linalg.lstsq(W, G, rcond=None)[0]
    C_a, C_b = first.covariance, second.covariance
    C = None
    if C_a is not None and C_b is not None:
        C = np.zeros((G.shape[1],) * 2)
        C[: len(C_a), : len(C_a)], C[len(C_a) :, len(C_a) :] = C_a, C_b
    return Differences(uv, seen, d, left, so3.log(R), C, G + W @ turning, turning)


def _map(first: Camera, found: Differences) -> DifferenceMap:
    """The differences at MAP's pixels, of those computed."""
    columns, rows = GRID[0] // 2, GRID[1] // 2
    place = np.full(GRID[0] * GRID[1], -1)
    place[found.seen] = np.arange(len(found.uv))
    chosen = place.reshape(GRID[1], GRID[0])[::2, ::2].ravel()
    width, height = first.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0])[::2], np.linspace(0, height - 1, GRID[1])[::2])
    sigma = found.sigma
    du, dv = (tuple(None if k < 0 else float(found.left[k, axis]) for k in chosen) for axis in (0, 1))
    sigmas = tuple(None if k < 0 or sigma is None else float(sigma[k]) for k in chosen)
    return DifferenceMap(columns, rows, tuple(map(float, u.ravel())), tuple(map(float, v.ravel())), du, dv, sigmas)


def _parameters(first: Camera, second: Camera) -> tuple[ParameterDifference, ...]:
    """Terms beside each other. Of other models the first is said in the second one's words where that loses nothing;
    else terms of one name do not mean the same, and no difference is stated. Nor is it between other sizes."""
    if first.model.name != second.model.name:
        first = in_words_of(first, (second.model.name,)) or first
    alike = first.model.name == second.model.name and first.image_size == second.image_size
    units = {c.model.parameter_names[i]: u for c in (second, first) for i, u in enumerate(c.model.parameter_units)}
    a, b, s_a, s_b = first.parameters, second.parameters, first.sigma, second.sigma
    out = []
    for name in dict.fromkeys((*first.model.parameter_names, *second.model.parameter_names)):
        x, y, s, t = a.get(name), b.get(name), s_a.get(name), s_b.get(name)
        difference = y - x if alike and x is not None and y is not None else None
        sigma = float(np.hypot(s, t)) if difference is not None and s is not None and t is not None else None
        out.append(ParameterDifference(name, units[name], x, y, s, t, difference, sigma))
    return tuple(out)
