"""Boxes from colour and depth: exact to a hundredth of a millimetre where noise is small, as certain as stated where it
is a D435's, and refused in words where something is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from tests.perceive.boxes_on_a_table import Thing, camera_at, d435, exact_depth, looking_down, photograph

from calibrant.cameras import Camera
from calibrant.data.devices import Picture
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import Segment, find_segments, the_one
from calibrant.perceive.object_pose import fit
from calibrant.perceive.object_pose.cubes import locate_cubes
from calibrant.perceive.object_pose.locate import locate
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.seen import Scene
from calibrant.perceive.object_pose.shapes import Shape, box
from calibrant.perceive.registered_depth.noise import OFFSET_PX, DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig

RED = ColourRange.parse("h:340-20 s:40-100 v:10-100")
CUBOID = np.array([0.054, 0.037, 0.005])
CUBE = np.array([0.04] * 3)
SMALL = (320, 240)


def placed(sides: np.ndarray, x: float, y: float, turn: float) -> Thing:
    return Thing(se3.make(so3.exp([0, 0, turn]), [x, y, sides[2] / 2]), sides)


def seen(camera: Camera, T: np.ndarray, things: list[Thing], seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    image = photograph(camera, T, things, rng)
    f_b = camera.parameters["fx"] * 0.05
    # Every camera has an offset of its disparities of its own.
    return image, d435(exact_depth(camera, T, things), rng, f_b=f_b, offset_px=rng.normal(0, OFFSET_PX))


def noise_of(camera: Camera) -> DepthNoise:
    return DepthNoise.stereo(focal_px=camera.parameters["fx"], baseline_m=0.05)


def located(camera: Camera, T: np.ndarray, thing: Thing, seed: int = 0) -> ObjectPose:
    image, z = seen(camera, T, [thing], seed)
    # The picture averages 4 x 4 samples a pixel.
    scene = Scene.of(image, z, DepthRig.aligned(camera), noise=noise_of(camera), staircase=0.25)
    return locate(scene, the_one(find_segments(image, RED)), box(thing.sides))


def squared(pose: ObjectPose, truth: np.ndarray) -> float:
    e = pose.error(truth)
    return float(e @ np.linalg.solve(pose.covariance, e))


def test_the_cuboid_from_above_where_only_its_top_is_seen() -> None:
    camera = camera_at(308.0, SMALL)
    T, thing = looking_down(0.22, turn_deg=30), placed(CUBOID, 0.02, -0.01, 0.8)
    pose = located(camera, T, thing)
    mm, deg = se3.mm_and_deg(pose.error(T @ thing.T_table_box))
    assert mm < 0.1
    assert deg < 0.15
    assert squared(pose, T @ thing.T_table_box) < chi2.ppf(0.999, 6)
    assert pose.figures["faces"] == 1
    assert len(pose.equivalents) == 4
    assert not pose.undetermined


def test_the_cuboid_from_above_in_whole_millimetres() -> None:
    """As many depth cameras store them: rounding is alike on all of the cuboid, and on all of the table."""
    camera = camera_at(308.0, SMALL)
    thing = placed(CUBOID, 0.02, -0.01, 0.8)
    squares = []
    for phase in (0.0, 0.25):
        T = looking_down(0.22 + 1e-3 * phase, turn_deg=30)
        image, z = seen(camera, T, [thing])
        z = (np.rint(z * 1000) / 1000).astype(np.float32)
        scene = Scene.of(image, z, DepthRig.aligned(camera), noise=noise_of(camera))
        pose = locate(scene, the_one(find_segments(image, RED)), box(CUBOID))
        mm, deg = se3.mm_and_deg(pose.error(T @ thing.T_table_box))
        assert mm < 0.5
        assert deg < 0.3
        assert not any("does not stand" in n for n in pose.notes)
        squares.append(squared(pose, T @ thing.T_table_box))
    assert max(squares) < chi2.ppf(0.999, 6)


def test_a_cube_seen_askew() -> None:
    camera = camera_at(308.0, SMALL)
    T, thing = looking_down(0.35, 35.0), placed(CUBE, 0.03, 0.02, 0.3)
    pose = located(camera, T, thing)
    mm, deg = se3.mm_and_deg(pose.error(T @ thing.T_table_box))
    assert mm < 0.2
    assert deg < 0.3
    assert len(pose.equivalents) == 24


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("sides", "distance", "tilt"),
    [(CUBOID, 0.22, 0.0), (CUBOID, 0.36, 20.0), (CUBOID, 0.5, 30.0), (CUBE, 0.35, 35.0), (CUBE, 0.3, 0.0)],
)
def test_poses_are_as_far_off_as_stated(sides: np.ndarray, distance: float, tilt: float) -> None:
    camera = camera_at()
    squares, errors = [], []
    for seed in range(30):
        rng = np.random.default_rng(100 + seed)
        T = looking_down(distance, tilt, rng.uniform(0, 360))
        span = 0.2 * distance
        thing = placed(sides, rng.uniform(-span, span), rng.uniform(-span, span) * 0.5, rng.uniform(0, 2 * np.pi))
        # What sRGB's curve moves edges by depends on shades: of one alone it would be the same in all trials.
        red = rng.uniform(0.2, 0.95)
        blue = red * rng.uniform(0.02, 0.14)
        pose = located(camera, T, replace(thing, colour=(blue, blue, red)), seed)
        squares.append(squared(pose, T @ thing.T_table_box))
        errors.append(se3.mm_and_deg(pose.error(T @ thing.T_table_box)))
    mm, deg = np.median(errors, axis=0)
    assert mm <= 0.5
    assert deg <= 0.3
    # 30 trials: 95 % inside are 28.5 with sigma 1.2.
    assert np.sum(np.array(squares) < chi2.ppf(0.95, 6)) >= 25
    assert 0.35 < np.mean(squares) / 6 < 1.6


def test_calibration_errors_move_the_pose_as_stated() -> None:
    """The covariance by calibration is what the pose moves by when the lens is another one."""
    camera = camera_at(308.0, SMALL)
    spread = np.diag([1.5, 1.5, 1.0, 1.0]) ** 2
    known = Camera(camera.model, camera.image_size, camera.values, spread)
    T, thing = looking_down(0.3, 20.0), placed(CUBOID, 0.02, 0.0, 0.5)
    image, z = seen(camera, T, [thing])
    segment = the_one(find_segments(image, RED))
    noise = noise_of(camera)
    poses = {
        name: locate(Scene.of(image, z, DepthRig.aligned(c), noise=noise), segment, box(CUBOID))
        for name, c in (("exact", camera), ("known", known))
    }
    more = poses["known"].covariance - poses["exact"].covariance
    assert np.linalg.eigvalsh(more).min() > -1e-12
    # One pixel of the principal point at 0.3 m is 1 mm.
    assert np.sqrt(more[3, 3]) == pytest.approx(0.3 / 308, rel=0.2)
    moved = Camera(camera.model, camera.image_size, camera.values + np.array([0, 0, 1.0, 0]))
    other = locate(Scene.of(image, z, DepthRig.aligned(moved), noise=noise), segment, box(CUBOID))
    delta = se3.local(poses["exact"].matrix, other.nearest_to(poses["exact"].matrix).matrix)
    assert delta[3] == pytest.approx(-0.3 / 308, rel=0.2)


def test_without_depth_on_the_object_its_distance_is_the_tables() -> None:
    camera = camera_at(308.0, SMALL)
    T, thing = looking_down(0.5, 10.0), placed(CUBE, 0.0, 0.02, 0.3)
    image, z = seen(camera, T, [thing])
    segment = the_one(find_segments(image, RED))
    z[segment.mask] = np.nan
    pose = locate(Scene.of(image, z, DepthRig.aligned(camera), noise=noise_of(camera)), segment, box(CUBE))
    assert any("table below" in n for n in pose.notes)
    assert squared(pose, T @ thing.T_table_box) < chi2.ppf(0.999, 6)


@pytest.mark.long
def test_what_does_not_stand_on_the_table_is_told() -> None:
    camera = camera_at(617.0)
    tilted = se3.make(so3.exp([np.deg2rad(12), 0, 0]) @ so3.exp([0, 0, 0.4]), [0, 0, 0.03])
    T = looking_down(0.3)
    pose = located(camera, T, Thing(tilted, CUBE))
    assert any("does not stand" in n for n in pose.notes)
    assert squared(pose, T @ tilted) < chi2.ppf(0.9999, 6)


def _scene(z: np.ndarray | None = None) -> tuple[Scene, Segment]:
    camera = camera_at(308.0, SMALL)
    image, depth = seen(camera, looking_down(0.3), [placed(CUBE, 0.0, 0.0, 0.2)])
    rig = DepthRig.aligned(camera)
    return Scene.of(image, depth if z is None else z, rig, noise=noise_of(camera)), the_one(find_segments(image, RED))


def test_no_depth_anywhere_near_is_refused() -> None:
    z = np.full(SMALL[::-1], np.nan)
    z[:20, :20] = 0.3
    scene, segment = _scene(z)
    with pytest.raises(RefusedError, match="no depth on the object and no table"):
        locate(scene, segment, box(CUBE))


def test_a_box_of_other_sides_is_refused() -> None:
    scene, segment = _scene()
    with pytest.raises(RefusedError, match="does not fit"):
        locate(scene, segment, box([0.12, 0.02, 0.02]))


def test_two_cubes_are_both_located_and_a_picture_without_depth_is_refused() -> None:
    camera = camera_at(308.0, SMALL)
    T = looking_down(0.35, 25.0)
    things = [placed(CUBE, -0.05, 0.0, 0.2), placed(CUBE, 0.06, 0.02, 0.9)]
    image, z = seen(camera, T, things)
    picture = Picture("0", image, 0.0, z)
    poses = locate_cubes(picture, camera, RED, side=0.04, noise=noise_of(camera))
    assert len(poses) == 2
    for pose in poses:
        off = min(float(np.linalg.norm((T @ t.T_table_box)[:3, 3] - pose.matrix[:3, 3])) for t in things)
        assert off < 3e-4
        assert pose.sigma_mm.max() < 0.5
    with pytest.raises(InputError, match="no depth"):
        locate_cubes(replace(picture, depth=None), camera, RED, side=0.04)
    with pytest.raises(RefusedError, match="nothing has the colour"):
        locate_cubes(picture, camera, ColourRange((100.0, 130.0), (40.0, 100.0)), side=0.04)


def test_without_contrast_the_segments_outline_tells_the_turn_less_well() -> None:
    scene, segment = _scene()
    shape: Shape = box(CUBE)
    grey = replace(scene, colour=np.full_like(scene.colour, 128.0))
    pose = locate(grey, segment, shape)
    assert any("no contrast" in n for n in pose.notes)
    whole = locate(scene, segment, shape)
    assert not whole.undetermined
    assert whole.sigma_deg[2] < 0.3 * pose.sigma_deg[2]
    delta = se3.local(whole.matrix, pose.nearest_to(whole.matrix).matrix)
    assert delta @ np.linalg.solve(pose.covariance, delta) < chi2.ppf(0.999, 6)


@pytest.mark.parametrize("name", ["depth", "outline", "contact", "table"])
def test_slopes_are_central_differences(name: str) -> None:
    scene, segment = _scene()
    shape = box(CUBE)
    table = scene.table(segment)
    T = locate(scene, segment, shape).matrix
    n = 7
    m = fit.Measurements(
        uv_depth=np.array([[150.0, 120.0], [160.0, 118.0]]),
        inverse=np.array([3.8, 3.9]),
        face=np.array([0, 3]),
        sigma_inverse=0.01,
        points=shape.vertices[:n],
        outward=np.tile([0.6, -0.8], (n, 1)),
        edge_uv=np.tile([150.0, 120.0], (n, 1)),
        side=np.array([0, 0, 0, 1, 1, 1, 1]),
        sigma_edge=np.full(n, 0.1),
        sigma_side=np.full(n, 0.1),
        sigma_common=0.1,
        contact=shape.vertices[:4],
        table=table,
        scale_sigma=0.01,
        rounding=0.001,
    )
    problem = fit.fit(m, shape.normals, shape.offsets, scene.rig, T, size=shape.size).problem
    k = problem.factor_index(name)
    factor = problem.factors[k]
    values = problem.gather(k, problem.start)
    r, jacobians = factor.linearize(*values)
    h = 1e-6
    for slot, J in enumerate(jacobians):
        count = J.shape[2]
        for c in range(count):
            step = np.zeros(count)
            step[c] = h
            ends = []
            for sign in (1, -1):
                moved = list(values)
                v = values[slot]
                moved[slot] = se3.retract(v, sign * step) if v.ndim == 3 else v + sign * step
                ends.append(factor.linearize(*moved)[0])
            assert J[:, :, c] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-4 * np.abs(J).max())
    assert np.isfinite(r).all()
