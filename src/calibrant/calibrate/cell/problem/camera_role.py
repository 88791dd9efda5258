"""How a camera enters the problem of a cell: held, within what is known of it, or free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.held import ASPECT, camera_manifold
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.optimize.manifolds import Euclidean, Manifold


@dataclass(frozen=True, eq=False)
class CameraRole:
    """How the camera enters: its start, names of held parameters, and the square root information of a prior.

    weak: square root information of a prior of mean 0 on terms that the views may not tell (`weak_terms`).
    extra: views without a robot pose that help to determine the camera, with their start poses. tied: what else of
    `--fix` holds (the aspect ratio, as it is at the start).
    """

    camera: Camera
    held: tuple[str, ...]
    prior: Array | None = None
    extra: tuple[View, ...] = ()
    extra_poses: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    tied: tuple[str, ...] = ()
    weak: Array | None = None

    @property
    def manifold(self) -> Manifold:
        """Where its parameters may go."""
        if self.tied:
            return camera_manifold(self.camera.model, (*self.held, *self.tied), self.camera.values)
        return Euclidean(self.camera.model.parameter_names, self.held)

    @property
    def exact(self) -> bool:
        """Whether nothing of it is unknown."""
        return self.prior is None and len(self.held) == len(self.camera.values)

    @property
    def words(self) -> str:
        """Where the camera comes from."""
        if self.exact:
            return "given, held"
        if self.prior is not None:
            return "given with its covariance, refined jointly"
        if self.weak is not None:
            return "found in the whole alone, distortion that nothing tells held near none"
        return "calibrated from the same images, refined jointly"


def found_camera(camera: Camera, fix: Sequence[str]) -> CameraRole:
    """A camera that its own photos have calibrated: what was held there is held on."""
    held = tuple(n for n, s in camera.sigma.items() if s == 0)
    return CameraRole(camera, held, tied=tuple(name for name in fix if name == ASPECT))


def held_camera(camera: Camera) -> CameraRole:
    """The camera as it is: exact."""
    return CameraRole(camera, camera.model.parameter_names)


def prior_camera(camera: Camera) -> CameraRole:
    """The camera within its own covariance; parameters without variance are held."""
    if camera.covariance is None:
        return held_camera(camera)
    names = camera.model.parameter_names
    variance = np.diag(camera.covariance)
    free = variance > 0
    if not free.any():
        return held_camera(camera)
    information = np.linalg.inv(camera.covariance[np.ix_(free, free)])
    root = np.zeros((int(free.sum()), len(names)))
    root[:, free] = np.linalg.cholesky(information).T
    return CameraRole(camera, tuple(n for n, f in zip(names, free) if not f), root)
