"""Pictures by MuJoCo's own renderer in an OpenGL context without a screen: EGL, else OSMesa."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calibrant.opencv import cv2
from calibrant.simulate.robot_cell.pictures.sensor_kernels import to_metres
from calibrant.simulate.robot_cell.pictures.views import FAR_M, NEAR_M, PinholeView
from calibrant.simulate.robot_cell.world.engine import need_mujoco

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.world.physics import World

_MAX_GEOMS = 500


class OpenGLRenderer:
    """A context, a scene, and the two buffers they are read into. One thread uses it."""

    def __init__(self, world: World, name: str, context: Any, *, shadows: bool) -> None:
        self._mujoco = need_mujoco()
        self._world, self._context, self.name = world, context, name
        context.make_current()
        mj = self._mujoco
        self._scene = mj.MjvScene(world.model, _MAX_GEOMS)
        self._scene.flags[mj.mjtRndFlag.mjRND_SHADOW] = shadows
        for flag in (mj.mjtRndFlag.mjRND_REFLECTION, mj.mjtRndFlag.mjRND_SKYBOX, mj.mjtRndFlag.mjRND_HAZE):
            self._scene.flags[flag] = False
        self._options = mj.MjvOption()
        self._free = mj.MjvCamera()
        self._drawer = mj.MjrContext(world.model, mj.mjtFontScale.mjFONTSCALE_100)
        # 1 at the near plane, 0 at the far one: floats are densest at 0, so depth far away keeps its digits.
        self._drawer.readDepthMap = mj.mjtDepthMap.mjDEPTH_ZEROFAR
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._drawer)
        self._size = (0, 0)

    def colour_and_depth(self, view: PinholeView) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        width, height = view.size
        colour = np.empty((height, width, 3), dtype=np.uint8)
        raw = np.empty((height, width), dtype=np.float32)
        self._draw(view, colour, raw, plain=False)
        return np.asarray(cv2.cvtColor(colour[::-1], cv2.COLOR_RGB2BGR), dtype=np.uint8), _metres(raw)

    def depth(self, view: PinholeView) -> NDArray[np.float32]:
        width, height = view.size
        raw = np.empty((height, width), dtype=np.float32)
        self._draw(view, None, raw, plain=True)
        return _metres(raw)

    def close(self) -> None:
        self._context.make_current()
        self._drawer.free()
        self._context.free()

    def _draw(self, view: PinholeView, colour: NDArray | None, depth: NDArray, *, plain: bool) -> None:
        mj = self._mujoco
        self._context.make_current()
        self._world.catch_up()
        width, height = view.size
        if width > self._size[0] or height > self._size[1]:
            self._size = (max(width, self._size[0]), max(height, self._size[1]))
            mj.mjr_resizeOffscreen(*self._size, self._drawer)
        mj.mjv_updateScene(
            self._world.model, self._world.data, self._options, None, self._free, mj.mjtCatBit.mjCAT_ALL, self._scene
        )
        for camera in self._scene.camera:
            _aim(camera, view)
        # Without lights the depth is the same, and drawn faster.
        self._scene.flags[mj.mjtRndFlag.mjRND_SEGMENT] = plain
        rectangle = mj.MjrRect(0, 0, width, height)
        mj.mjr_render(rectangle, self._scene, self._drawer)
        mj.mjr_readPixels(colour, depth, rectangle, self._drawer)


def _aim(camera: Any, view: PinholeView) -> None:
    """Set MuJoCo's camera: its frustum at the near plane from K; pixel centres are whole numbers."""
    R, t = view.T_base_camera[:3, :3], view.T_base_camera[:3, 3]
    camera.pos, camera.forward, camera.up = t, R[:, 2], -R[:, 1]
    width, height = view.size
    fx, fy, cx, cy = view.K[0, 0], view.K[1, 1], view.K[0, 2], view.K[1, 2]
    left, right = -(cx + 0.5) / fx * NEAR_M, (width - 0.5 - cx) / fx * NEAR_M
    camera.frustum_center, camera.frustum_width = 0.5 * (left + right), 0.5 * (right - left)
    camera.frustum_top, camera.frustum_bottom = (cy + 0.5) / fy * NEAR_M, -(height - 0.5 - cy) / fy * NEAR_M
    camera.frustum_near, camera.frustum_far = NEAR_M, FAR_M
    camera.orthographic = 0


def _metres(raw: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.empty_like(raw)
    to_metres(out, raw, np.float32(NEAR_M), np.float32(FAR_M))
    return out


def open_context() -> tuple[str, Any] | str:
    """The first context that can be had, with its name; else, in words, why there is none.

    MUJOCO_GL names the one to try first; "disabled" asks for none.
    """
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if wanted in ("disable", "disabled", "off", "false", "0"):
        return f"MUJOCO_GL={wanted}"
    order = sorted(("egl", "osmesa"), key=lambda kind: kind != wanted)
    reasons = []
    for kind in order:
        try:
            return _NAMES[kind], _context(kind)
        # Whatever a missing or broken driver does when it is loaded, the next one is tried and the reason kept.
        except (ImportError, RuntimeError, AttributeError, OSError, TypeError) as error:
            reasons.append(f"{_NAMES[kind]}: {error or type(error).__name__}")
    return "; ".join(reasons)


_NAMES = {"egl": "EGL", "osmesa": "OSMesa"}


def _context(kind: str) -> Any:
    if kind == "egl":
        from mujoco.egl import GLContext
    else:
        from mujoco.osmesa import GLContext
    context = GLContext(64, 64)
    context.make_current()
    return context
