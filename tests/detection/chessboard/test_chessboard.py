"""The chessboard detector on rendered boards whose corners are known, on real ones, and on pictures without a board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.stats import kurtosis
from tests.detection.chessboard_pictures import Lens, Pose, corners, facing, picture

from calibrant.detection.chessboard.detector import ChessboardDetector, scales
from calibrant.detection.images.images import load_grey
from calibrant.errors import InputError
from calibrant.targets.charuco import Charuco
from calibrant.targets.chessboard import Chessboard

SIZE = (640, 480)
LENS = Lens(580.0, 318.0, 243.0, -0.2, 0.05)


def find(image, columns=9, rows=6):
    return ChessboardDetector().detect(image, Chessboard(columns, rows, 0.025))


def shot(columns=9, rows=6, *, distance=16.0, tilt=25.0, axis=40.0, roll=10.0, size=SIZE, lens=LENS, **options):
    pose = facing(columns, rows, lens, distance=distance, tilt_deg=tilt, axis_deg=axis, roll_deg=roll)
    return picture(columns, rows, pose, lens, size, **options), corners(columns, rows, pose, lens)


@pytest.mark.statistics
def test_accuracy_and_sigma_on_tilted_distorted_views():
    rng = np.random.default_rng(5)
    errors, sigmas = [], []
    for k in range(4):
        lens = Lens(1100, 640 + rng.uniform(-10, 10), 512, rng.uniform(-0.25, 0.1), 0.05)
        pose = facing(
            9,
            6,
            lens,
            distance=rng.uniform(12, 20),
            tilt_deg=18.0 * k,
            axis_deg=rng.uniform(0, 360),
            roll_deg=rng.uniform(-80, 80),
        )
        image = picture(9, 6, pose, lens, (1280, 1024), seed=k)
        found = find(image)
        assert found.point_ids.tolist() == list(range(54))
        errors.append(found.uv - corners(9, 6, pose, lens))
        sigmas.append(found.sigma_px)
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    # 0.03 px is what is asked of detection; the fit reaches about half, so a broken term of the model shows.
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.02
    assert 0.8 < np.mean((error / sigma[:, None]) ** 2) < 1.25
    # Gaussian errors have an excess kurtosis of 0 +- 0.24 in 432 values; gross errors show as tens.
    assert kurtosis((error / sigma[:, None]).ravel()) < 2


@pytest.mark.parametrize("roll", [0, 60, 120, 180, 240, 300])
def test_numbering_follows_the_board_through_a_full_turn(roll):
    image, true = shot(roll=roll)
    found = find(image)
    assert len(found.uv) == 54
    assert np.abs(found.uv - true).max() < 0.2
    assert found.notes == ()


def test_spec_turned_by_90_degrees_numbers_along_the_other_side():
    image, _ = shot()
    grid = find(image, 6, 9).uv.reshape(9, 6, 2)
    x, y = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    assert x[0] * y[1] - x[1] * y[0] > 0  # right-handed: never mirrored
    assert np.linalg.norm(y) > np.linalg.norm(x)


@pytest.mark.parametrize(("columns", "rows", "turn"), [(9, 7, 180), (7, 7, 180), (6, 6, 90), (8, 6, 180)])
def test_equal_parity_is_said_and_numbered_to_the_lower_right(columns, rows, turn):
    for roll in (-20, 160):
        image, _ = shot(columns, rows, roll=roll)
        found = find(image, columns, rows)
        grid = found.uv.reshape(rows, columns, 2)
        x, y = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        assert x[0] > 0
        assert y[1] > 0
        assert f"turned by {turn}°" in found.notes[0]


@pytest.mark.parametrize("asked", [(8, 6), (9, 5), (7, 5), (10, 6), (9, 7)])
def test_wrong_size_is_refused_with_the_real_one(asked):
    image, _ = shot()
    found = find(image, *asked)
    assert not found.found
    assert found.looks_like == "9x6 inner corners"
    assert found.reason == f"the image looks like 9x6 inner corners, you asked for {asked[0]}x{asked[1]}"


@pytest.mark.parametrize(
    ("columns", "rows", "options"),
    [
        (9, 6, {"size": (320, 240), "lens": Lens(290, 160, 120, -0.2)}),
        (20, 15, {"size": (640, 480), "distance": 30, "tilt": 15}),
        (3, 3, {"distance": 8}),
        (9, 6, {"blur": 4.0, "distance": 12}),
        (9, 6, {"noise": 20.0}),
        (9, 6, {"dark": 3.0, "light": 18.0, "backdrop": 8.0, "noise": 1.0}),
        (9, 6, {"dark": 120.0, "light": 400.0, "backdrop": 200.0}),
        (9, 6, {"tilt": 68, "distance": 14}),
    ],
    ids=["small", "many", "few", "blurred", "noisy", "dark", "overexposed", "tilted"],
)
def test_hard_pictures(columns, rows, options):
    image, true = shot(columns, rows, **options)
    found = find(image, columns, rows)
    assert len(found.uv) >= 0.95 * columns * rows
    error = np.abs(found.uv - true[found.point_ids])
    # Five of the stated deviations, over some hundred values, with 0.05 px for clipped light.
    assert np.all(error < 5 * found.sigma_px[:, None] + 0.05)


def test_board_in_large_image_with_a_shadow_over_half_of_it():
    h, w = 720, 1280
    image, true = shot(size=(w, h), lens=Lens(1150, 640, 360, -0.2))
    shadow = np.where(np.arange(w) + 0.3 * np.arange(h)[:, None] < 0.6 * w, 1.0, 0.15)
    found = find((image * shadow).astype(np.uint8))
    # A corner on the edge of the shadow may be lost.
    assert len(found.uv) >= 50
    assert np.median(np.abs(found.uv - true[found.point_ids])) < 0.05


def test_no_board_in_textures_tiles_and_keyboards():
    rng = np.random.default_rng(11)
    pictures = [cv2.GaussianBlur(rng.integers(0, 255, (480, 640)).astype(np.uint8), (0, 0), s) for s in (0.8, 2, 5)]
    for side in (12, 33):
        tiles = rng.integers(40, 220, (480 // side + 1, 640 // side + 1)).astype(np.uint8)
        pictures.append(cv2.GaussianBlur(np.kron(tiles, np.ones((side, side), np.uint8))[:480, :640], (0, 0), 0.8))
        keys = np.full((480, 640), 60, np.uint8)
        for y in range(0, 480, side):
            for x in range(0, 640, side):
                cv2.rectangle(keys, (x, y), (x + side - 5, y + side - 5), 200, -1)
        pictures.append(keys)
    for tilt in (0, 30):
        floor = facing(24, 24, LENS, distance=12, tilt_deg=tilt, axis_deg=15, roll_deg=20)
        pictures.append(picture(24, 24, floor, LENS, SIZE))
    for image in pictures:
        found = find(image)
        assert not found.found
        assert found.reason


def test_of_two_boards_the_larger_in_the_picture():
    near, true = shot(distance=18)
    small = cv2.resize(shot(distance=14, tilt=0, roll=0)[0], (140, 105), interpolation=cv2.INTER_AREA)
    near[:105, :140] = small
    found = find(near)
    assert np.abs(found.uv - true).max() < 0.3


def test_blank_tiny_and_foreign_input():
    for shape in ((480, 640), (5, 5), (1, 1), (3, 2000)):
        assert find(np.full(shape, 128, np.uint8)).reason == "no chessboard of 9x6 inner corners was found"
    with pytest.raises(InputError, match="charuco"):
        ChessboardDetector().detect(np.zeros((9, 9), np.uint8), Charuco(5, 7, 0.04, 0.02, "DICT_6X6_250"))


def test_scales_start_small_and_end_with_all():
    assert scales(640, 480) == [1, 2, 4]
    assert scales(1920, 1080) == [3, 2, 1, 6]
    assert scales(4000, 3000)[0] == 5
    assert 1 in scales(4000, 3000)


def shifted(columns, rows, *shift, distance=9.0, tilt=0.0, roll=0.0, seed=0, **options):
    """A board moved by so many squares, partly out of the image, and all its corners."""
    board = facing(columns, rows, LENS, distance=distance, tilt_deg=tilt, axis_deg=40, roll_deg=roll)
    pose = Pose(board.rotation, tuple(np.add(board.translation, (*shift, 0))))
    return picture(columns, rows, pose, LENS, SIZE, seed=seed, **options), corners(columns, rows, pose, LENS)


@pytest.mark.parametrize("roll", [0, 90, 180, 270])
def test_a_part_of_a_board_is_numbered_where_its_ends_are_seen(roll):
    # Upright, two columns or three rows are cut off; on its side, two columns.
    shifts = [(3.0, 0.0), (0.0, 3.5)] if roll % 180 == 0 else [(0.0, 2.5)]
    for shift in (*shifts, *np.negative(shifts)):
        image, true = shifted(9, 6, *shift, distance=10.5, roll=roll, tilt=10)
        inside = np.all((true > 9) & (true < np.array(SIZE) - 10), axis=1)
        assert 24 <= inside.sum() < 54, (shift, inside.sum())
        found = find(image)
        assert found.found, (shift, found.reason)
        assert np.abs(found.uv - true[found.point_ids]).max() < 0.5
        assert len(found.uv) >= 0.7 * inside.sum()


@pytest.mark.long
def test_no_part_of_a_board_is_numbered_wrongly():
    rng = np.random.default_rng(3)
    numbered = 0
    for k in range(12):
        image, true = shifted(
            9, 6, rng.uniform(-5, 5), rng.uniform(-4, 4), distance=rng.uniform(8, 12), tilt=rng.uniform(0, 40),
            roll=rng.uniform(-180, 180), seed=k, noise=rng.uniform(0, 6), margin=rng.choice([0.3, 1.0]),
        )  # fmt: skip
        found = find(image)
        if found.found:
            numbered += 1
            assert np.abs(found.uv - true[found.point_ids]).max() < 2.0
    assert numbered >= 4


def test_a_part_whose_place_cannot_be_known_is_refused_with_the_reason():
    # Left, right and lower end outside: all rows might be seen, but no column is known.
    image, _ = shifted(20, 7, 0.0, 0.0, distance=10)
    assert "its ends are seen on too few sides" in find(image, 20, 7).reason
    # Five columns and five rows at one corner of a board of 9x6: it may be either of two corners.
    image, _ = shifted(9, 6, 3.9, 1.6, distance=8.6)
    assert "cannot be told apart" in find(image).reason
    # Without paper around it, a board does not show where it ends.
    image, _ = shifted(9, 6, 4.5, 0.0, margin=0.0, backdrop=20.0)
    assert "its ends are seen on too few sides" in find(image).reason


@pytest.mark.parametrize(("side", "rms"), [("left", 0.26), ("right", 0.25)])
def test_every_board_of_the_stereo_set_and_its_calibration(shared_data, side, rms):
    target = Chessboard(9, 6, 0.025)
    files = sorted(shared_data("opencv_stereo_9x6").glob(f"{side}*.jpg"))
    views = [ChessboardDetector().detect(load_grey(f), target) for f in files]
    assert [len(v.uv) for v in views] == [54] * 13
    points = [target.points.astype(np.float32)] * 13
    uv = [v.uv.astype(np.float32) for v in views]
    assert cv2.calibrateCamera(points, uv, (640, 480), None, None)[0] < rms


def test_both_cameras_number_the_board_from_the_same_end(shared_data):
    folder = shared_data("opencv_stereo_9x6")
    for left in sorted(folder.glob("left*.jpg")):
        x_axes = []
        for file in (left, folder / left.name.replace("left", "right")):
            uv = find(load_grey(file)).uv
            x_axes.append((uv[8] - uv[0]) / np.linalg.norm(uv[8] - uv[0]))
        # The cameras look almost the same way: the board's x axis points the same way in both pictures.
        assert x_axes[0] @ x_axes[1] > 0.9


def test_every_board_of_the_projector_set(shared_data):
    files = sorted(shared_data("procam_kamino_graycode").glob("*/graycode_40.jpg"))
    assert len(files) == 5
    for file in files:
        assert len(find(load_grey(file), 9, 7).uv) == 63


def drawn(columns, rows, side, *, margin, dark=0, light=255):
    """A board without a camera, and its corners: squares of whole pixels, a margin of so many squares of paper."""
    squares = np.where(np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2, light, dark).astype(np.uint8)
    around = round(margin * side)
    image = np.pad(np.kron(squares, np.ones((side, side), np.uint8)), around, constant_values=light)
    x, y = np.meshgrid(np.arange(1, columns + 1), np.arange(1, rows + 1))
    return image, np.stack([x.ravel(), y.ravel()], axis=1) * side + around - 0.5


@pytest.mark.parametrize("side", [8, 20, 40, 100])
@pytest.mark.parametrize(("columns", "rows", "margin"), [(9, 6, 0.3), (7, 7, 1.0), (5, 4, 2.0), (3, 3, 0.5)])
def test_boards_drawn_by_a_program(columns, rows, margin, side):
    # Every corner lies between four pixels that are equal to the last bit, and there is no noise to tell them apart.
    for blur, dark, light, turn in ((0.0, 0, 255, 0), (0.5, 100, 140, 1), (0.7, 40, 200, 0), (2.0, 0, 255, 2)):
        image, true = drawn(columns, rows, side, margin=margin, dark=dark, light=light)
        image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
        image = np.ascontiguousarray(np.rot90(image, turn))
        found = find(image, columns, rows) if turn != 1 else find(image, rows, columns)
        assert found.point_ids.tolist() == list(range(columns * rows)), (blur, turn, found.reason)
        if turn == 0:
            # 8 bits round each grey level by up to a half; blur of 2 px over squares of 8 px reaches the next corner.
            assert np.abs(np.sort(found.uv, axis=0) - np.sort(true, axis=0)).max() < 0.02
        assert found.sigma_px is not None
        assert np.all((found.sigma_px > 1e-4) & (found.sigma_px < 0.2))


def test_sharp_edges_on_pixels_do_not_pass_for_unknown():
    # Each edge lies in one column of pixels here, which knows its distance over its blur alone.
    image, _ = drawn(6, 9, 40, margin=1.0)
    turn = cv2.getRotationMatrix2D((180.0, 240.0), 1.0, 0.75)
    found = find(cv2.warpAffine(image, turn, image.shape[::-1], flags=cv2.INTER_AREA, borderValue=255), 6, 9)
    assert len(found.uv) == 54
    assert found.sigma_px.max() < 0.2
