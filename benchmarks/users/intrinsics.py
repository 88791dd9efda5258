"""The conditions of intrinsic calibration, and one run of one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import calibrant as cb
from users import image_faults as f
from users.photos import Draw, Photos, draw_photos, least_covariance
from users.rigid import Array
from users.runs import Run, judged

Edit = Callable[[Photos], None]
USUAL = Draw()


@dataclass(frozen=True)
class Condition:
    """A fault, or none: how photos are drawn, what is done to them, what the person asks for.

    known: the data hold what their sigma is. clean: there is nothing to find.
    """

    name: str
    words: str
    edits: tuple[Edit, ...] = ()
    draw: Draw = USUAL
    model: str = "brown"
    shape: str = "flat"
    known: bool = False
    clean: bool = False


def conditions() -> list[Condition]:
    """Conditions by name, "intrinsics/…"."""
    rolled, never = replace(USUAL, roll=180.0), replace(USUAL, roll=3.0)
    alike = (f.shared_noise(2.0, 1.5),)
    everyday = (f.dots_off(0.03), f.bent(0.15), f.shared_noise(0.5, 0.5), f.smooth_noise(0.5), f.outliers(0.003))
    C = Condition
    table = [
        C("clean", "as the model says, white noise", clean=True),
        C("clean-parts", "parts of the board, as ChArUco gives", (f.half_hidden,), clean=True),
        C("clean-narrow", "clean, f = 4 to 8 widths", (), replace(USUAL, focal=(4.0, 8.0)), clean=True),
        C("clean-few", "clean, 4 or 5 views", (), replace(USUAL, views=(4, 5)), clean=True),
        C("clean-many", "clean, 60 to 80 views", (), replace(USUAL, views=(60, 80)), clean=True),
        C("clean-never-rolled", "clean, the board upright within 3 deg", (), never, clean=True),
        C("clean-flat", "clean, the board tilted by 10 deg at most", (), replace(USUAL, tilt=(1.0, 10.0)), clean=True),
        C("blur-unequal", "views of other sharpness, 0.33 to 3 times", (f.unequal_blur,), known=True),
        C("everyday", "dots 0.03 mm, bent 0.15 mm, noise a little alike, 0.3 % outliers", everyday, known=True),
        C("heavy-tails", "Student's t of 3", (f.heavy_tails,), known=True),
        C("motion-blur", "noise up to 6 times along one direction a view", (f.motion_blur(6.0),), known=True),
        C("outliers", "2 % of points 3 to 20 px off", (f.outliers(0.02),)),
        C("shared-noise", "points of a view err alike (2 sigma, 1.5 sigma)", alike, known=True),
        C("shared-noise-few", "the same, 6 to 8 views", alike, replace(USUAL, views=(6, 8)), known=True),
        C("shared-noise-many", "the same, 60 to 80 views", alike, replace(USUAL, views=(60, 80)), known=True),
        C("shared-noise-parts", "the same, parts of the board", (f.half_hidden, *alike), known=True),
        C("smooth-noise", "a wave over the board, 1 sigma, a view", (f.smooth_noise(1.0),), known=True),
        C("dots-off", "dots printed 0.2 mm off", (f.dots_off(0.2),), known=True),
        C("dot-one-off", "one dot 1 mm off in all views", (f.one_dot_off(1.0),)),
        C("dots-off-little", "dots printed 0.05 mm off", (f.dots_off(0.05),), known=True),
        C("wobbling", "paper bent anew in each view, 0.5 mm", (f.wobbling(0.5),), known=True),
        C("board-scale", "board 4 % smaller than said", (f.larger_board(0.04),), known=True),
        C("bent-1", "board bent by 1 mm", (f.bent(1.0),)),
        C("bent-3", "board bent by 3 mm", (f.bent(3.0),)),
        C("twisted", "board twisted, corners 1 mm", (f.twisted(1.0),)),
        C("print-0.2-never", "print 0.2 % longer one way, never rolled", (f.taller(0.002),), never),
        C("pixels-never", "pixels 2 % higher than wide, the board never rolled", (f.stretched_all(0.02),), never),
        C("pixels-rolled", "pixels 2 % higher than wide, the board rolled", (f.stretched_all(0.02),), rolled),
        C("print-1-rolled", "print 1 % longer one way, rolled", (f.taller(0.01),), rolled),
        C("print-1-never", "print 1 % longer one way, never rolled", (f.taller(0.01),), never),
        C("print-4-rolled", "print 4 % longer one way, rolled", (f.taller(0.04),), rolled),
        C("print-4-never", "print 4 % longer one way, never rolled", (f.taller(0.04),), never),
        C("print-skew", "print askew by 0.5 %", (f.skewed_print(0.005),)),
        C("zoom-5", "every second view enlarged by 5 %", (f.enlarged(0.05),)),
        C("zoom-1", "every second view enlarged by 1 %", (f.enlarged(0.01),)),
        C("zoom-0.2", "every second view enlarged by 0.2 %", (f.enlarged(0.002),)),
        C("zoom-one", "one view enlarged by 20 %", (f.enlarged(0.2, which="one"),)),
        C("refocus", "lens refocused half way, 2 %", (f.refocused(0.02),)),
        C("refocus-drift", "focal length drifts by 1 % over the views", (f.refocused(0.01, drift=True),)),
        C("two-cameras", "left and right mixed", (f.two_cameras,)),
        C("cropped", "every second view cut 4 %, 3 % further", (f.cropped(0.04, 0.03),)),
        C("mirrored", "every second view mirrored", (f.mirrored,)),
        C("turned", "every second view turned by half a turn", (f.turned_half,)),
        C("stretched", "every second view stretched by 4 % in height", (f.rescaled(0.04),)),
        C("half-resolution", "every second view at half resolution", (f.halved,), known=True),
        C("rolling-3", "rolling shutter, 3 px a frame", (f.rolling_shutter(3.0),)),
        C("rolling-0.5", "rolling shutter, 0.5 px a frame", (f.rolling_shutter(0.5),)),
        C("shear-1", "shear of 1 %", (f.sheared(0.01),)),
        C("shear-0.1", "shear of 0.1 %", (f.sheared(0.001),)),
        C("pinhole", "a lens with distortion fitted as pinhole", (), model="pinhole"),
        C("fisheye", "a fisheye lens fitted as brown", (), replace(USUAL, lens="fisheye", focal=(0.5, 0.8))),
        C("division", "a lens of division type fitted as radial", (), replace(USUAL, lens="division"), model="brown"),
        C("clean-free", "clean, the board's shape asked for", shape="free", clean=True),
        C("bent-1-free", "board bent by 1 mm, its shape asked for", (f.bent(1.0),), shape="free", known=True),
        C("twisted-free", "board twisted by 1 mm, its shape asked for", (f.twisted(1.0),), shape="free", known=True),
        C(
            "dots-off-free",
            "dots 0.2 mm off, its shape asked for",
            (f.dots_off(0.2),),
            shape="free",
            known=True,
        ),
        C("bent-1-paraboloid", "bent by 1 mm, a paraboloid asked for", (f.bent(1.0),), shape="paraboloid"),
        C("bent-shared", "bent by 0.3 mm, noise shared", (f.bent(0.3), f.shared_noise(1.0, 1.0))),
    ]
    return [replace(c, name=f"intrinsics/{c.name}") for c in table]


def observed(photos: Photos, uv: Array) -> cb.Observations:
    """What a detector hands over."""
    n = len(photos.told)
    keep = np.ones(uv.shape[:2], bool) if photos.keep is None else photos.keep
    return cb.Observations.from_points(
        [photos.told[k] for k in keep],
        [u[k] for u, k in zip(uv, keep)],
        image_size=photos.size,
        ids=[f"{i:03d}.png" for i in range(len(photos))],
        point_ids=[np.arange(n)[k] for k in keep],
    )


def run(condition: Condition, seed: int) -> Run:
    """One calibration, judged by fx fy cx cy."""
    photos = draw_photos(seed, condition.draw)
    least = least_covariance(photos)
    for edit in condition.edits:
        edit(photos)
    if condition.clean:  # parts of boards
        least = least_covariance(photos)
    observations = observed(photos, photos.take())

    def estimate() -> tuple[cb.CalibrationResult, Array, Array]:
        result = cb.calibrate_intrinsics(observations, model=condition.model, target_shape=condition.shape)
        camera = result.camera
        rows = [list(camera.parameters).index(name) for name in ("fx", "fy", "cx", "cy")]
        values = np.array([list(camera.parameters.values())[i] for i in rows])
        return result, values, np.asarray(camera.covariance)[np.ix_(rows, rows)]

    return judged(seed, estimate, lambda found: [found - truth for truth in photos.truths], least)
