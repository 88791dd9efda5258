"""What separates a device from its ideal: noise models of the cell, frozen, each figure with its source or its reason.

All are 1 sigma unless a name says otherwise; 0 switches a kind of noise off.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3


@dataclass(frozen=True)
class CameraNoise:
    """Lens and sensor of the colour picture, greys 0..255.

    blur_px: Gaussian blur of lens, debayering and pixel; 0.6 to 0.8 is what edges in pictures of the D400 series show.
    well_electrons: electrons of a full pixel, for shot noise 255 / sqrt(well) at white: about 5000 for the 1.4 um
    pixels of the D435's colour sensor. read_grey: of the electronics. jpeg_quality: 0 for none, as the camera streams
    YUY2; 80 to 95 where a recorder compresses.
    """

    blur_px: float = 0.7
    well_electrons: float = 5000.0
    read_grey: float = 1.0
    jpeg_quality: int = 0

    def __post_init__(self) -> None:
        _check_not_negative(self)
        if self.jpeg_quality > 100:
            raise InputError(f"jpeg_quality is 1 to 100, or 0 for no compression; got {self.jpeg_quality}")


@dataclass(frozen=True)
class DepthNoise:
    """An active stereo depth camera: z = focal * baseline / disparity, so sigma_z = z^2 / (f b) * sigma_disparity.

    subpixel_px: RMS of the disparity on a well textured surface; Intel's "Best-Known-Methods for Tuning D400 Depth
    Cameras" gives 0.08 (0.05 to 0.1). correlation_px: noise of neighbours is alike over the matching window.
    disparity_step_px: the D4 processor's disparities have five binary places. edge_px: half of the matching window:
    nearer to a step of depth than this, pixels belong to neither side and are mostly empty; it leaves few valid pixels
    on a cube of 4 cm at 1.5 to 2 m. largest_disparity_px: 126, the search range: nothing nearer than f b / 126.
    offset_px: error of the device's own calibration, constant over the picture, 1 sigma between devices; 0.03 px are
    0.1 % of depth for a D455 at 1.3 m, a tenth of the 2 % that its data sheet promises. holes: share of single pixels
    lost anywhere. unit_m: of the stored number.
    """

    baseline_m: float
    subpixel_px: float = 0.08
    correlation_px: float = 2.0
    disparity_step_px: float = 1 / 32
    edge_px: float = 2.0
    largest_disparity_px: float = 126.0
    offset_px: float = 0.03
    holes: float = 0.002
    unit_m: float = 0.001

    def __post_init__(self) -> None:
        _check_not_negative(self)
        if self.baseline_m <= 0:
            raise InputError(f"a stereo camera's baseline is above 0, got {self.baseline_m} m")

    @property
    def perfect(self) -> bool:
        """Whether it changes nothing."""
        errors = (self.subpixel_px, self.disparity_step_px, self.edge_px, self.offset_px, self.holes, self.unit_m)
        return not any((*errors, self.largest_disparity_px))

    def sigma_m(self, depth_m: float, focal_px: float) -> float:
        """Noise of a depth, metres, from the equation above."""
        return depth_m**2 / (focal_px * self.baseline_m) * self.subpixel_px


@dataclass(frozen=True)
class RobotNoise:
    """What separates where the controller says the flange is from where it is.

    repeatability_mm: scatter of the flange's position from stop to stop, along each axis; 0.1 mm is what the data sheet
    of the Franka arm gives (the UR5e's says 0.03). joint_offset_deg: zero of each encoder; link_mm: lengths of the
    arm's links (and link_mm / 300 mm in their angles). What a maker's calibration leaves of these two is small against
    an uncalibrated arm's (0.05 degrees, 0.3 mm: millimetres at the tip); the defaults come to about repeatability.
    backlash_deg: a joint stops short on the side that it comes from, by half of this.
    """

    repeatability_mm: float = 0.1
    joint_offset_deg: float = 0.005
    link_mm: float = 0.03
    backlash_deg: float = 0.002

    def __post_init__(self) -> None:
        _check_not_negative(self)


@dataclass(frozen=True)
class Latency:
    """Seconds from the middle of the exposure until the picture is there.

    delay_s: about 50 ms for the D400 series at 30 pictures a second, a picture and a half; evenly spread by `jitter_s`
    to either side. clock_offset_s: by how much the camera's stamps are late against the robot's clock.
    """

    delay_s: float = 0.05
    jitter_s: float = 0.005
    clock_offset_s: float = 0.0

    def __post_init__(self) -> None:
        if self.delay_s < 0 or not 0 <= self.jitter_s <= self.delay_s:
            raise InputError(f"a delay is 0 or more, its jitter 0 to the delay; got {self.delay_s}, {self.jitter_s} s")


@dataclass(frozen=True)
class CellSpread:
    """How cells differ by seed, 1 sigma: where cameras are mounted, and what their makers did not measure.

    wrist and fixed cameras by hand to millimetres and degrees (thesis, section 4: "hand-measured"); focal_percent and
    centre_px: lens against the figures that the device states, as between the factory's and the calibrated values of
    the thesis' D435 (below 1 %, a few pixels); radial: the distortion coefficient k1, which the device states as 0.
    """

    wrist_mm: float = 3.0
    wrist_deg: float = 2.0
    fixed_mm: float = 20.0
    fixed_deg: float = 2.0
    focal_percent: float = 0.4
    centre_px: float = 2.0
    radial: float = 0.03
    objects_m: float = 0.18
    light: float = 0.15

    def __post_init__(self) -> None:
        _check_not_negative(self)


@dataclass(frozen=True)
class CalibrationErrors:
    """Errors put into a calibration on purpose, of exactly this size, in random directions: how wrong may it be?"""

    focal_percent: float = 0.0
    centre_px: float = 0.0
    hand_eye_mm: float = 0.0
    hand_eye_deg: float = 0.0

    def wrong_camera(self, camera: Camera, rng: np.random.Generator) -> Camera:
        """The camera with its focal lengths longer or shorter, its centre moved."""
        values = camera.parameters
        factor = 1 + 0.01 * self.focal_percent * rng.choice([-1.0, 1.0])
        along = rng.uniform(0, 2 * np.pi)
        moved = {
            "fx": values["fx"] * factor,
            "fy": values["fy"] * factor,
            "cx": values["cx"] + self.centre_px * np.cos(along),
            "cy": values["cy"] + self.centre_px * np.sin(along),
        }
        return Camera.create(camera.model.name, values | moved, image_size=camera.image_size)

    def wrong_pose(self, T_a_b: Array, rng: np.random.Generator) -> Array:
        """The transform turned and shifted by exactly the sizes above."""
        turn, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        return se3.retract(
            T_a_b, np.concatenate([np.deg2rad(self.hand_eye_deg) * turn, 1e-3 * self.hand_eye_mm * shift])
        )


def _check_not_negative(noise: object) -> None:
    wrong = {f.name: getattr(noise, f.name) for f in fields(noise) if getattr(noise, f.name) < 0}  # type: ignore[arg-type]
    if wrong:
        name, value = next(iter(wrong.items()))
        raise InputError(f"{type(noise).__name__}: {name} is {value}; expected 0 or more")


NO_CAMERA_NOISE = CameraNoise(blur_px=0.0, well_electrons=0.0, read_grey=0.0)
NO_ROBOT_NOISE = RobotNoise(0.0, 0.0, 0.0, 0.0)
NO_LATENCY = Latency(0.0, 0.0)
NO_SPREAD = CellSpread(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
