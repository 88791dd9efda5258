"""From files to observations: what goes wrong with one image, or with all, is said."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from tests.detection.chessboard_pictures import Lens, facing, picture

from calibrant.cameras import Camera
from calibrant.detection import detect
from calibrant.detection.chessboard.patterned import squares_hold_patterns
from calibrant.detection.images.overlay import draw
from calibrant.detection.registry import detector_for
from calibrant.detection.tags.grid_seen import aprilgrid_seen
from calibrant.errors import DetectionError, InputError
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.registry import parse_target

TARGET = Chessboard(9, 6, 0.025)
LENS = Lens(290.0, 160.0, 120.0)


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boards")
    for k in range(3):
        pose = facing(9, 6, LENS, distance=15, tilt_deg=10 * k, axis_deg=30, roll_deg=5)
        cv2.imwrite(str(folder / f"{8 + k}.png"), picture(9, 6, pose, LENS, (320, 240), seed=k))
    return folder


def test_views_carry_ids_points_and_sigma(boards):
    calls = []
    found = detect(boards, target=TARGET, progress=lambda *a: calls.append(a))
    assert [v.id for v in found.views] == ["8.png", "9.png", "10.png"]
    assert calls == [(1, 3, "8.png"), (2, 3, "9.png"), (3, 3, "10.png")]
    assert found.image_sizes == {"camera": (320, 240)}
    assert found.target == "chessboard:9x6:25mm"
    view = found.views[0]
    assert np.allclose(view.points, TARGET.points)
    assert view.sigma_px is not None
    assert view.file == str(boards / "8.png")


def test_any_executor_and_processes_give_the_same(boards):
    alone = detect(boards, target=TARGET)
    with ThreadPoolExecutor(2) as executor:
        threads = detect(boards, target=TARGET, workers=executor)
    processes = detect(boards, target=TARGET, workers=2)
    for other in (threads, processes):
        assert all(np.array_equal(a.uv, b.uv) for a, b in zip(alone.views, other.views, strict=True))
    with pytest.raises(InputError, match="workers must be at least 1"):
        detect(boards, target=TARGET, workers=0)


def test_a_bad_image_costs_itself_alone(boards, tmp_path):
    broken, blank = tmp_path / "broken.png", tmp_path / "blank.png"
    broken.write_bytes(b"nothing")
    cv2.imwrite(str(blank), np.full((240, 320), 99, np.uint8))
    found = detect([boards, broken, blank], target=TARGET)
    assert len(found.views) == 3
    assert {m.id: m.reason for m in found.missed} == {
        "broken.png": f"{broken} is not an image that can be read (its 7 bytes are damaged or another format)",
        "blank.png": "no chessboard of 9x6 inner corners was found",
    }


def test_a_copy_counts_once_and_is_named(boards, tmp_path):
    """Noise makes two photos differ: one that is equal byte by byte is no second measurement."""
    copy = tmp_path / "again.png"
    copy.write_bytes((boards / "9.png").read_bytes())
    calls = []
    found = detect([boards, copy], target=TARGET, progress=lambda *a: calls.append(a))
    assert [v.id for v in found.views] == ["8.png", "9.png", "10.png"]
    assert [(m.id, m.reason) for m in found.missed] == [
        ("again.png", "the same picture as 9.png, byte by byte: it counts once")
    ]
    assert [n for n in found.notes if "copy" in n] == [
        "1 picture is a copy of another, byte by byte, which counts once: again.png (of 9.png)."
    ]
    assert len(calls) == 3


def test_circles_asked_of_a_chessboard_are_answered_at_once(boards):
    """Squares are spots in a lattice, which some grid of circles fits: the board itself is what is seen."""
    with pytest.raises(DetectionError) as error:
        detect(boards, target="circles:7x11:20mm:asymmetric")
    assert str(error.value) == (
        "0 of 3 boards found; the images look like a chessboard (or ChArUco board) of 9x6 inner corners, you asked for "
        "circles:7x11:20mm:asymmetric"
    )


@pytest.mark.parametrize("family", ["36h11", "25h9"])
@pytest.mark.parametrize(
    "asked",
    [
        "circles:9x7:30mm",
        "circles:7x11:20mm:asymmetric",
        "chessboard:9x6:25mm",
        "chessboard:8x6:25mm",  # as many as the inner corners where tags and small squares meet
    ],
)
def test_an_aprilgrid_is_named(family, asked):
    """Its tags and small squares are spots of a lattice and meet in corners of a grid: neither is what is seen."""
    grid = parse_target(f"aprilgrid:5x4:35mm:0.3:{family}")
    camera = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
    rng = np.random.default_rng(1)
    T = look_at_board(camera, grid.points, 1, rng=rng, distance=(0.3, 0.5))[0]
    grey = render(grid.artwork(), camera, T, rng=rng, look=Look(clutter=0, noise_grey=2.0))
    found = detector_for(parse_target(asked).kind).detect(grey, parse_target(asked))
    seen = f"an AprilGrid with tags of DICT_APRILTAG_{family}"
    assert found.reason == f"the image looks like {seen}, you asked for {asked}"
    assert found.another


def test_the_squares_of_a_chessboard_are_plain():
    """And those of the same picture with something drawn in them are not: tags are only looked for there."""
    pose = facing(9, 6, LENS, distance=15, tilt_deg=10, axis_deg=30, roll_deg=5)
    grey = picture(9, 6, pose, LENS, (320, 240), seed=1)
    found = detector_for("chessboard").detect(grey, TARGET)
    assert found.found
    assert not squares_hold_patterns(grey, found, TARGET)
    drawn = grey.copy()
    corners = found.uv[np.argsort(found.point_ids)].reshape(6, 9, 2)
    for row in range(5):
        for column in range(row % 2, 8, 2):  # the dark ones
            u, v = corners[row : row + 2, column : column + 2].mean(axis=(0, 1)).round().astype(int)
            drawn[v - 2 : v + 3, u - 2 : u + 3] = 255
    assert squares_hold_patterns(drawn, found, TARGET)


def test_a_charuco_board_of_the_same_tags_is_no_aprilgrid():
    board = parse_target("charuco:6x5:30mm:24mm:DICT_APRILTAG_36h11")
    camera = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
    rng = np.random.default_rng(1)
    T = look_at_board(camera, board.points, 1, rng=rng, distance=(0.3, 0.4))[0]
    grey = render(board.artwork(), camera, T, rng=rng, look=Look(clutter=0, noise_grey=2.0))
    assert aprilgrid_seen(grey) is None


def test_wrong_spec_is_answered_with_the_real_size(boards):
    with pytest.raises(DetectionError) as error:
        detect(boards, target=Chessboard(8, 6, 0.025))
    assert str(error.value) == "0 of 3 boards found; the images look like 9x6 inner corners, you asked for 8x6"
    assert error.value.exit_status == 2


def test_another_dictionary_is_answered_with_the_whole_spec(tmp_path):
    board = cv2.aruco.CharucoBoard((5, 4), 0.04, 0.03, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_50))
    for k in range(2):
        cv2.imwrite(
            str(tmp_path / f"{k}.png"), cv2.copyMakeBorder(board.generateImage((500, 400)), *[60] * 4, 0, value=255)
        )
    with pytest.raises(DetectionError) as error:
        detect(tmp_path, target="charuco:5x4:40mm:30mm:DICT_5X5_50")
    assert str(error.value) == (
        "0 of 2 boards found; the images look like a ChArUco board with DICT_6X6_50, "
        "you asked for charuco:5x4:40mm:30mm:DICT_5X5_50"
    )


def test_no_board_at_all_and_nothing_readable(tmp_path):
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((240, 320), 99, np.uint8))
    with pytest.raises(DetectionError, match="0 of 2 boards found; every image: no chessboard of 9x6"):
        detect(tmp_path, target=TARGET)
    for k in range(2):
        (tmp_path / f"{k}.png").write_bytes(b"x")
    with pytest.raises(InputError, match="none of 2 images can be read"):
        detect(tmp_path, target=TARGET)


def test_files_of_one_name_in_two_folders_keep_their_folder(boards, tmp_path):
    (tmp_path / "8.png").write_bytes((boards / "9.png").read_bytes())
    found = detect([boards / "8.png", tmp_path / "8.png"], target=TARGET)
    assert [v.id for v in found.views] == [f"{boards.name}/8.png", f"{tmp_path.name}/8.png"]


def test_mirror_x_flips_the_image_first(boards, tmp_path):
    image = cv2.imread(str(boards / "8.png"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(tmp_path / "8.png"), image[:, ::-1])
    upright = detect(boards / "8.png", target=TARGET).views[0]
    mirrored = detect(tmp_path / "8.png", target=TARGET, mirror_x=True).views[0]
    assert np.array_equal(upright.uv, mirrored.uv)


def test_overlay_draws_over_a_copy(boards):
    view = detect(boards / "8.png", target=TARGET).views[0]
    image = cv2.imread(str(boards / "8.png"), cv2.IMREAD_GRAYSCALE)
    before = image.copy()
    drawn = draw(image, view)
    assert np.array_equal(image, before)
    assert drawn.shape == (*image.shape, 3)
    # Axes and points are the only colour: they lie where the board is.
    coloured = np.argwhere(np.ptp(drawn.astype(int), axis=2) > 30)[:, ::-1]
    low, high = view.uv.min(axis=0) - 25, view.uv.max(axis=0) + 25
    assert len(coloured) > 200
    assert np.all((coloured >= low) & (coloured <= high))


def test_the_stereo_set_told_the_wrong_size(shared_data):
    with pytest.raises(DetectionError) as error:
        detect(shared_data("opencv_stereo_9x6") / "left*.jpg", target=Chessboard(8, 6, 0.025))
    assert str(error.value) == "0 of 13 boards found; the images look like 9x6 inner corners, you asked for 8x6"


def test_an_image_of_another_size_is_left_out_by_name(boards, tmp_path):
    foreign = tmp_path / "phone.png"
    cv2.imwrite(str(foreign), cv2.resize(cv2.imread(str(boards / "8.png"), 0), (640, 480)))
    found = detect([foreign, boards], target=TARGET)
    assert [v.id for v in found.views] == ["8.png", "9.png", "10.png"]
    assert found.image_sizes == {"camera": (320, 240)}
    assert {m.id: m.reason for m in found.missed} == {
        "phone.png": "the image is 640x480, most are 320x240; one camera takes images of one size"
    }
    with pytest.raises(InputError, match=r"images of 2 sizes: phone\.png is 640x480, 8\.png is 320x240"):
        detect([foreign, boards / "8.png"], target=TARGET)


def test_a_phone_s_heic_is_named_with_its_cure(boards, tmp_path):
    # The first box of a file as phones write them; nothing of it can be decoded.
    (tmp_path / "IMG_1.HEIC").write_bytes(b"\x00\x00\x00\x1cftypheic\x00\x00\x00\x00mif1heicmiaf" + bytes(64))
    for file in boards.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (missed,) = detect(tmp_path, target=TARGET).missed
    assert missed.id == "IMG_1.HEIC"
    assert "HEIC" in missed.reason or "cannot be decoded" in missed.reason
