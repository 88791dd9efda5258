"""When each picture of several cameras was taken, from a table: cameras and pictures by name, by number, by rank."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from calibrant.detection.images.files import expand_together
from calibrant.errors import InputError
from calibrant.tasks.inputs.picture_times import PictureTimes, read_picture_times

LATE = {"left": 0.0, "right": 0.012}
"""Seconds after the moment."""


def photos(cameras: Sequence[str], numbers: Sequence[int] = range(4)) -> dict[str, list[Path]]:
    return {camera: [Path(camera) / f"{n:04d}.png" for n in numbers] for camera in cameras}


def read(tmp_path: Path, header: str, rows: Sequence[str], lists: dict[str, list[Path]]) -> PictureTimes:
    (tmp_path / "times.csv").write_text("\n".join((header, *rows)) + "\n")
    return read_picture_times(tmp_path / "times.csv", lists)


def seconds(found: PictureTimes) -> dict[str, list[float]]:
    return {camera: [t for _, t in sorted(told.items())] for camera, told in found.seconds.items()}


@pytest.mark.parametrize(
    "header", ["camera,image,time", "CAM, File ,TimeStamp", "cam_id,Moment,t", "camera_id,frame,frame_time"]
)
@pytest.mark.parametrize("called", ["{n:04d}.png", "{c}/{n:04d}.png", "{n:04d}", "{n}", "{n}.0"])
def test_columns_and_pictures_by_any_of_their_names(tmp_path: Path, header: str, called: str) -> None:
    rows = [f"{c},{called.format(c=c, n=n)},{1.7e9 + 0.1 * n + late}" for n in (3, 1, 2, 0) for c, late in LATE.items()]
    found = seconds(read(tmp_path, header, rows, photos(["left", "right"])))
    assert found["left"] == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-6)
    assert found["right"] == pytest.approx([0.012, 0.112, 0.212, 0.312], abs=1e-6)


def test_cameras_by_the_numbers_in_their_names_else_in_the_order_given(tmp_path: Path) -> None:
    rows = [f"{c},{n},{n + 0.1 * c}" for n in range(4) for c in (7, 0)]
    by_name = read(tmp_path, "cam_id,frame,time", rows, photos(["cam7", "cam_0"]))
    assert [t[0] for t in seconds(by_name).values()] == pytest.approx([0.7, 0.0])
    assert "cameras by the number in their names" in by_name.words
    by_order = read(tmp_path, "cam_id,frame,time", rows, photos(["top", "left"]))
    assert [t[0] for t in seconds(by_order).values()] == pytest.approx([0.0, 0.7])
    assert "0 is top, 7 is left" in by_order.words


def test_a_table_that_counts_from_elsewhere_goes_by_rank(tmp_path: Path) -> None:
    rows = [f"{c},{n + 26},{n / 6 + late}" for n in (2, 0, 3, 1) for c, late in LATE.items()]
    found = read(tmp_path, "camera,sync_index,time", rows, photos(["left", "right"]))
    assert seconds(found)["right"] == pytest.approx([n / 6 + 0.012 for n in range(4)])
    assert "pictures by number, by rank where they begin elsewhere: 26 is picture 0 of left, right" in found.words


def test_pictures_without_a_time_are_named(tmp_path: Path) -> None:
    lists = photos(["left", "right"])
    rows = [f"{c},{n},{n}" for c, most in (("left", 2), ("right", 5)) for n in range(most)]
    found = read(tmp_path, "camera,frame,t", rows, lists)
    with pytest.raises(InputError, match=r"no time of 0002[.]png, 0003[.]png of camera left \("):
        found.by_moment({c: {f: f.stem for f in files} for c, files in lists.items()})
    assert len(found.by_moment({c: {f: f.stem for f in files[:2]} for c, files in lists.items()})["left"]) == 2


def test_the_times_of_moments_are_those_of_each_picture(tmp_path: Path) -> None:
    lists = photos(["left", "right"])
    rows = [f"{c},{n},{n + late}" for n in range(4) for c, late in LATE.items()]
    moments = {c: {f: f"m{f.stem}" for f in files[1:]} for c, files in lists.items()}
    times = read(tmp_path, "camera,frame,t", rows, lists).by_moment(moments)
    assert list(times["left"]) == ["m0001", "m0002", "m0003"]
    assert list(times["right"].values()) == pytest.approx([1.012, 2.012, 3.012])


def test_photos_of_one_name_in_several_folders_are_told_by_them(tmp_path: Path) -> None:
    lists = {c: [Path(day) / c / "a.png" for day in ("mon", "tue")] for c in LATE}
    rows = [f"{c},{day}/{c}/a.png,{k}" for c in LATE for k, day in enumerate(("mon", "tue"))]
    assert seconds(read(tmp_path, "camera,file,t", rows, lists))["left"] == [0.0, 1.0]
    with pytest.raises(InputError, match=r"times.csv:2: a.png may be mon/left/a.png, tue/left/a.png"):
        read(tmp_path, "camera,file,t", ["left,a.png,0", "right,a.png,0"], lists)


@pytest.mark.parametrize(
    ("header", "rows", "message"),
    [
        ("camera,frame,when", ["left,0,0"], r"no column says the time \(time, frame_time, timestamp, t\)"),
        ("camera,frame,time", [], "header stands alone"),
        ("camera,frame,time", ["left,0,soon"], r"times.csv:2: the time is 'soon'; expected seconds"),
        ("camera,frame,time", ["left,0,0", "left,1,"], r"times.csv:3: the time is ''"),
        ("camera,frame,time", ["left,0,inf"], "finite number"),
        ("camera,frame,time", ["left,0,1403636579763555584"], "is no seconds since 1970"),
        ("camera,frame,time", ["left,,0"], "the row has no picture"),
        ("camera,frame,time", ["left,0,0", "left,0,1", "right,0,0"], "csv:3: picture 0 of .* has a time already, 0 s"),
        ("camera,frame,time", ["left,0,0", "rigth,0,0"], "no rows of camera right .*it has rows of left, rigth"),
        ("camera,frame,time", ["1,0,0", "2,0,0", "3,0,0"], "rows of 3 cameras, 1, 2, 3, for 2 that have no number"),
    ],
)  # fmt: skip
def test_what_a_table_lacks_is_named(tmp_path: Path, header: str, rows: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, header, rows, photos(["left", "right"]))


def test_pictures_by_number_need_numbers(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x.png has none; write file names"):
        read(tmp_path, "cam,frame,t", ["left,0,0", "right,0,0"], {c: [Path(c) / "x.png"] for c in LATE})
    with pytest.raises(InputError, match="two of a camera have the same"):
        read(tmp_path, "cam,frame,t", ["left,0,0", "right,0,0"], {c: [Path("a/0.png"), Path("b/0.png")] for c in LATE})


@pytest.mark.parametrize(("late", "refused"), [(0.09, False), (-0.09, False), (0.11, True), (-5.0, True)])
def test_clocks_that_began_at_other_times_are_refused(tmp_path: Path, late: float, refused: bool) -> None:
    lists = photos(["left", "right"])
    rows = [f"{c},{n},{0.1 * n + (late if c == 'right' else 0.0)}" for n in range(4) for c in lists]
    found = read(tmp_path, "camera,frame,t", rows, lists)
    moments = {c: {f: f.stem for f in files} for c, files in lists.items()}
    if refused:
        with pytest.raises(InputError, match=f"pictures of right are {abs(late):g} s .* those of left, .* 0.1 s apart"):
            found.by_moment(moments)
    else:
        assert found.by_moment(moments).keys() == lists.keys()


def test_rows_of_other_cameras_are_said(tmp_path: Path) -> None:
    rows = [f"{c},{n},{n}" for c in ("left", "right", "top") for n in range(4)]
    with pytest.warns(UserWarning, match="not used: rows of camera top"):
        read(tmp_path, "camera,frame,t", rows, photos(["left", "right"]))


@pytest.mark.parametrize(("session", "first"), [("charuco_calibration", 26), ("post_optimization", 35)])
def test_the_times_of_four_webcams(session: str, first: int, shared_data: Callable[[str], Path]) -> None:
    """caliscope's tables, whose videos are cut from longer recordings."""
    folder = shared_data("multicam_caliscope_charuco") / session / "calibration/extrinsic"
    cameras = [f"cam_{c}" for c in range(4)]
    files = expand_together([(str(folder / f"{camera}.mp4"),) for camera in cameras])
    found = read_picture_times(folder / "timestamps.csv", dict(zip(cameras, files)))
    assert f"by rank where they begin elsewhere: {first} is picture 0 of cam_0, cam_1, cam_2, cam_3" in found.words
    with (folder / "timestamps.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    start = min(float(row["frame_time"]) for row in rows)
    for camera, of_camera in zip(cameras, files):
        for row in (row for row in rows if camera == f"cam_{row['cam_id']}"):
            file = of_camera[int(row["sync_index"]) - first]
            assert found.seconds[camera][file] == pytest.approx(float(row["frame_time"]) - start, abs=1e-9)
    assert sum(map(len, found.seconds.values())) == len(rows)
