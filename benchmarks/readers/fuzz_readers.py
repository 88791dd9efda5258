"""Damaged and hostile files, thousands of them: does every reader answer with a result or with words, and in time?

    python benchmarks/readers/fuzz_readers.py                     5,000 mutations, seed 0
    python benchmarks/readers/fuzz_readers.py --seed 7 --count 20000
    python benchmarks/readers/fuzz_readers.py --only poses --seed 7 --one 123     one case again, with its traceback

Each case is a good file of its kind with up to four mutations: bytes and tokens changed, numbers no computer likes,
keys renamed, lines moved, brackets by the hundred, other files spliced in. It is read, and what was read is used as a
command would (poses in every notation, a camera projects, a result tells itself). An exception that is no
CalibrantError is what a user would see as "internal error". Passes with none, no case beyond 10 s of CPU, no growth of
memory beyond 1 GB.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import re
import resource
import sys
import tarfile
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import in_words_of
from calibrant.data import CalibrationResult, Check, Measured, Observations, RobotPoses, View, ViewResult
from calibrant.data.result_file import read_observations, read_result, result_text
from calibrant.data.results import MethodResult, as_transform
from calibrant.detection.images.images import load_grey, load_image
from calibrant.diagnose.next_pose.obstacles import read_geometry
from calibrant.errors import CalibrantError, InputError
from calibrant.formats.cameras.opencv import intrinsics_text
from calibrant.formats.cameras.read import read_camera
from calibrant.formats.exchange.exchange_format import ReadOptions, WriteOptions, read_cameras
from calibrant.formats.exchange.read import read_any
from calibrant.formats.exchange.registry import FORMATS, format_named
from calibrant.formats.measurements.read import read_measurements
from calibrant.formats.points_yaml import read_own_points
from calibrant.formats.poses.notations import notations
from calibrant.formats.poses.read import read_poses
from calibrant.formats.poses.timed import read_timed_poses
from calibrant.formats.robots.dh_yaml import dh_text
from calibrant.formats.robots.read import read_robot
from calibrant.formats.robots.urdf import new_urdf
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.robots.arms import arm
from calibrant.targets.registry import parse_target
from calibrant.tasks.inputs.columns import read_columns

MOST_SECONDS, MOST_GROWTH = 10.0, 1e9
RNG = np.random.default_rng(3)
PLAIN = {"fx": 800.5, "fy": 801.5, "cx": 320.25, "cy": 240.5}
NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w.-]*")
HOSTILE = tuple(
    text.encode()
    for text in (
        *("nan", "inf", "-Infinity", "1e308", "-1e308", "1e999", "1e-320", "0", "-0.0", "-1", "9" * 400, "0x10", "1_0"),
        *(
            "",
            "null",
            "true",
            "~",
            "''",
            '"x"',
            "[]",
            "{}",
            "[[]]",
            "{a: 1}",
            "*a",
            "&a 1",
            "!!set {a}",
            "!!python/name:os",
            "1:2:3",
        ),
        *("2020-13-45", "1,5", "1e", "--1", "٣", "\x1b[31m", "\u202e", "2147483648", "9223372036854775808", "1e18"),
    )
)


MILD = (b"1", b"0.5", b"-2", b"3", b"100", b"-0.1", b"1e-9", b"123456.789", b"7", b"16", b"0")


@dataclass(frozen=True)
class Kind:
    """A kind of file: good ones by name, and what a command does with one."""

    files: tuple[tuple[str, bytes], ...]
    use: Callable[[Path], object]


def poses_in_use(path: Path) -> None:
    raw = read_poses(path)
    notations(raw)
    if raw.target is not None:
        notations(raw.target)


def camera_in_use(path: Path) -> None:
    camera = read_camera(path, image_size=None)
    camera.project(np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0]]))
    camera.unproject(np.array([[1.0, 2.0]]))
    repr(camera)


def robot_in_use(path: Path) -> None:
    chain = read_robot(path).chain
    chain.forward(np.zeros((1, len(chain.joints))))


def result_in_use(path: Path) -> None:
    result = read_result(path)
    result_text(result)
    str(result)
    result.summary()


def picture_in_use(path: Path) -> None:
    load_grey(path)
    load_image(path)


def corpus() -> dict[str, Kind]:
    """Every kind of file, a few of each as people have them."""
    T = np.array([se3.make(so3.exp(RNG.normal(0, 0.8, 3)), RNG.normal(0, 0.3, 3)) for _ in range(5)])
    camera = Camera.create(
        "brown",
        {"fx": 800.5, "fy": 801.5, "cx": 320.25, "cy": 240.5, "k1": -0.1, "k2": 0.02},
        image_size=(640, 480),
        covariance=np.eye(9) * 1e-4,
    )
    return {
        "poses": Kind(tuple(_pose_files(T)), poses_in_use),
        "camera": Kind(tuple(_camera_files(camera)), camera_in_use),
        "robot": Kind(
            (("r.yaml", dh_text(arm("ur5e")).encode()), ("r.urdf", new_urdf(arm("ur5e")).encode())), robot_in_use
        ),
        "timed": Kind((("t.csv", _timed(T)),), read_timed_poses),
        "measurements": Kind((("m.csv", _measured(T)),), read_measurements),
        "result": Kind(tuple(_result_files(T, camera)), result_in_use),
        "observations": Kind((("o.json", _result_files(T, camera)[0][1]),), read_observations),
        "target": Kind(tuple(_target_files()), lambda path: parse_target(str(path))),
        "points": Kind((("p.csv", b"id,x_mm,y_mm,z_mm\n0,0,0,0\n1,10,0,0\n2,0,10,0\n3,10,10,5\n"),), _points_in_use),
        "own points": Kind((("c.yml", _own_points()),), read_own_points),
        "columns": Kind(
            (("u.csv", b"image,u,v\na.png,1.5,2.5\nb.png,3,4\n"),), lambda path: read_columns(path, ("u", "v"))
        ),
        "geometry": Kind((("g.yaml", _geometry()),), read_geometry),
        "picture": Kind(tuple(_picture_files()), picture_in_use),
        "exchange": Kind(tuple(_exchanged_files(camera, T[0])), lambda path: read_any(path, ReadOptions(unit_m=1.0))),
        "archive": Kind(tuple(_archives(camera)), read_any),
        "foreign lens": Kind((("ocam.txt", OCAM),), _nearest_lens),
    }


def _nearest_lens(path: Path) -> object:
    return read_any(path, ReadOptions(answers={"approximate": "yes"}))


def _points_in_use(path: Path) -> object:
    return parse_target(f"points:{path}").points


def _pose_files(T: np.ndarray) -> Iterator[tuple[str, bytes]]:
    q = [[*M[:3, 3].tolist(), *so3.log(M[:3, :3]).tolist()] for M in T]
    head = "image,x[mm],y[mm],z[mm],rx,ry,rz,gain\n"
    yield "p.csv", (head + "".join(f"{i}.png,{','.join(map(repr, row))},1\n" for i, row in enumerate(q))).encode()
    entries = [
        {
            "name": f"{i}.png",
            "position": dict(zip("xyz", row[:3])),
            "orientation": dict(zip("xyzw", (0.0, 0.0, 0.0, 1.0))),
        }
        for i, row in enumerate(q)
    ]
    yield "p.json", json.dumps(entries).encode()
    yield "p.jsonl", "\n".join(json.dumps(M.tolist()) for M in T).encode()
    yield "p.yaml", ("poses:\n" + "".join(f"- {{rvec: {row[3:]}, tvec: {row[:3]}}}\n" for row in q)).encode()
    yield "p.txt", "\n".join(" ".join(map(repr, row)) for M in T for row in M.tolist()).encode()
    yield "ur.txt", "".join(f"P{i} = p[{', '.join(map(repr, row))}]\n" for i, row in enumerate(q)).encode()
    yield "print.txt", f"poses = np.array({T.tolist()}, dtype=np.float64)\n".encode()
    pairs = {f"{k}_{i}": M.tolist() for i, M in enumerate(T) for k in ("gripper2base", "target2cam")}
    yield "pairs.json", json.dumps(pairs).encode()
    block = "{}:\n{}\n"
    rows = ["\n".join(" ".join(map(repr, row)) for row in M.tolist()) for M in T]
    yield "log.txt", "".join(block.format("EE", r) + block.format("Cam", r) for r in rows).encode()
    yield "kuka.src", "".join(f"XP{i}={{X {r[0]},Y {r[1]},Z {r[2]},A 1,B 2,C 3}}\n" for i, r in enumerate(q)).encode()
    yield (
        "fanuc.ls",
        "".join(
            f'P[{i}:"a"]{{\n GP1:\n X = {r[0]} mm, Y = {r[1]} mm, Z = {r[2]} mm,\n W = 1 deg, P = 2 deg, R = 3 deg}};\n'
            for i, r in enumerate(q)
        ).encode(),
    )
    echo = "header:\n  stamp: {secs: 1, nsecs: 2}\npose:\n  position: {x: 1.0, y: 2.0, z: 0.5}\n"
    yield "echo.yaml", (echo + "  orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}\n---\n").encode() * 4
    stream = io.BytesIO()
    np.save(stream, T)
    yield "p.npy", stream.getvalue()
    stream = io.BytesIO()
    np.savez_compressed(stream, robot=T, target=T)
    yield "p.npz", stream.getvalue()
    matrix = '<opencv_storage><poses type_id="opencv-matrix"><rows>20</rows><cols>4</cols><dt>d</dt><data>'
    yield "p.xml", f"{matrix}{' '.join(map(repr, T.ravel().tolist()))}</data></poses></opencv_storage>".encode()


def _camera_files(camera: Camera) -> Iterator[tuple[str, bytes]]:
    K, D = camera.K.tolist(), [-0.1, 0.02, 0.001, -0.002, 0.0]
    yield "c.yml", intrinsics_text(camera).encode()
    ros = {"rows": 3, "cols": 3, "data": camera.K.ravel().tolist()}
    size = {"image_width": 640, "image_height": 480}
    yield "ros.yaml", json.dumps({**size, "camera_matrix": ros, "distortion_model": "plumb_bob", "d": D}).encode()
    yield "c.json", json.dumps({"K": K, "dist": D, "image_size": [640, 480], "model": "fisheye", "name": "a"}).encode()
    kalibr = {"camera_model": "ds", "intrinsics": [-0.2, 0.6, 800, 801, 320, 240], "resolution": [640, 480]}
    yield "k.yaml", json.dumps({"cam0": {**kalibr, "distortion_model": "none"}}).encode()
    named = {"fx": 800.0, "fy": 801.0, "cx": 320.0, "cy": 240.0, "k1": 0.1, "p1": 0.01, "width": 640, "height": 480}
    yield "n.json", json.dumps({"camera": named}).encode()
    matrix = '<M type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>'
    numbers = " ".join(map(repr, camera.K.ravel().tolist()))
    text = f"<opencv_storage><size>640 480</size>{matrix}{numbers}</data></M></opencv_storage>"
    yield "c.xml", text.replace("<M ", "<camera_matrix ").replace("</M>", "</camera_matrix>").encode()


def _timed(T: np.ndarray) -> bytes:
    rows = [f"{17e8 + i / 7!r},{','.join(map(repr, M[:3, 3].tolist()))},0,0,0,1\n" for i, M in enumerate(T)]
    return ("timestamp,x,y,z,qx,qy,qz,qw\n" + "".join(rows)).encode()


def _measured(T: np.ndarray) -> bytes:
    rows = [f"0.1,{i},0.3,0.4,0.5,0.6,{','.join(map(repr, M[:3, 3].tolist()))}\n" for i, M in enumerate(T)]
    return ("q1,q2,q3,q4,q5,q6,x,y,z\n" + "".join(rows)).encode()


def _result_files(T: np.ndarray, camera: Camera) -> list[tuple[str, bytes]]:
    board = np.array([[x, y, 0.0] for y in range(3) for x in range(3)]) * 0.03
    uv = 100 + 500 * board[:, :2]
    seen = Observations(
        tuple(View(f"{i}.png", board, uv + i, np.arange(9)) for i in range(2)),
        {"camera": (640, 480)},
        "chessboard:3x3:30mm",
    )
    views = tuple(ViewResult(f"{i}.png", True, 9, 0.2, T_camera_target=T[i]) for i in range(2))
    result = CalibrationResult(
        "hand-eye",
        "warn",
        checks=(Check("convergence", "ok", "converged", 9.0), Check("motion", "warn", "few motions", 2.0)),
        cameras={"camera": camera},
        transforms=(as_transform("gripper", "camera", T[0], np.eye(6) * 1e-8), as_transform("base", "target", T[1])),
        rms_px=0.2,
        sigma_px=0.14,
        views=views,
        methods={"park": MethodResult(T[0], 0.5, 0.1)},
        figures={"offset": Measured(0.08, 0.0002, "s")},
        target_scale=Measured(1.001, 0.0002),
        robot_poses=RobotPoses(("0.png", "1.png"), T[:2], "poses.csv"),
        observations=seen,
        created="2026-01-01T00:00:00+00:00",
        version="1",
    )
    plain = CalibrationResult(
        "intrinsics",
        "ok",
        cameras={"camera": camera},
        rms_px=0.2,
        views=views,
        observations=seen,
        created="x",
        version="1",
    )
    return [(f"{i}.json", result_text(r).encode()) for i, r in enumerate((result, plain))]


def _target_files() -> Iterator[tuple[str, bytes]]:
    yield "t.yaml", b"target: chessboard:9x6:25mm\n"
    bundle = "target: bundle\ndictionary: DICT_APRILTAG_36h11\nmarkers:\n"
    marker = "- {id: 3, side: 50mm, position: [0mm, 80mm, 0mm], rotation_vector_deg: [0, 0, 90]}\n"
    corners = "- {id: 4, corners: [[0mm, 0mm, 0mm], [50mm, 0mm, 0mm], [50mm, 50mm, 0mm], [0mm, 50mm, 0mm]]}\n"
    cube = "cubes:\n- {side: 60mm, marker: 48mm, ids: [10, 11, 12, 13, 14, 15], position: [0mm, 0mm, 0mm]}\n"
    yield "b.yaml", (bundle + marker + corners + cube).encode()
    yield "grid.yaml", b"target: aprilgrid:6x6:88mm:0.3:DICT_APRILTAG_36h11\n"


def _own_points() -> bytes:
    rows = " ".join(f"{10.0 * i}, {5.0 * i * i}," for i in range(6)).rstrip(",")
    points = " ".join(f"{i}.0, {i * i}.0, 1.0," for i in range(6)).rstrip(",")
    head = "%YAML:1.0\n---\n"
    return (
        f"{head}corners: !!opencv-matrix\n   rows: 6\n   cols: 1\n   dt: 2f\n   data: [ {rows} ]\n"
        f"obj: !!opencv-matrix\n   rows: 6\n   cols: 1\n   dt: 3f\n   data: [ {points} ]\n"
    ).encode()


def _geometry() -> bytes:
    return b"link_radius: 60mm\nfloor: 0mm\nboxes:\n  - {from: [400mm, -300mm, 0mm], to: [600mm, -200mm, 300mm]}\n"


def _picture_files() -> Iterator[tuple[str, bytes]]:
    picture = RNG.integers(0, 255, (40, 60, 3)).astype(np.uint8)
    for suffix in (".png", ".jpg", ".bmp", ".tiff", ".webp", ".pgm", ".ras", ".jp2"):
        image = picture[..., 0] if suffix == ".pgm" else picture
        yield f"i{suffix}", cv2.imencode(suffix, image)[1].tobytes()


OCAM = b"""#polynomial coefficients for the DIRECT mapping function
5 -2.065170e+02 0.0 2.207161e-03 -4.879622e-06 1.865656e-08
#inverse
4 294.182260 152.289570 -12.191217 27.959546
#center
241.800066 394.552874
#affine
1.000330 0.000219 0.000257
#image size
480 752
"""
"""What OCamCalib writes."""


def _exchanged_files(camera: Camera, T: np.ndarray) -> Iterator[tuple[str, bytes]]:
    """A camera in a robot's hand in every format that is one file and written."""
    named = {"camera": camera}
    result = read_cameras(named, transforms=(as_transform("gripper", "camera", T),))
    for name in FORMATS:
        form = format_named(name)
        # What OCamCalib writes is a foreign lens to whoever reads it.
        if form.write is None or name.endswith("-pose") or name == "ocam" or (name == "usd" and not find_spec("pxr")):
            continue
        kept = {key: in_words_of(camera, form.models, lacks=form.lacks) if form.models else camera for key in named}
        if kept["camera"] is None:
            kept = {"camera": Camera.create("pinhole", PLAIN, image_size=(640, 480))}
        try:
            written = form.write(replace(result, cameras=kept), WriteOptions(unit_m=1.0))
        except InputError:  # it holds something else, such as a pair
            continue
        if isinstance(written, bytes):
            yield f"{name}{form.suffix}", written


def _archives(camera: Camera) -> Iterator[tuple[str, bytes]]:
    """What camera_calibration saves, packed and plain: damage to the plain one reaches what is inside."""
    result = read_cameras({"camera": camera})
    inside = {"ost.yaml": "camera-info", "ost.txt": "camera-info-ini"}
    for name, mode in (("calibrationdata.tar.gz", "w:gz"), ("calibrationdata.tar", "w")):
        stream = io.BytesIO()
        with tarfile.open(fileobj=stream, mode=mode) as archive:
            for file, form in inside.items():
                write = format_named(form).write
                content = b"" if write is None else write(result, WriteOptions())
                if isinstance(content, bytes):
                    member = tarfile.TarInfo(file)
                    member.size = len(content)
                    archive.addfile(member, io.BytesIO(content))
        yield name, stream.getvalue()
    write = format_named("camera-info-ini").write
    content = b"" if write is None else write(result, WriteOptions())
    if isinstance(content, bytes):
        yield "ost.txt", content


def mutated(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """A file with one to four mutations."""
    for _ in range(rng.choice((1, 1, 1, 1, 2, 4))):
        data = rng.choice(MUTATIONS)(data, others, rng)
    return data


def _at(data: bytes, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _change_byte(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if out:
            out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def _cut(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    a, b = sorted((_at(data, rng), _at(data, rng)))
    return data[:a] if rng.random() < 0.5 else data[:a] + data[b:]


def _again(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    a, b = sorted((_at(data, rng), _at(data, rng)))
    return data[:b] + data[a:b] * rng.choice((1, 1, 3)) + data[b:]


def _splice(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    other = rng.choice(others)
    return data[: _at(data, rng)] + other[_at(other, rng) :]


def _number(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    return _replaced(data, NUMBER, rng.choice(rng.choice((HOSTILE, MILD))), rng)


def _word(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    words = WORD.findall(rng.choice((data, rng.choice(others))))
    return _replaced(data, WORD, rng.choice(words) if words and rng.random() < 0.7 else rng.choice(HOSTILE), rng)


def _replaced(data: bytes, pattern: re.Pattern[bytes], new: bytes, rng: random.Random) -> bytes:
    found = list(pattern.finditer(data))
    if not found:
        return data
    at = rng.choice(found)
    return data[: at.start()] + new + data[at.end() :]


def _lines(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], rng.choice((lines[a], lines[b], b""))
    return b"\n".join(lines)


def _nest(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    open_, close = rng.choice(
        ((b"[", b"]"), (b"{a: ", b"}"), (b'{"a": ', b"}"), (b"- ", b""), (b"(", b")"), (b"<a>", b"</a>"), (b"p[", b"]"))
    )
    depth, at = rng.choice((1, 2, 40, 500, 3000)), _at(data, rng)
    return data[:at] + open_ * depth + close * rng.choice((depth, 0)) + data[at:]


def _insert(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    at = _at(data, rng)
    piece = rng.choice(
        (
            *HOSTILE,
            b"\0",
            b"\xff\xfe",
            b"\xef\xbb\xbf",
            b"\r",
            b"\x85",
            b",",
            b";",
            b"\t",
            b'"',
            b"'",
            b"#",
            b":",
            b"---\n",
            b"%YAML:1.0\n",
        )
    )
    return data[:at] + piece + data[at:]


def _spelled(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    try:
        return data.decode().encode(rng.choice(("utf-16", "utf-8-sig", "utf-32", "utf-16-le")))
    except UnicodeDecodeError:
        return data


MUTATIONS = (
    _change_byte,
    _cut,
    _again,
    _splice,
    _number,
    _number,
    _number,
    _word,
    _word,
    _lines,
    _nest,
    _insert,
    _insert,
    _spelled,
)


@dataclass(frozen=True)
class Fault:
    """A case that went wrong."""

    kind: str
    number: int
    name: str
    words: str
    trace: str


@dataclass(frozen=True)
class Tally:
    """What came of the cases: how many were read, refused, and wrong; the slowest, and how far memory grew."""

    read: int
    refused: int
    faults: tuple[Fault, ...]
    slowest: float
    slowest_case: str
    grown: float


def run(count: int, seed: int, *, only: str | None = None, one: int | None = None) -> Tally:
    """`count` cases in turn over all kinds. Args: only: one kind alone; one: the case of that number alone."""
    kinds = {name: kind for name, kind in corpus().items() if only is None or name == only}
    others = [data for kind in kinds.values() for _, data in kind.files]
    read = refused = 0
    faults: list[Fault] = []
    slowest, slowest_case = 0.0, ""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(count) if one is None else (one,):
            rng = random.Random(f"{seed}/{number}")
            name = list(kinds)[number % len(kinds)]
            file, data = rng.choice(kinds[name].files)
            path = Path(folder) / file
            path.write_bytes(mutated(data, others, rng))
            start = time.process_time()
            try:
                kinds[name].use(path)
                read += 1
            except CalibrantError:
                refused += 1
            except Exception as error:  # noqa: BLE001 - what is looked for
                faults.append(
                    Fault(name, number, file, f"{type(error).__name__}: {error}"[:200], traceback.format_exc())
                )
            taken = time.process_time() - start
            if taken > slowest:
                slowest, slowest_case = taken, f"{name} {number} ({file})"
            path.unlink(missing_ok=True)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return Tally(read, refused, tuple(faults), slowest, slowest_case, grown)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=[*corpus()])
    parser.add_argument("--one", type=int)
    asked = parser.parse_args()
    start = time.perf_counter()
    found = run(asked.count, asked.seed, only=asked.only, one=asked.one)
    for fault in found.faults if asked.one is not None else ():
        print(fault.trace)
    by_words: dict[str, list[Fault]] = {}
    for fault in found.faults:
        by_words.setdefault(f"{fault.kind}: {fault.words[:60]}", []).append(fault)
    for words, faults in sorted(by_words.items(), key=lambda item: -len(item[1])):
        print(f"{len(faults):5} {words}   e.g. {faults[0].name}, --one {faults[0].number}")
    total = found.read + found.refused + len(found.faults)
    print(
        f"{total} cases in {time.perf_counter() - start:.0f} s: {found.read} read, {found.refused} refused with words, "
        f"{len(found.faults)} internal errors; slowest {found.slowest:.2f} s of CPU ({found.slowest_case}), memory "
        f"grew by {found.grown / 1e6:.0f} MB"
    )
    passed = not found.faults and found.slowest < MOST_SECONDS and found.grown < MOST_GROWTH
    print("passed" if passed else "FAILED")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
