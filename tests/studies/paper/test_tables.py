"""The paper's contradictions, and whether the study's sentence says what its numbers are."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from calibrant.geometry import se3, so3
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.shapes import box
from calibrant.studies.paper import page, published
from calibrant.studies.paper.run import PlacedPose, based, mean_pose, seen_at, stands
from calibrant.studies.paper.tables import PaperTables, as_printed, distances, summary, tables_text, verdict
from calibrant.verification.unchanged.robot_noise import RobotSide

SYMMETRIES = box(published.SIDES_M).symmetries


def test_the_paper_contradicts_itself_as_its_tables_say() -> None:
    camera = [published.distance_mm(published.CAMERA, pair) for pair in published.PAIRS]
    base = [published.distance_mm(published.BASE, pair) for pair in published.PAIRS]
    # Five digits are printed: three places of a distance are right to a thousandth.
    assert camera[:3] == pytest.approx([33.985, 40.307, 50.148], abs=1e-3)
    assert base == pytest.approx([36.537, 42.446, 50.148, 8.060, 4.607, 6.046], abs=1e-3)
    assert published.turn_deg(published.BASE, ("PA", "QA")) == pytest.approx(1.037, abs=1e-9)
    # The half turns of B in the camera and of R in the base are no turns of the cuboid.
    assert published.turn_deg(published.CAMERA, ("PA", "PB")) < 3
    assert published.turn_deg(published.BASE, ("PA", "RA")) < 1
    assert "2.55 mm" in verdict(PaperTables())
    assert "8.06 mm" in verdict(PaperTables())


def test_the_cuboid_is_seen_where_the_paper_saw_it() -> None:
    rows = {s.row: s for s in stands()}
    assert list(rows) == list(published.ROWS)
    for row, stand in rows.items():
        seen = se3.inverse(stand.T_base_camera) @ stand.T_base_object
        np.testing.assert_allclose(seen, seen_at(row), atol=1e-12)
        np.testing.assert_allclose(1e3 * seen[:2, 3], published.place(published.CAMERA, row)[:2], atol=1e-9)
        # The camera looks straight down from 220 mm; the cuboid lies flat.
        np.testing.assert_allclose(stand.T_base_camera[:3, 2], [0, 0, -1], atol=1e-12)
        assert stand.T_base_camera[2, 3] == pytest.approx(0.22)
        np.testing.assert_allclose(stand.T_base_object[:3, 2], [0, 0, 1], atol=1e-12)
    for row in published.FIXED:
        np.testing.assert_array_equal(rows[row].T_base_camera, rows["PA"].T_base_camera)
    for row in published.MOVED:
        np.testing.assert_allclose(rows[row].T_base_object, rows["PA"].T_base_object, atol=1e-12)


def _read(seed: int, frame: str, row: str, xi: np.ndarray, truth: np.ndarray, sigma: float = 1e-3) -> PlacedPose:
    nothing = np.zeros(3)
    C = np.diag(np.full(6, sigma**2))
    return PlacedPose(seed, row, frame, se3.retract(truth, xi), truth, nothing, nothing, xi, C)


def made_up(cells: int, *, mm: float, deg: float, sigma: float = 1e-3) -> PaperTables:
    """Cells whose errors are of exactly these sizes, in random directions."""
    rng = np.random.default_rng(4)
    poses = []
    for seed in range(cells):
        for stand in stands():
            turn, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
            xi = np.concatenate([np.deg2rad(deg) * turn, 1e-3 * mm * shift])
            poses.append(_read(seed, "base", stand.row, xi, stand.T_base_object, sigma))
            poses.append(_read(seed, "camera", stand.row, xi, seen_at(stand.row), sigma))
    return PaperTables(tuple(range(cells)), 6, tuple(poses))


@pytest.mark.parametrize(("mm", "deg", "kept"), [(0.3, 0.05, True), (0.7, 0.05, False), (0.3, 0.4, False)])
def test_the_sentence_says_what_the_numbers_are(mm: float, deg: float, kept: bool) -> None:
    # sigma: 0.3 mm of 3 and 0.05 deg of 3 numbers lie well within 95 %.
    found = made_up(7, mm=mm, deg=deg, sigma=1e-2)
    said, data = verdict(found), json.loads(tables_text(found))
    assert said == data["verdict"]
    base = [r for r in data["runs"] if r["frame"] == "base"]
    medians = []
    for rows in (published.FIXED, published.MOVED):
        mine = [r for r in base if r["row"] in rows]
        medians += [np.median([r["error_mm"] for r in mine]), np.median([r["error_deg"] for r in mine])]
    numbers = re.search(
        r"In (\d+) cells .* at most ([\d.]+) mm and the still cuboid lies ([\d.]+) mm .* "
        r"base is ([\d.]+) mm, ([\d.]+) deg with the camera fixed and ([\d.]+) mm, ([\d.]+) deg .*, and (\d+) of (\d+) "
        r"poses .* worst row (\d+) of (\d+)\)",
        said,
    )
    assert numbers is not None
    cells, most, apart, *errors, inside, of, least, cells_again = map(float, numbers.groups())
    assert cells == cells_again == 7
    assert errors == pytest.approx(medians, abs=6e-3)
    still = [abs(d["camera_mm"] - d["base_mm"]) for d in data["distances"] if d["pair"] in ("PA-PB", "PB-PC", "PA-PC")]
    assert most == pytest.approx(max(still), abs=1e-3)
    same = [
        max(d["base_mm"] for d in data["distances"] if d["seed"] == k and d["pair"] in ("PA-QA", "PA-RA", "QA-RA"))
        for k in range(7)
    ]
    assert apart == pytest.approx(np.median(same), abs=6e-3)
    assert (inside, of) == (sum(r["inside"] for r in base), len(base))
    by_row = [sum(r["inside"] for r in base if r["row"] == row) for row in published.ROWS]
    assert least == min(by_row) == min(data["inside_95_by_row"]["base"].values())
    assert data["passed"] is kept
    assert said.endswith("are kept." if kept else "are not kept.")


def test_predictions_that_are_too_small_keep_no_promise() -> None:
    found = made_up(7, mm=0.3, deg=0.05, sigma=3e-5)
    s = summary(found)
    assert s is not None
    assert s.inside == 0
    assert not s.kept


def test_true_distances_are_the_papers_of_the_camera() -> None:
    found = made_up(1, mm=0.0, deg=0.0)
    for d in distances(found):
        flat = [published.place(published.CAMERA, row)[:2] for row in d.pair]
        assert d.true_camera == pytest.approx(np.linalg.norm(np.subtract(*flat)), abs=1e-9)
        assert d.true_base == pytest.approx(0.0 if d.pair in published.SAME_PAIRS else d.true_camera, abs=1e-9)


def test_readings_that_differ_by_half_turns_have_the_mean_of_one() -> None:
    truth = seen_at("PB")
    rng = np.random.default_rng(5)
    steps = 1e-4 * rng.standard_normal((6, 6))
    poses = [
        ObjectPose("cuboid", se3.retract(truth, xi) @ SYMMETRIES[k % 4], 1e-8 * np.eye(6), SYMMETRIES)
        for k, xi in enumerate(steps)
    ]
    one = mean_pose(0, "PB", "camera", poses, truth @ SYMMETRIES[2])
    # Turns of 1e-4 rad do not commute by 1e-8.
    np.testing.assert_allclose(one.error, steps.mean(axis=0), atol=1e-7)
    np.testing.assert_allclose(one.spread_mm, 1e3 * steps[:, 3:].std(axis=0, ddof=1), rtol=1e-2)
    place, angles = as_printed(one)
    np.testing.assert_allclose(place[:2], published.place(published.CAMERA, "PB")[:2], atol=0.5)
    assert abs(angles[2]) == pytest.approx(178.685, abs=0.1) or abs(angles[2] + 1.315) < 0.1


def test_what_the_base_adds_is_what_arm_and_mounting_err_by() -> None:
    A = se3.make(so3.exp([3.0, 0.2, -0.1]), [0.1, 0.5, 0.3])
    X = se3.make(so3.exp([0.1, -0.2, 1.5]), [0.03, -0.04, 0.06])
    rng = np.random.default_rng(6)
    root = 1e-3 * rng.standard_normal((6, 6))
    C = np.zeros((12, 12))
    C[:6, :6] = root @ root.T
    side = RobotSide(True, X, np.eye(4), C, 4e-4, 2e-4, 0.0)
    pose = ObjectPose("cuboid", seen_at("PA"), np.zeros((6, 6)), SYMMETRIES)
    found = based(pose, side, A)
    np.testing.assert_allclose(found.matrix, A @ X @ pose.matrix, atol=1e-12)
    h, columns = 1e-6, []
    for root_of, slot in ((np.diag(np.repeat([4e-4, 2e-4], 3)), "A"), (root, "X")):
        for k in range(6):
            ends = []
            for sign in (1, -1):
                step = sign * h * np.eye(6)[k]
                T = se3.retract(A, step) @ X if slot == "A" else A @ se3.retract(X, step)
                ends.append(se3.local(found.matrix, T @ pose.matrix))
            columns.append((slot, (ends[0] - ends[1]) / (2 * h)))
        J = np.stack([c for s, c in columns if s == slot], axis=1) @ root_of
        C_slot = J @ J.T
        found = ObjectPose("", found.matrix, found.covariance - C_slot)
    assert np.abs(found.covariance).max() < 1e-6 * np.abs(based(pose, side, A).covariance).max()


def test_tables_and_picture_name_every_row() -> None:
    found = made_up(2, mm=0.2, deg=0.05)
    tables = page.study_tables(found)
    assert len(tables) == 4
    assert len(tables[0].rows) == 2 * len(published.ROWS)
    assert len(tables[2].rows) == 2 * len(published.ROWS)
    assert [row[0] for row in tables[3].rows] == ["-".join(p) for p in published.PAIRS]
    assert "<svg" in page.page(found)
    assert page.tables_png(found)[:4] == b"\x89PNG"
