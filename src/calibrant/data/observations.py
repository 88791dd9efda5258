"""Observations: what was seen, where, in which image. The one currency between detection and calibration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.cameras.camera import Camera
from calibrant.errors import InputError
from calibrant.expected import expect, unexpected
from calibrant.geometry import se3

DEFAULT_CAMERA = "camera"


def _frozen(value: ArrayLike, *, dtype: type, shape: tuple[int, ...], what: str) -> NDArray:
    array: NDArray = np.array(value, dtype=dtype)
    if array.shape != shape:
        raise InputError(f"{what}: expected shape {shape}, got {array.shape}")
    if dtype is np.float64 and not np.all(np.isfinite(array)):
        raise InputError(f"{what} holds NaN or infinite values; leave such points out")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Carried:
    """Points that were found in one picture at what another camera saw: a projector's pixels at a camera's corners.

    camera: the other camera; uv (n, 2): its pixels of the same points; slope (n, 2, 2): how the points move with them,
    d uv_here / d uv. An error of those, e, is in these as slope e.

        >>> import calibrant as cb, numpy as np
        >>> cb.Carried("camera", uv=[[10.0, 20.0]], slope=[np.eye(2)]).camera
        'camera'
    """

    camera: str
    uv: Array
    slope: Array

    def __post_init__(self) -> None:
        n, what = len(np.atleast_1d(np.asarray(self.uv))), f"points carried from {self.camera!r}"
        object.__setattr__(self, "uv", _frozen(self.uv, dtype=np.float64, shape=(n, 2), what=f"{what}: uv"))
        object.__setattr__(self, "slope", _frozen(self.slope, dtype=np.float64, shape=(n, 2, 2), what=f"{what}: slope"))

    def subset(self, keep: NDArray[np.bool_]) -> Carried:
        """Those where keep (n,) is true."""
        return Carried(self.camera, self.uv[keep], self.slope[keep])


@dataclass(frozen=True, eq=False)
class View:
    """The points of one target seen in one image.

    points (n, 3) metres, target frame; uv (n, 2) pixels; point_ids (n,) labels of the target's points;
    sigma_px (n,) relative standard deviation of each point per axis, or None when all weigh the same;
    covariance_px (n, 2, 2) px^2 where points are less certain along one direction than along another (the picture moved
    while it was exposed): sigma_px is then the root of half its trace, and need not be given.
    `moment` names what was seen at the same time (other cameras, a robot pose); it is the id when not given.
    carried: where the points were found by those of another camera, a projector's (see `Carried`).

        >>> import calibrant as cb
        >>> len(cb.View("0.png", points=[[0, 0, 0], [0.03, 0, 0]], uv=[[10, 20], [40, 20]], point_ids=[0, 1]))
        2
    """

    id: str
    points: Array
    uv: Array
    point_ids: NDArray[np.int64]
    camera: str = DEFAULT_CAMERA
    moment: str = ""
    sigma_px: Array | None = None
    file: str | None = None
    carried: Carried | None = None
    covariance_px: Array | None = None

    def __post_init__(self) -> None:
        expect(self.id, str, "a view's id", "text")
        n = len(np.atleast_1d(np.asarray(self.uv)))
        where = f"view {self.id!r}"
        set_ = object.__setattr__
        set_(self, "points", _frozen(self.points, dtype=np.float64, shape=(n, 3), what=f"{where}: points"))
        set_(self, "uv", _frozen(self.uv, dtype=np.float64, shape=(n, 2), what=f"{where}: uv"))
        set_(self, "point_ids", _frozen(self.point_ids, dtype=np.int64, shape=(n,), what=f"{where}: point_ids"))
        if self.covariance_px is not None:
            self._check_covariance(self.covariance_px, n, where)
        if self.sigma_px is not None:
            sigma = _frozen(self.sigma_px, dtype=np.float64, shape=(n,), what=f"{where}: sigma_px")
            if np.any(sigma <= 0):
                raise InputError(f"{where}: sigma_px must be above 0 px for every point")
            set_(self, "sigma_px", sigma)
        if self.carried is not None and len(self.carried.uv) != n:
            raise InputError(
                f"{where}: {n} points, but {len(self.carried.uv)} are carried from {self.carried.camera!r}"
            )
        if not self.moment:
            set_(self, "moment", self.id)

    def _check_covariance(self, given: Array, n: int, where: str) -> None:
        C = _frozen(given, dtype=np.float64, shape=(n, 2, 2), what=f"{where}: covariance_px")
        object.__setattr__(self, "covariance_px", C)
        variance = 0.5 * np.trace(C, axis1=1, axis2=2)
        asymmetric = np.abs(C[:, 0, 1] - C[:, 1, 0]) > 1e-9 * variance
        if np.any(asymmetric | ~(np.linalg.det(C) > 1e-12 * variance**2) | ~(variance > 0)):
            raise InputError(f"{where}: covariance_px must be symmetric and positive definite for every point")
        sigma = np.sqrt(variance)
        if self.sigma_px is None:
            object.__setattr__(self, "sigma_px", sigma)
        elif np.shape(self.sigma_px) == (n,) and not np.allclose(self.sigma_px, sigma, rtol=1e-6, atol=0.0):
            raise InputError(f"{where}: sigma_px must be the root of half of covariance_px's trace, or left out")

    def __len__(self) -> int:
        return len(self.uv)

    def __repr__(self) -> str:
        of = "" if self.camera == DEFAULT_CAMERA else f" of {self.camera}"
        return f"View({self.id!r}{of}, {len(self)} points)"

    def residuals(self, camera: Camera, T_camera_target: ArrayLike) -> Array:
        """Predicted minus seen (n, 2), pixels, with the target at T_camera_target (4, 4); NaN behind the camera."""
        return camera.project(se3.apply(T_camera_target, self.points)) - self.uv

    def subset(self, keep: NDArray[np.bool_]) -> View:
        """The view with the points where keep (n,) is true."""
        sigma = None if self.sigma_px is None else self.sigma_px[keep]
        covariance = None if self.covariance_px is None else self.covariance_px[keep]
        carried = None if self.carried is None else self.carried.subset(keep)
        return replace(
            self, points=self.points[keep], uv=self.uv[keep], point_ids=self.point_ids[keep],
            sigma_px=sigma, covariance_px=covariance, carried=carried,
        )  # fmt: skip


ONE_SIZE = "one camera takes images of one size"
"""How the reason ends for which an image of another size gives no view."""


@dataclass(frozen=True)
class Missed:
    """An image that gave no view, and why."""

    id: str
    reason: str
    camera: str = DEFAULT_CAMERA
    file: str | None = None


@dataclass(frozen=True, eq=False)
class Observations:
    """All views of a data set.

    image_sizes: (width, height) of each camera by name; target: its spec, when known; missed: images that gave no
    view; notes: what a person should know about how the views were read, in whole sentences.

        >>> import calibrant as cb
        >>> points, uv = [[[0, 0, 0], [0.03, 0, 0]]], [[[10, 20], [40, 20]]]  # metres and pixels, a pair a view
        >>> observations = cb.Observations.from_points(points, uv, image_size=(640, 480))
        >>> len(observations.views)
        1
    """

    views: tuple[View, ...]
    image_sizes: dict[str, tuple[int, int]]
    target: str | None = None
    missed: tuple[Missed, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        views = (
            None if isinstance(self.views, str | bytes) or not isinstance(self.views, Iterable) else tuple(self.views)
        )
        if views is None or not all(isinstance(view, View) for view in views):
            raise unexpected(self.views, "views", "View objects")
        object.__setattr__(self, "views", views)
        expect(self.image_sizes, Mapping, "image_sizes", "(width, height) by camera, such as {'camera': (640, 480)}")
        seen: set[tuple[str, str]] = set()
        for view in self.views:
            key = (view.camera, view.id)
            if key in seen:
                raise InputError(f"two views of camera {view.camera!r} are both called {view.id!r}; ids must be unique")
            seen.add(key)
            if view.camera not in self.image_sizes:
                raise InputError(f"view {view.id!r} is of camera {view.camera!r}, whose image size is not given")

    @classmethod
    def from_points(
        cls,
        points: Sequence[ArrayLike],
        uv: Sequence[ArrayLike],
        *,
        image_size: tuple[int, int],
        ids: Iterable[str] | None = None,
        point_ids: Sequence[ArrayLike] | None = None,
        target: str | None = None,
    ) -> Observations:
        """Observations of one camera from arrays, a pair a view: points (n, 3) metres and uv (n, 2) pixels.

        Raises: InputError when the lists differ in length, shapes do not fit, values are not finite.
        """
        if len(points) != len(uv):
            raise InputError(f"points has {len(points)} views and uv has {len(uv)}; give one of each a view")
        names = [str(i) for i in range(len(uv))] if ids is None else [str(i) for i in ids]
        if len(names) != len(uv):
            raise InputError(f"ids has {len(names)} names for {len(uv)} views")
        labels = [np.arange(len(np.asarray(u))) for u in uv] if point_ids is None else point_ids
        views = tuple(
            View(name, np.asarray(p, dtype=np.float64), np.asarray(u, dtype=np.float64), np.asarray(i, dtype=np.int64))
            for name, p, u, i in zip(names, points, uv, labels, strict=True)
        )
        return cls(views, {DEFAULT_CAMERA: image_size}, target)

    def of_camera(self, camera: str) -> Observations:
        """Only the views (and misses) of one camera. Raises: InputError naming the known cameras."""
        if camera not in self.image_sizes:
            raise InputError(f"no camera {camera!r} in the observations; known: {', '.join(self.image_sizes)}")
        return Observations(
            tuple(v for v in self.views if v.camera == camera),
            {camera: self.image_sizes[camera]},
            self.target,
            tuple(m for m in self.missed if m.camera == camera),
            self.notes,
        )

    def __repr__(self) -> str:
        cameras = ", ".join(f"{name} {w} × {h} px" for name, (w, h) in self.image_sizes.items())
        target = "" if self.target is None else f", {self.target}"
        missed = f", {len(self.missed)} missed" if self.missed else ""
        points = sum(map(len, self.views))
        return f"Observations({len(self.views)} views, {points} points{missed}; {cameras}{target})"

    def only(self, ids: Iterable[str]) -> Observations:
        """Only the views with these ids, in their own order."""
        wanted = set(ids)
        return replace(self, views=tuple(v for v in self.views if v.id in wanted))
