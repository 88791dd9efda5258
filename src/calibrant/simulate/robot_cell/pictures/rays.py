"""Pictures without OpenGL: a ray a pixel, MuJoCo's own intersection; flat colours under one lamp, exact depth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.simulate.robot_cell.pictures.views import FAR_M, PinholeView
from calibrant.simulate.robot_cell.world.engine import need_mujoco
from calibrant.simulate.robot_cell.world.light import Light

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.world.physics import World


class RayRenderer:
    """About ten times slower than OpenGL on a processor, and needs nothing but MuJoCo."""

    name = "rays"

    def __init__(self, world: World, light: Light) -> None:
        self._world, self._light = world, light

    def colour_and_depth(self, view: PinholeView) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        geom, depth, points = self._cast(view)
        model = self._world.model
        colour = np.where((geom >= 0)[..., None], model.geom_rgba[geom, :3], 0.0)
        shade = self._light.ambient + self._light.diffuse * np.maximum(0.0, -_normals(points) @ self._light.direction)
        grey = np.clip(255 * colour * shade[..., None], 0, 255)
        return np.ascontiguousarray(np.rint(grey[..., ::-1]).astype(np.uint8)), depth

    def depth(self, view: PinholeView) -> NDArray[np.float32]:
        return self._cast(view)[1]

    def close(self) -> None:
        """Nothing is held."""

    def _cast(self, view: PinholeView) -> tuple[NDArray[np.int32], NDArray[np.float32], Array]:
        mj = need_mujoco()
        self._world.catch_up()
        width, height = view.size
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        K, T = view.K, view.T_base_camera
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)
        vectors = rays @ T[:3, :3].T  # of length 1 along the axis: distances along them are depths
        count = width * height
        geom, distance = np.full(count, -1, dtype=np.int32), np.full(count, -1.0)
        flat = np.ascontiguousarray(vectors.reshape(-1))
        group = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        inputs = (self._world.model, self._world.data, T[:3, 3].copy(), flat, group, 1, -1, geom, distance)
        reach = FAR_M * float(np.linalg.norm(rays, axis=-1).max())
        try:
            mj.mj_multiRay(*inputs, None, count, reach)
        except TypeError:  # MuJoCo before 3.5 gives no normals
            mj.mj_multiRay(*inputs, count, reach)
        depth = np.where(geom >= 0, distance, FAR_M).reshape(height, width)
        points = T[:3, 3] + depth[..., None] * vectors
        return geom.reshape(height, width), depth.astype(np.float32), points


def _normals(points: Array) -> Array:
    """Unit normals (h, w, 3), towards the camera, from the points (h, w, 3) to the right and below."""
    across, down = np.diff(points, axis=1, append=points[:, -1:]), np.diff(points, axis=0, append=points[-1:])
    normal = np.cross(down, across)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return normal / np.maximum(length, 1e-12)
