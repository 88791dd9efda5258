"""Options that say which cameras took colour and depth, and how noisy the depth is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.option import Option
from calibrant.tasks.options.words import pixels

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from calibrant.perceive.registered_depth.noise import DepthNoise
    from calibrant.perceive.registered_depth.register import DepthRig


@dataclass(frozen=True, kw_only=True)
class DepthRigOptions:
    """The cameras of colour and depth."""

    camera: Annotated[Path | None, Option("FILE", "-c")] = None
    """The colour camera (any format), or both cameras and where they are to each other."""
    depth_camera: Annotated[str | None, Option("NAME")] = None
    """The depth camera in --camera's file, where depth has a grid of its own."""
    baseline: Annotated[str, Option("LENGTH")] = "50mm"
    """Of the depth camera: D435 50mm, D455 95mm."""
    sigma_disparity: Annotated[str, Option("PX")] = "0.08px"
    """Noise of its disparities; what a plane shows replaces it."""
    sigma_scale: Annotated[str, Option("PERCENT")] = "0%"
    """1 sigma of a factor that all depths share."""

    @property
    def file(self) -> Path:
        """The cameras' file. Raises: InputError where none is given."""
        if self.camera is None:
            raise InputError("which camera took the pictures? --camera camera.json (calibrant intrinsics --out)")
        return self.camera

    def rig(self, size: tuple[int, int]) -> DepthRig:
        """Both cameras. Args: size (width, height) of the colour pictures. Raises: InputError as the reader."""
        from calibrant.formats.cameras.read import read_camera, read_pair
        from calibrant.geometry import se3
        from calibrant.perceive.registered_depth.register import DepthRig

        path = self.file
        if self.depth_camera is None:
            return DepthRig.aligned(read_camera(path, image_size=size))
        pair = read_pair(path)
        names = list(pair.cameras)
        if self.depth_camera not in names or len(names) != 2:
            raise InputError(f"{path} holds the cameras {', '.join(names)}; --depth-camera names one of two of them")
        depth = self.depth_camera
        colour = next(n for n in names if n != depth)
        known = {(t.parent, t.child): t for t in pair.transforms}
        cameras = pair.cameras[colour], pair.cameras[depth]
        if (colour, depth) in known:
            t = known[colour, depth]
            return DepthRig(*cameras, t.matrix, t.covariance)
        if (depth, colour) in known:
            t = known[depth, colour]
            covariance = None if t.covariance is None else _of_inverse(t.matrix, t.covariance)
            return DepthRig(*cameras, se3.inverse(t.matrix), covariance)
        raise InputError(f"{path} does not say where {depth} is to {colour}")

    def noise(self, rig: DepthRig) -> DepthNoise:
        """As expected of the depth camera. Raises: InputError for other units."""
        from calibrant.perceive.registered_depth.noise import DepthNoise
        from calibrant.targets.lengths import parse_length

        scale = self.sigma_scale.strip()
        try:
            relative = float(scale.removesuffix("%")) / 100
        except ValueError:
            relative = -1.0
        if not scale.endswith("%") or not 0 <= relative < 1:
            raise InputError(f"--sigma-scale takes per cent, such as 0.5%; got {scale!r}")
        return DepthNoise.stereo(
            focal_px=rig.depth.parameters["fx"],
            baseline_m=parse_length(self.baseline, what="--baseline"),
            disparity_px=pixels(self.sigma_disparity, option="--sigma-disparity") or 0.08,
            scale_sigma=relative,
        )


def _of_inverse(T: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of the inverse: its rotation errs by -R^T omega, its place by R^T (omega x t - v)."""
    import numpy as np

    from calibrant.geometry import so3

    Rt = T[:3, :3].T
    J = np.zeros((6, 6))
    J[:3, :3] = -Rt
    J[3:, :3] = -Rt @ so3.hat(T[:3, 3])
    J[3:, 3:] = -Rt
    return J @ covariance @ J.T
