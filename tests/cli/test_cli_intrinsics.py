"""`calibrant intrinsics` as a person uses it: what it prints and writes, and what it says of bad input."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

import calibrant as cb

TARGET = "chessboard:7x6:30mm"


def refused(outcome, status: int, *words: str) -> None:
    """One message for a person on standard error, nothing on standard output, and the status promised."""
    assert outcome.status == status, outcome.err
    said = (
        json.loads(outcome.out)["error"]["message"] if outcome.out else outcome.err.strip().removeprefix("calibrant: ")
    )
    assert outcome.err == f"calibrant: {said}\n"
    assert outcome.err.count("\n") == 1
    assert "Traceback" not in outcome.err
    assert "internal error" not in outcome.err
    for word in words:
        assert word in outcome.err


def test_photos_to_camera_report_and_opencv_file(calibrant, cell, tmp_path: Path, untouched) -> None:
    outcome = calibrant(
        "intrinsics", cell.images, "--target", TARGET,
        "--out", tmp_path / "camera.json", "--report", tmp_path / "camera.html",
    )  # fmt: skip
    assert (outcome.status, outcome.err) == (0, "")
    assert "± 1σ" in outcome.out
    assert "± 3σ" in outcome.out
    assert "Views: 8 of 8 used" in outcome.out
    assert outcome.out.rstrip().endswith("camera.html")  # it says what it wrote
    result = cb.read(tmp_path / "camera.json")
    for name, true in cell.camera.parameters.items():
        # 4 sigma: P(any of nine beyond) is 6e-4, and the render adds no error of its own above 0.005 px.
        assert abs(result.camera.parameters[name] - true) < 4 * result.camera.sigma[name] + 1e-9
    assert {Path(i["file"]).name for i in result.inputs} == {f"{i:02d}.png" for i in range(8)}
    storage = cv2.FileStorage(str(tmp_path / "Intr.yml"), cv2.FILE_STORAGE_READ)
    K = storage.getNode("camera_matrix").mat()
    assert K[0, 0] == pytest.approx(result.camera.parameters["fx"], abs=1e-9)
    assert "<html" in (tmp_path / "camera.html").read_text().lower()
    untouched()


def test_a_second_camera_in_the_folder_keeps_the_first_ones_opencv_file(calibrant, found: Path, tmp_path: Path) -> None:
    for name in ("left.json", "right.json"):
        outcome = calibrant("intrinsics", "--observations", found, "--out", tmp_path / name)
        assert (outcome.status, outcome.err) == (0, "")
    assert "right-Intr.yml" in outcome.out
    first = (tmp_path / "Intr.yml").stat().st_mtime_ns
    again = calibrant("intrinsics", "--observations", found, "--out", tmp_path / "right.json", "--force", "-q")
    assert again.status == 0
    # Replacing the second camera's files leaves those of the first.
    assert (tmp_path / "Intr.yml").stat().st_mtime_ns == first
    assert sorted(p.name for p in tmp_path.glob("*.yml")) == ["Intr.yml", "right-Intr.yml"]


def test_json_alone_on_standard_output(calibrant, found: Path) -> None:
    outcome = calibrant("intrinsics", "--observations", found, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    assert json.loads(outcome.out)["format"] == "calibrant/2"


def test_the_solver_stops_where_it_is_told_to(calibrant, found: Path) -> None:
    early = calibrant("intrinsics", "--observations", found, "--max-iterations", "2", "--json")
    assert (early.status, "stopped at the iteration limit" in early.err) == (1, True)

    def fitted(epsilon: str) -> tuple[float, float, str]:
        result = json.loads(calibrant("intrinsics", "--observations", found, "--epsilon", epsilon, "--json").out)
        status = next(c["status"] for c in result["checks"] if c["name"] == "termination")
        camera = result["cameras"]["camera"]
        return camera["parameters"]["fx"], camera["sigma"]["fx"], status

    least = json.loads(calibrant("intrinsics", "--observations", found, "--json").out)["cameras"]["camera"]
    fx, sigma, status = fitted("1e-10px")
    assert (abs(fx - least["parameters"]["fx"]) < 0.1 * sigma, status) == (True, "ok")
    assert fitted("0.01px")[2] == "warn"
    assert calibrant("intrinsics", "--observations", found, "--max-iterations", "0").status == 2


def test_quiet_says_nothing_but_warnings(calibrant, found: Path) -> None:
    outcome = calibrant("intrinsics", "--observations", found, "-q")
    assert (outcome.status, outcome.out) == (0, "")
    assert all(line.startswith("calibrant: warning: ") for line in outcome.err.splitlines())


def test_points_from_a_file_give_what_the_photos_give(calibrant, cell, found: Path) -> None:
    direct = json.loads(calibrant("intrinsics", cell.images, "--target", TARGET, "--json").out)
    stored = json.loads(calibrant("intrinsics", "--observations", found, "--json").out)
    assert stored["cameras"] == direct["cameras"]
    assert stored["views"] == direct["views"]


def test_images_and_options_in_any_order_by_relative_names(
    calibrant, cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "my photos"
    folder.mkdir()
    for photo in cell.photos:
        shutil.copy(photo, folder / f"IMG {Path(photo).stem}.PNG")
    monkeypatch.chdir(tmp_path)
    named = sorted(os.path.relpath(p) for p in folder.iterdir())
    first = calibrant("intrinsics", "--fix", "k3", "tangential", *named, "--target", TARGET, "--json")
    last = calibrant("intrinsics", "--target", TARGET, "--json", "my photos/*.PNG", "--fix", "tangential,k3")
    assert first.status == last.status == 0
    a, b = json.loads(first.out), json.loads(last.out)
    assert a["cameras"] == b["cameras"]
    assert a["views"][0]["id"] == "IMG 00.PNG"
    assert a["cameras"]["camera"]["sigma"]["k3"] == 0


def test_an_excluded_photo_is_not_used(calibrant, cell, found: Path) -> None:
    by_photo = calibrant("intrinsics", cell.images, "--target", TARGET, "--exclude", "03.png", "5", "--json")
    refused(by_photo, 2, "--exclude 5: no image of that name")
    for names in (("03.png", "05"), ("03,05.png",)):
        outcome = calibrant("intrinsics", "--observations", found, "--exclude", *names, "--json")
        assert [v["id"] for v in json.loads(outcome.out)["views"]] == [f"{i:02d}.png" for i in (0, 1, 2, 4, 6, 7)]


def test_start_values_come_from_a_result_or_an_opencv_file(calibrant, found: Path, tmp_path: Path) -> None:
    first = tmp_path / "first.json"
    assert calibrant("intrinsics", "--observations", found, "--out", first, "-q").status == 0
    fx = cb.read(first).camera.parameters["fx"]
    for start in (first, tmp_path / "Intr.yml"):
        outcome = calibrant("intrinsics", "--observations", found, "--initial", start, "--fix", "fx", "--json")
        camera = json.loads(outcome.out)["cameras"]["camera"]
        assert camera["parameters"]["fx"] == pytest.approx(fx, abs=1e-9)
        assert camera["sigma"]["fx"] == 0


def test_points_above_max_error_are_left_out_and_said(calibrant, found: Path) -> None:
    plain = json.loads(calibrant("intrinsics", "--observations", found, "--json").out)
    limit = 1.8 * plain["rms_px"]  # exp(-1.8^2) = 4 % of the points of a two-dimensional Gaussian lie beyond
    result = json.loads(calibrant("intrinsics", "--observations", found, "--max-error", f"{limit}px", "--json").out)
    reasons = [v["reason"] for v in result["views"] if v["reason"]]
    assert any(f"residual above {limit:.2g} px" in r for r in reasons)
    assert result["rms_px"] < plain["rms_px"]
    refused(calibrant("intrinsics", "--observations", found, "--max-error", "1e-9px"), 1, "Raise --max-error")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.png"], ("none.png does not exist",)),
        (["none/*.png"], ("no file matches",)),
        (["empty"], ("holds no images",)),
        (["junk.png"], ("none of 1 images can be read", "junk.png")),
        (["zero.png"], ("0 bytes",)),
        ([], ("no images were given",)),
    ],
)
def test_images_that_are_missing_or_no_images(
    calibrant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("junk.png").write_bytes(b"this is no picture")
    Path("zero.png").write_bytes(b"")
    outcome = calibrant("intrinsics", *arguments, "--target", TARGET, "--out", "camera.json", "--report", "c.html")
    refused(outcome, 2, *words)
    assert sorted(os.listdir()) == ["empty", "junk.png", "zero.png"]


def test_an_unreadable_photo_among_good_ones_is_listed(calibrant, cell, tmp_path: Path) -> None:
    junk = tmp_path / "junk.png"
    junk.write_bytes(b"this is no picture")
    outcome = calibrant("intrinsics", *cell.photos, junk, "--target", TARGET, "--json")
    (view,) = [v for v in json.loads(outcome.out)["views"] if v["id"] == "junk.png"]
    assert not view["used"]
    assert "not an image" in view["reason"]


def test_two_sizes_in_one_set(calibrant, cell, tmp_path: Path) -> None:
    large = cv2.resize(cv2.imread(cell.photos[0]), (960, 720))
    cv2.imwrite(str(tmp_path / "large.png"), large)
    outcome = calibrant("intrinsics", *cell.photos, tmp_path / "large.png", "--target", TARGET)
    assert outcome.status == 0
    row = next(line for line in outcome.out.splitlines() if line.startswith("large.png"))
    assert "left out" in row
    assert "960x720" in " ".join(outcome.out.split())


def test_a_wrong_board_is_named(calibrant, cell) -> None:
    outcome = calibrant("intrinsics", cell.images, "--target", "chessboard:6x5:30mm")
    refused(outcome, 2)
    assert outcome.err == (
        "calibrant: 0 of 8 boards found; the images look like 7x6 inner corners, you asked for 6x5\n"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--target", "chessboard:7x6:30"], ("no unit", "30mm")),
        (["--target", "chess:7x6:30mm"], ("unknown kind of target", "chessboard:")),
        ([], ("--target",)),
        (["--target", TARGET, "--model", "fish"], ("unknown camera model 'fish'", "brown")),
        (["--target", TARGET, "--fix", "k7"], ("cannot fix 'k7'", "k1")),
        (["--target", TARGET, "--fix", "fx"], ("--initial",)),
        (["--target", TARGET, "--max-error", "1"], ("1.0px",)),
        (["--target", TARGET, "--initial", "none.json"], ("none.json",)),
        (["--target", TARGET, "--wrong"], ("No such option: --wrong", "calibrant intrinsics --help")),
        (["--target", TARGET, "--observations", "x.json"], ("not both",)),
    ],
)
def test_arguments_that_cannot_be_used(calibrant, cell, arguments: list[str], words: tuple[str, ...]) -> None:
    refused(calibrant("intrinsics", cell.images, *arguments), 2, *words)


def test_one_view_is_refused_and_leaves_only_the_report(calibrant, cell, tmp_path: Path) -> None:
    outcome = calibrant("intrinsics", cell.photos[0], "--target", TARGET, "--out", tmp_path / "camera.json")
    refused(outcome, 1, "1 usable view cannot determine fx, fy, cx, cy")
    assert list(tmp_path.iterdir()) == []


def test_outputs_that_cannot_be_written(calibrant, found: Path, tmp_path: Path) -> None:
    def attempt(*arguments: object):
        return calibrant("intrinsics", "--observations", found, *arguments)

    refused(attempt("--out", tmp_path / "no" / "c.json"), 2, "there is no folder")
    refused(attempt("--out", tmp_path), 2, "it is a folder")
    refused(attempt("--out", tmp_path / "c", "--report", tmp_path / "c"), 2, "two outputs")
    assert list(tmp_path.iterdir()) == []
    old = tmp_path / "old.json"
    old.write_text("mine")
    refused(attempt("--out", old), 2, "exists already", "--force")
    refused(attempt("--report", old), 2, "exists already", "--force")
    assert old.read_text() == "mine"
    assert attempt("--out", old, "--force", "-q").status == 0
    assert cb.read(old).kind == "intrinsics"


def test_inputs_are_never_written_over(calibrant, cell, found: Path, untouched: Callable[[], None]) -> None:
    outcome = calibrant("intrinsics", cell.images, "--target", TARGET, "--out", cell.photos[2], "--force")
    refused(outcome, 2, "02.png is an input")
    before = found.read_bytes()
    refused(calibrant("intrinsics", "--observations", found, "--out", found, "--force"), 2, "is an input")
    assert found.read_bytes() == before
    untouched()


def test_the_classic_stereo_set(calibrant, shared_data: Callable[[str], Path]) -> None:
    """13 of 13 boards on both sides, with less noise than the published calibrations of these photos."""
    folder = shared_data("opencv_stereo_9x6")
    left, right = (
        json.loads(calibrant("intrinsics", folder / f"{side}*.jpg", "--target", "chessboard:9x6:25mm", "--json").out)
        for side in ("left", "right")
    )
    for result, rms in ((left, 0.26), (right, 0.25)):
        assert sum(v["used"] for v in result["views"]) == 13
        assert result["rms_px"] <= rms
    values = left["cameras"]["camera"]["parameters"]
    # OpenCV gives fx = 531.9 from corners of 0.256 px rms. These have 0.16 px, and their optimum lies 1.6 px higher:
    # the boards are not flat, so detectors of different noise disagree by more than their sigma.
    assert values["fx"] == pytest.approx(531.9, abs=2)
    assert (values["cx"], values["cy"]) == (pytest.approx(342.0, abs=2), pytest.approx(233.1, abs=2))


@pytest.fixture(scope="module")
def marked(calibrant, found: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("marked") / "first.json"
    done = calibrant(
        "intrinsics", "--observations", found, "--mark-outliers", "0.015px", "--name", "wrist", "--out", out
    )
    assert done.status == 0
    assert "marked" in done.out
    return out


def test_marked_points_are_left_out_of_the_next_run(calibrant, found: Path, marked: Path) -> None:
    first = json.loads(marked.read_text())
    points = first["details"]["marked_points"]["points"]
    count = sum(map(len, points.values()))
    used = sum(v["points"] for v in first["views"])
    assert 0 < count < used
    done = calibrant("intrinsics", "--observations", found, "--without-marked", marked, "--json")
    second = json.loads(done.out)
    assert sum(v["points"] + v.get("points_left_out", 0) for v in second["views"]) == used - count
    assert second["rms_px"] < first["rms_px"]
    refused = calibrant("intrinsics", "--observations", found, "--without-marked", found)
    assert (refused.status, "has no marked points" in refused.err) == (2, True)


def test_each_view_has_its_smallest_and_largest_error(marked: Path) -> None:
    for view in json.loads(marked.read_text())["views"]:
        assert 0 <= view["min_px"] <= view["rms_px"] <= view["max_px"]


def test_a_named_camera_is_called_so_everywhere(calibrant, cell, found: Path, marked: Path, tmp_path: Path) -> None:
    result = json.loads(marked.read_text())
    assert list(result["cameras"]) == ["wrist"]
    assert list(result["observations"]["image_sizes"]) == ["wrist"]
    out = tmp_path / "hand-eye.json"
    done = calibrant(
        *("hand-eye", "--observations", found, "--poses", cell.poses, "--camera", marked, "--name", "eye", "--out", out)
    )
    assert done.status == 0, done.err
    placed = json.loads(out.read_text())
    assert [(t["parent"], t["child"]) for t in placed["transforms"]] == [("gripper", "eye"), ("base", "target")]
    assert placed["joint_covariance"]["frames"][0] == ["gripper", "eye"]
    # Every later step finds it under its name.
    asked = calibrant("report", out, "--workspace", "300mm:500mm,-100mm:100mm,0mm:50mm", "--out", tmp_path / "p.html")
    assert (asked.status, "gripper → eye" in asked.out) == (0, True), asked.err
    for name in ("two words", "base"):
        assert calibrant("hand-eye", "--observations", found, "--poses", cell.poses, "--name", name).status == 2
