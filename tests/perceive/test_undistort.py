"""Undistorted pictures: the same pixels as OpenCV's, and what the maps promise for models that it does not have."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.peers import OPENCV_CONTRIB

from calibrant.cameras import MODELS, Camera, camera_model
from calibrant.errors import InputError
from calibrant.perceive.output_cameras import WIDEST_DEG, axis_camera, focal_camera, optimal_camera, pinhole
from calibrant.perceive.rectangles import Rectangle, largest_rectangle
from calibrant.perceive.undistort import NO_SOURCE, undistortion

SIZE = (320, 256)
PIXELS = {"fx": 225.0, "fy": 226.0, "cx": 161.0, "cy": 127.0}
PLANE = dict(
    zip(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty"),
        (-0.28, 0.09, 8e-4, -1.1e-3, -0.012, 0.01, 0.02, -0.005, 1e-3, -1e-3, 2e-3, 5e-4, 0.01, -0.02),
    )
)
TERMS = {
    "pinhole": {},
    **{name: dict(list(PLANE.items())[:n]) for name, n in (("brown", 5), ("rational", 8), ("thin_prism", 12))},
    "tilted": PLANE,
    "kannala_brandt": {"fx": 100.0, "fy": 101.0, "k1": -0.02, "k2": 0.004, "k3": -0.001, "k4": 2e-4},
    "unified": {"skew": 0.4, "xi": 1.2, "k1": -0.2, "k2": 0.05, "p1": 8e-4, "p2": -1.1e-3},
}
"""The models that OpenCV undistorts."""
OTHERS = {
    "double_sphere": {"fx": 150.0, "fy": 151.0, "xi": -0.2, "alpha": 0.58},
    "division": {"fx": 150.0, "fy": 151.0, "l1": -0.2},
    "extended_unified": {"fx": 150.0, "fy": 151.0, "alpha": 0.6, "beta": 1.1},
    "inverse_brown": {"k1": 0.1, "k2": 0.02, "p1": 1e-3},
}
SPLINED = "splined:16x12:150deg"
Array = np.ndarray


def camera_of(model: str) -> Camera:
    if model == SPLINED:  # a stereographic lens with small bumps
        kind = camera_model(model)
        values = kind.starting_values(130.0, np.array([161.0, 127.0]))
        values[4:] += 0.01 * np.sin(np.arange(len(values) - 4))
        return Camera(kind, SIZE, values)
    return Camera.create(model, {**PIXELS, **{**TERMS, **OTHERS}[model]}, image_size=SIZE)


def picture(kind: type, channels: int) -> Array:
    """Noise of all grey levels, so that the least difference of the maps shows."""
    rng = np.random.default_rng(81)
    shape = (SIZE[1], SIZE[0], channels) if channels > 1 else (SIZE[1], SIZE[0])
    image = rng.uniform(0, 1, shape) if kind is np.float32 else rng.integers(0, np.iinfo(kind).max, shape)
    return image.astype(kind)


OMNIDIR = """
import cv2
def answer(camera, K, xi, terms, **images):
    flags, size = cv2.omnidir.RECTIFY_PERSPECTIVE, tuple(int(n) for n in images.pop("size"))
    turned = lambda image: cv2.omnidir.undistortImage(image, camera, terms, xi, flags, None, K, size)
    return {name: turned(image) for name, image in images.items()}
"""


def opencvs(camera: Camera, images: list[Array], K: Array) -> list[Array]:
    terms = np.array(list(camera.parameters.values())[4:])
    if camera.model.name == "kannala_brandt":
        return [cv2.fisheye.undistortImage(image, camera.K, terms, None, K, SIZE) for image in images]
    if camera.model.name == "unified":
        named = {f"image{i}": image for i, image in enumerate(images)}
        given = {"camera": camera.K, "K": K, "xi": np.array([camera.parameters["xi"]]), "terms": terms[2:]}
        return list(OPENCV_CONTRIB.arrays(OMNIDIR, **given, **named, size=np.array(SIZE)).values())
    return [cv2.undistort(image, camera.K, terms, None, K) for image in images]


@pytest.mark.parametrize("model", sorted(TERMS))
@pytest.mark.parametrize("choice", [None, 0.0, 0.4, 1.0])
def test_every_pixel_is_opencvs(model: str, choice: float | None) -> None:
    camera = camera_of(model)
    output = axis_camera(camera) if choice is None else optimal_camera(camera, choice)
    turn = undistortion(camera, output)
    kinds = ((np.uint8, 1), (np.uint8, 3), (np.uint16, 3), (np.uint16, 4), (np.float32, 1))
    images = [picture(kind, channels) for kind, channels in kinds]
    for image, theirs in zip(images, opencvs(camera, images, output.K), strict=True):
        turned = turn.apply(image)
        assert turned.dtype == image.dtype
        np.testing.assert_array_equal(turned, theirs)


@pytest.mark.long
def test_any_model_to_any_model_keeps_what_is_seen() -> None:
    """A picture that is a smooth function of the ray comes out as that function of the output camera's rays."""

    def shade(camera: Camera) -> Array:
        uv = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in camera.image_size)), axis=-1)
        ray = camera.unproject(uv)
        return np.where(np.isfinite(ray[..., 0]), 0.5 + 0.4 * np.sin(9 * ray[..., 0]) * np.cos(7 * ray[..., 1]), 0.0)

    outputs = [pinhole(150.0, 150.0, 99.5, 79.5, (200, 160)), camera_of("kannala_brandt"), camera_of("double_sphere")]
    for model in ("brown", "division", "double_sphere", "inverse_brown", "extended_unified", "unified", SPLINED):
        source = camera_of(model)
        for output in outputs:
            turn = undistortion(source, output)
            inside = cv2.erode(turn.valid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
            assert inside.mean() > 0.1
            found = turn.apply(shade(source).astype(np.float32))
            # Bilinear interpolation at 1/32 px of a picture whose waves are tens of pixels long.
            assert np.abs(found - shade(output))[inside].max() < 0.02, (source.model.name, output.model.name)


def test_the_axis_camera_is_opencvs_default() -> None:
    camera = camera_of("brown")
    np.testing.assert_allclose(axis_camera(camera).K, camera.K, rtol=1e-14)
    image = picture(np.uint8, 3)
    turned = undistortion(camera, axis_camera(camera)).apply(image)
    np.testing.assert_array_equal(turned, cv2.undistort(image, camera.K, camera.values[4:]))


@pytest.mark.parametrize("model", sorted(set(MODELS) - {"orthographic"}))
def test_the_axis_camera_has_the_scale_at_the_axis(model: str) -> None:
    kind = camera_model(model)
    camera = Camera(kind, SIZE, kind.starting_values(300.0, np.array([161.0, 127.0])))
    output = axis_camera(camera)
    near = np.array([[1e-4, 0, 1], [0, 1e-4, 1]])
    # Distortion adds at most the square of 1e-4 to these steps of 0.03 px.
    np.testing.assert_allclose(output.project(near), camera.project(near), atol=1e-6)
    double = axis_camera(camera, image_size=(640, 512))
    np.testing.assert_allclose((double.project(near) + 0.5) / 2, output.project(near) + 0.5, atol=1e-9)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("size", [SIZE, (400, 300)])
def test_the_optimal_camera_is_opencvs(alpha: float, size: tuple[int, int]) -> None:
    """For a lens so mild that OpenCV's five iterations of undistortPoints arrive."""
    camera = Camera.create("brown", {**PIXELS, "k1": -0.02, "k2": 0.003, "p1": 1e-4}, image_size=SIZE)
    K, _ = cv2.getOptimalNewCameraMatrix(camera.K, camera.values[4:], SIZE, alpha, size)
    np.testing.assert_allclose(optimal_camera(camera, alpha, image_size=size).K, K, atol=2e-3)


@pytest.mark.parametrize("model", ["brown", "tilted", "kannala_brandt", "unified", "double_sphere", SPLINED])
def test_alpha_means_what_it_says(model: str) -> None:
    camera = camera_of(model)
    tight = undistortion(camera, optimal_camera(camera, 0.0))
    # OpenCV's rectangle touches 9 points a side; between them a lens bends by less than a pixel.
    assert tight.valid[1:-1, 1:-1].all()
    wide = undistortion(camera, optimal_camera(camera, 1.0))
    assert wide.valid.mean() < 1
    uv = np.stack(np.meshgrid(np.linspace(0, SIZE[0] - 1, 9), np.linspace(0, SIZE[1] - 1, 9)), axis=-1).reshape(-1, 2)
    rays = camera.unproject(uv)
    ahead = rays[:, 2] > np.cos(np.deg2rad(WIDEST_DEG))
    seen = wide.output.project(rays[ahead])
    assert np.all(seen >= -1e-6)
    assert np.all(seen <= np.array(SIZE) - 1 + 1e-6)


def test_a_mirrored_picture_beyond_the_fold_is_black() -> None:
    """k1 = -0.5 folds at r = 0.82: OpenCV shows the picture again beyond it."""
    camera = Camera.create("brown", {**PIXELS, "k1": -0.5}, image_size=SIZE)
    output = focal_camera(camera, 100.0)
    turn = undistortion(camera, output)
    x, y = np.meshgrid(np.arange(SIZE[0]) - output.parameters["cx"], np.arange(SIZE[1]) - output.parameters["cy"])
    beyond = np.hypot(x, y) / 100.0 > np.sqrt(1 / 1.5)
    assert beyond.mean() > 0.2
    image = np.full((SIZE[1], SIZE[0]), 200, np.uint8)
    assert not turn.valid[beyond].any()
    assert turn.apply(image)[beyond].max() == 0
    assert cv2.undistort(image, camera.K, camera.values[4:], None, output.K)[beyond].max() == 200


def test_maps_serve_in_other_programs() -> None:
    camera = camera_of("brown")
    turn = undistortion(camera, optimal_camera(camera, 1.0))
    image = picture(np.uint8, 1)
    u, v = (m.astype(np.float32) for m in turn.finite_maps())
    assert np.all((u == NO_SOURCE) == np.isnan(turn.map_u))
    fixed = cv2.remap(image, *cv2.convertMaps(u, v, cv2.CV_16SC2), cv2.INTER_LINEAR)
    # Maps in single precision fall on another 32nd of a pixel now and then.
    assert np.mean(fixed != turn.apply(image)) < 0.01
    # OpenCV 5 no longer rounds floating maps to 32nds of a pixel: up to 1/64 px each way on 255 grey levels a pixel.
    direct = cv2.remap(image, u, v, cv2.INTER_LINEAR)
    assert np.abs(direct.astype(int) - turn.apply(image)).max() <= 8


def test_what_cannot_be_undistorted_is_said() -> None:
    camera = camera_of("brown")
    turn = undistortion(camera, axis_camera(camera))
    with pytest.raises(InputError, match="the image is 10x20 px, the camera is for images of 320x256 px"):
        turn.apply(np.zeros((20, 10), np.uint8))
    telecentric = Camera.create("orthographic", PIXELS, image_size=SIZE)
    with pytest.raises(InputError, match="orthographic model has parallel rays"):
        undistortion(telecentric, axis_camera(camera))
    for choose in (lambda: optimal_camera(camera, -0.1), lambda: optimal_camera(camera, float("nan"))):
        with pytest.raises(InputError, match=r"alpha is .* expected 0"):
            choose()
    with pytest.raises(InputError, match="focal length is 0 px; expected one above 0"):
        focal_camera(camera, 0.0)


def brute_force(mask: Array) -> int:
    """Area of the largest rectangle of True by trying all."""
    h, w = mask.shape
    return max(
        [0]
        + [
            (b - t) * (r - left)
            for t in range(h)
            for b in range(t + 1, h + 1)
            for left in range(w)
            for r in range(left + 1, w + 1)
            if mask[t:b, left:r].all()
        ]
    )


def test_the_largest_rectangle_is_found() -> None:
    rng = np.random.default_rng(82)
    for share in (0.1, 0.5, 0.9):
        mask = rng.uniform(size=(7, 9)) < share
        x, y, w, h = largest_rectangle(mask)
        assert mask[y : y + h, x : x + w].all()
        assert w * h == brute_force(mask)
    assert largest_rectangle(np.zeros((5, 6), bool)) == Rectangle(0, 0, 0, 0)
    assert largest_rectangle(np.ones((700, 1000), bool)) == Rectangle(0, 0, 1000, 700)


def test_the_region_grows_to_the_pixel() -> None:
    """On masks larger than the search's cells the edges are still exact."""
    mask = np.zeros((611, 1003), bool)
    mask[37:590, 13:971] = True
    assert largest_rectangle(mask) == Rectangle(13, 37, 958, 553)
