"""A camera of the cell as `data.CameraSource`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import DeviceCalibration, Picture
from calibrant.errors import DeviceError
from calibrant.simulate.robot_cell.parts.spec import CellCamera
from calibrant.simulate.robot_cell.pictures.lens import LensMap, lens_map
from calibrant.simulate.robot_cell.pictures.sensors import NoiseBank, noisy_colour, noisy_depth
from calibrant.simulate.robot_cell.pictures.sheets import Eye, Sheet, draw_sheet
from calibrant.simulate.robot_cell.pictures.views import PinholeView, Renderer
from calibrant.simulate.robot_cell.world.light import Light

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibrant.simulate.robot_cell.world.physics import World


@dataclass(frozen=True, eq=False)
class TrueCamera:
    """What a camera really is: lenses of colour and depth, T_colour_depth, the error of its depth, px of disparity."""

    colour: Camera
    depth: Camera
    T_colour_depth: Array
    offset_px: float


class SimulatedCamera:
    """Takes pictures of a `World`. See `calibrant.data.CameraSource` for what its methods promise.

    `take_colour` leaves depth out, in half the time: for calibration.
    """

    def __init__(
        self,
        spec: CellCamera,
        true: TrueCamera,
        T_parent_camera: Array,
        *,
        world: World,
        renderer: Renderer,
        sheets: Callable[[], list[Sheet]],
        light: Light,
        rng: np.random.Generator,
    ) -> None:
        self._spec, self.true = spec, true
        self.T_parent_camera = T_parent_camera
        self._world, self._renderer, self._sheets, self._light = world, renderer, sheets, light
        self._rng, self._bank = rng, NoiseBank(rng, correlation_px=spec.depth_noise.correlation_px)
        self._taken = 0
        self._open = True
        self._on_picture: list[Callable[[str, Picture], None]] = []

    @property
    def name(self) -> str:
        return self._spec.name

    @property
    def parent(self) -> str:
        """What it is mounted on: "gripper" or "base"."""
        return self._spec.parent

    @property
    def stated(self) -> DeviceCalibration:
        return DeviceCalibration(self._spec.colour, self._spec.depth, self._spec.T_colour_depth)

    def T_base_camera(self) -> Array:
        """The truth now (4, 4)."""
        if self._spec.parent == "base":
            return self.T_parent_camera
        return self._world.pose("flange") @ self.T_parent_camera

    @cached_property
    def _colour_map(self) -> LensMap:
        return lens_map(self.true.colour)

    @cached_property
    def _depth_map(self) -> LensMap:
        return lens_map(self.true.depth)

    def take(self) -> Picture:
        self._need_open()
        colour = self._colour()
        picture = self._finished(colour, self._depth())
        self._arrive()
        return picture

    def take_colour(self) -> Picture:
        """The next picture without its depth."""
        self._need_open()
        picture = self._finished(self._colour(), None)
        self._arrive()
        return picture

    def close(self) -> None:
        self._open = False

    def when_taken(self, hook: Callable[[str, Picture], None]) -> None:
        """Call hook(camera's name, picture) for every picture."""
        self._on_picture.append(hook)

    def _need_open(self) -> None:
        if not self._open:
            raise DeviceError(f"camera {self.name} gives no picture: it was closed")

    def _finished(self, colour: NDArray[np.uint8], depth: NDArray[np.float32] | None) -> Picture:
        stamp = self._world.time_s + self._spec.latency.clock_offset_s
        picture = Picture(f"{self.name} {self._taken:04d}", colour, stamp, depth)
        self._taken += 1
        for hook in self._on_picture:
            hook(self.name, picture)
        return picture

    def _arrive(self) -> None:
        latency = self._spec.latency
        self._world.wait(max(0.0, latency.delay_s + latency.jitter_s * self._rng.uniform(-1, 1)))

    def _colour(self) -> NDArray[np.uint8]:
        T = self.T_base_camera()
        lens = self._colour_map
        drawn, deep = self._renderer.colour_and_depth(PinholeView(lens.K, lens.size, T))
        picture = lens.colour(drawn)
        eye = Eye(self.true.colour, lens, T, self._light)
        for sheet in self._sheets():
            draw_sheet(picture, deep, sheet, self._world.pose(sheet.body), eye)
        return noisy_colour(picture, self._spec.noise, self._bank)

    def _depth(self) -> NDArray[np.float32]:
        lens = self._depth_map
        T = self.T_base_camera() @ self.true.T_colour_depth
        depth = lens.depth(self._renderer.depth(PinholeView(lens.K, lens.size, T)))
        focal = float(self.true.depth.parameters["fx"])
        return noisy_depth(
            depth, focal, self._spec.depth_noise, self._bank, offset_px=self.true.offset_px, rng=self._rng
        )
