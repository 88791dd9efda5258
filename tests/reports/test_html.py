"""The HTML report: complete, offline, escaped, small; its scripts run without an error where a browser is at hand."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.data import CalibrationResult, Check, Missed, Observations, RobotPoses, ViewResult
from calibrant.errors import InputError
from calibrant.reports.html import report_page, write_report
from calibrant.reports.kinds.registry import kind_of

MOST_BYTES = 5_000_000


class _Outline(HTMLParser):
    """Tags that do not close, ids, and everything that would be fetched from elsewhere."""

    VOID = frozenset({"meta", "br", "input", "line", "rect", "link", "img"})

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.wrong: list[str] = []
        self.fetched: list[str] = []
        self.headings: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.fetched += [f"{name}={value}" for name, value in attrs if name in ("src", "href") and value]
        if tag in ("h1", "h2"):
            self.headings.append("")
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] in ("h1", "h2"):
            self.headings[-1] += data

    def handle_endtag(self, tag: str) -> None:
        if tag in self.VOID:
            return
        if not self.stack or self.stack.pop() != tag:
            self.wrong.append(tag)


def _outline(page: str) -> _Outline:
    outline = _Outline()
    outline.feed(page)
    return outline


def _data(page: str) -> dict:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    assert found is not None
    return json.loads(found.group(1), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@pytest.fixture(scope="module")
def pages(intrinsics_result: CalibrationResult, hand_eye_result: Callable[[str], CalibrationResult]) -> dict[str, str]:
    return {
        "intrinsics": report_page(intrinsics_result),
        "eye-to-hand": report_page(hand_eye_result("eye-to-hand")),
        "eye-in-hand": report_page(hand_eye_result("eye-in-hand")),
    }


@pytest.mark.parametrize("kind", ["intrinsics", "eye-to-hand", "eye-in-hand"])
def test_the_page_is_well_formed_and_fetches_nothing(pages: dict[str, str], kind: str) -> None:
    outline = _outline(pages[kind])
    assert (outline.wrong, outline.stack, outline.fetched) == ([], [], [])
    assert "default-src 'none'" in pages[kind]
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", pages[kind])
    assert len(pages[kind].encode()) < MOST_BYTES


def test_the_sections_of_each_kind(pages: dict[str, str]) -> None:
    seen = ["In space", "Views", "Residuals", "Residuals and the noise model", "Coverage"]
    lens = ["How well the lens is known over the image"]
    moved = ["Influence of each view", "Views that move the result most"]
    end = ["Options and inputs", "How to reproduce it"]
    mine = ["Camera calibration", "Result", "Checks", *seen, *lens, *moved, *end]
    assert _outline(pages["intrinsics"]).headings == mine
    arm = ["Hand-eye calibration", "Result", "Checks", "Methods", *seen, *lens, *moved, *end]
    assert _outline(pages["eye-to-hand"]).headings == arm


def test_the_matrix_can_be_copied_as_python_and_json_read_it(
    pages: dict[str, str], hand_eye_result: Callable[[str], CalibrationResult]
) -> None:
    shown = re.findall(r'<pre class="code">(.*?)</pre>', pages["eye-to-hand"], re.S)
    transforms = hand_eye_result("eye-to-hand").transforms
    assert len(shown) == len(transforms)
    for text, estimate in zip(shown, transforms, strict=True):
        assert np.allclose(json.loads(text), estimate.matrix, atol=1e-7)
    assert pages["eye-to-hand"].count("data-copy hidden") == len(shown)


def test_numbers_stand_with_their_uncertainty(pages: dict[str, str]) -> None:
    row = re.search(r'<th scope="row">fx</th>(.*?)</tr>', pages["intrinsics"], re.S)
    assert row is not None
    assert re.findall(r">([^<>\s]+)</td>", row.group(1)) == ["905.20", "0.26", "0.78", "px"]
    assert "per point, both axes" in pages["intrinsics"]
    assert "1.0012 ± 0.0031" in pages["eye-in-hand"]


def test_coverage_says_what_is_missing(pages: dict[str, str]) -> None:
    text = pages["intrinsics"]
    assert "no points in the lower left corner: take a view with the board there" in text
    assert text.count("<b>corner-coverage</b>") == 2  # the result's own check, and again beside the map
    assert "distortion is extrapolated" not in pages["eye-to-hand"]  # there the camera was given


def test_beside_the_map_stands_what_the_result_says_of_that_camera(intrinsics_result: CalibrationResult) -> None:
    """Of several cameras each has its own check, and that one may hold what the general one warns of."""
    others = tuple(c for c in intrinsics_result.checks if c.name != "residual-structure")
    own = Check("residual-structure-camera", "ok", "neighbouring points err alike, and every sigma holds it")
    page = report_page(replace(intrinsics_result, checks=(*others, own)))
    assert own.message in page.split(">Coverage<")[1].split(">Options and inputs<")[0]


def test_views_carry_residuals_and_reasons(pages: dict[str, str], intrinsics_result: CalibrationResult) -> None:
    views = {view["id"]: view for view in _data(pages["intrinsics"])["views"]}
    assert len(views) == 14
    assert len(views["0.png"]["uv"]) == len(views["0.png"]["r"]) == 108
    assert views["3.png"]["status"] == "left out"
    assert views["99.png"] == views["99.png"] | {"rms": None, "uv": [], "size": None, "reason": "no board found"}
    r = np.array(views["0.png"]["r"]).reshape(-1, 2)
    # Rounded to 0.001 px in the page.
    assert np.sqrt(np.mean(np.sum(r**2, axis=1))) == pytest.approx(intrinsics_result.views[0].rms_px, abs=1e-3)


@pytest.mark.parametrize("setup", ["eye-to-hand", "eye-in-hand"])
def test_targets_by_camera_and_by_robot_overlap(pages: dict[str, str], setup: str) -> None:
    scene = _data(pages[setup])["scene"]
    robot = {board["view"]: np.array(board["T"]) for board in scene["boards"]["robot"]}
    assert len(scene["boards"]["seen"]) == 12
    for board in scene["boards"]["seen"]:
        partner = robot[board["view"]] if setup == "eye-to-hand" else next(iter(robot.values()))
        # Robot noise of the fixture: 0.1 mm, 0.02 deg at arms of up to 1 m; 3 mm is far above it, far below a fault.
        assert np.abs(np.array(board["T"]) - partner)[[3, 7, 11]].max() < 3e-3
    assert len(scene["cameras"]) == (1 if setup == "eye-to-hand" else 12)


def test_a_hand_eye_result_from_pose_pairs_needs_no_observations(
    hand_eye_result: Callable[[str], CalibrationResult],
) -> None:
    full = hand_eye_result("eye-to-hand")
    assert full.robot_poses is not None
    B = np.stack([view.T_camera_target for view in full.views])
    poses = RobotPoses(full.robot_poses.ids, full.robot_poses.T_base_gripper)
    page = report_page(
        replace(full, observations=None, views=(), cameras={}, robot_poses=poses, T_camera_target=B), images={}
    )
    data = _data(page)
    assert len(data["scene"]["boards"]["seen"]) == 12
    assert all(view["mm"] is not None for view in data["views"])
    assert "Residuals" not in _outline(page).headings


def test_a_result_with_nothing_but_a_reason() -> None:
    check = Check("motion", "fail", "all rotations are about one axis: turn the gripper about a second one")
    page = report_page(CalibrationResult("hand-eye", "refused", checks=(check,)))
    assert "DO NOT USE" in page
    assert "All rotations are about one axis" in page
    assert _outline(page).headings == ["Hand-eye calibration", "Checks", "Options and inputs", "How to reproduce it"]


def test_text_of_users_is_escaped(intrinsics_result: CalibrationResult) -> None:
    evil = '</script><img src=x onerror="alert(1)">'
    observations = intrinsics_result.observations
    assert observations is not None
    changed = replace(
        intrinsics_result,
        views=(ViewResult(evil, False, 0, None, evil),),
        checks=(Check(evil, "warn", evil),),
        options={evil: evil},
        inputs=({"file": evil, "sha256": evil},),
        observations=replace(observations, missed=(Missed(evil, evil),), target=evil, notes=(evil,)),
    )
    page = report_page(changed)
    assert "<img" not in page
    outline = _outline(page)
    assert (outline.wrong, outline.stack) == ([], [])
    assert _data(page)["views"][0]["id"] == evil


def test_many_views_stay_below_the_limit(intrinsics_result: CalibrationResult) -> None:
    observations = intrinsics_result.observations
    assert observations is not None
    first = observations.views[0]
    views = tuple(replace(first, id=f"{i}.png", moment="") for i in range(1200))
    pose = intrinsics_result.views[0].T_camera_target
    many = replace(
        intrinsics_result,
        observations=Observations(views, observations.image_sizes),
        views=tuple(ViewResult(v.id, True, len(v), 0.1, T_camera_target=pose) for v in views),
    )
    page = report_page(many)
    assert len(page.encode()) < MOST_BYTES
    drawn = [view for view in _data(page)["views"] if view["uv"]]
    assert 0 < sum(len(view["uv"]) // 2 for view in drawn) <= 40_000


def _picture(folder: Path) -> Path:
    path = folder / "0.png"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (1024, 1280), dtype=np.uint8))
    return path


def test_pictures_are_embedded_small_and_missing_ones_named(
    tmp_path: Path, intrinsics_result: CalibrationResult
) -> None:
    pytest.importorskip("calibrant.detection.images.images")
    page = report_page(intrinsics_result, images={"0.png": _picture(tmp_path), "1.png": tmp_path / "gone.png"})
    pictures = _data(page)["pictures"]
    assert list(pictures) == ["camera/0.png"]
    jpeg = base64.b64decode(pictures["camera/0.png"].removeprefix("data:image/jpeg;base64,"))
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (768, 960)
    assert "1 picture could not be read where it was (gone.png)" in page


def test_an_existing_report_is_kept_without_force(tmp_path: Path, intrinsics_result: CalibrationResult) -> None:
    path = write_report(intrinsics_result, tmp_path / "report.html")
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        write_report(intrinsics_result, path)
    assert path.read_bytes() == before
    write_report(intrinsics_result, path, force=True)
    with pytest.raises(InputError, match="cannot write"):
        write_report(intrinsics_result, tmp_path / "no" / "folder.html")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_the_headline_answers_how_good(hand_eye_result: Callable[[str], CalibrationResult]) -> None:
    found = hand_eye_result("eye-to-hand")
    facts = [(fact.name, fact.text) for fact in kind_of(found).headline(found)]
    assert ("base → camera, position", "± 0.23 mm") in facts
    assert ("views used", "11 of 13") in facts


EXERCISE = """<script>
window.addEventListener("error", (e) => { document.title = `ERROR ${e.message}`; });
window.addEventListener("load", () => {
  const at = (x, y) => ({ bubbles: true, clientX: x, clientY: y, pageX: x, pageY: y, pointerId: 1 });
  document.querySelectorAll("button").forEach((b) => b.click());
  document.querySelectorAll("select").forEach((s) => {
    s.selectedIndex = s.options.length - 1;
    s.dispatchEvent(new Event("change"));
  });
  document.querySelectorAll("input").forEach((i) => {
    if (i.type === "range") { i.value = 2; i.dispatchEvent(new Event("input")); } else { i.click(); i.click(); }
  });
  document.querySelectorAll("canvas, #bars svg").forEach((c) => {
    c.setPointerCapture = () => {};
    const box = c.getBoundingClientRect(), x = box.left + box.width / 2, y = box.top + box.height / 2;
    for (let i = -100; i <= 100; i += 4) c.dispatchEvent(new PointerEvent("pointermove", at(x + i, y + i / 2)));
    c.dispatchEvent(new PointerEvent("pointerdown", at(x, y)));
    c.dispatchEvent(new PointerEvent("pointermove", at(x + 30, y + 20)));
    c.dispatchEvent(new PointerEvent("pointerup", at(x + 30, y + 20)));
    c.dispatchEvent(new MouseEvent("click", at(x, y)));
    c.dispatchEvent(new WheelEvent("wheel", { deltaY: -120, cancelable: true }));
    const keys = ["ArrowLeft", "ArrowRight", "ArrowUp", "+", "-", "0", "Tab"];
    keys.forEach((key) => c.dispatchEvent(new KeyboardEvent("keydown", { key })));
  });
  window.dispatchEvent(new Event("resize"));
  window.dispatchEvent(new Event("beforeprint"));
  document.body.dataset.exercised = "yes";
});
</script>"""
"""Uses every control of the page as a person might; any error ends up in the title."""


@pytest.mark.parametrize("kind", ["intrinsics", "eye-to-hand"])
def test_scripts_run_without_an_error(pages: dict[str, str], kind: str, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine to run the report's scripts")
    path = tmp_path / "report.html"
    path.write_text(pages[kind].replace("<style>", f"{EXERCISE}<style>", 1), encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=2000", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert re.findall("<title>ERROR(.*?)<", done.stdout) == []
    assert 'data-exercised="yes"' in done.stdout
    assert done.stdout.count("<option") > 14  # views and factors were filled in by the scripts
    assert 'fill="url(#hatch)"' in done.stdout


def test_what_was_asked_stands_beside_what_was_decided() -> None:
    result = CalibrationResult("hand-eye", "ok", options={"setup": "auto"}, decided={"setup": "eye-in-hand"})
    assert "auto, decided: eye-in-hand" in report_page(result)
    assert "decided" not in report_page(replace(result, options={"setup": "eye-in-hand"}))
