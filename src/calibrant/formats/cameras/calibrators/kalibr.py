"""Kalibr's camchain.yaml and camchain-imucam.yaml: cameras in a chain, and where each is to the IMU.

    X_camN = T_cn_cnm1 X_camN-1,   X_cam = T_cam_imu X_imu,   t_imu = t_cam + timeshift_cam_imu

Lengths in metres, times in seconds. Source: Kalibr's kalibr_common/ConfigReader.py (CameraChainParameters) and its
wiki, "Yaml formats".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.data.results import Measured
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.chain import (
    LACKS,
    MODELS,
    USED,
    camera_lines,
    chain_camera,
    is_chain_camera,
)
from calibrant.formats.cameras.calibrators.rigid import finite, from_matrix, quoted, rows_text
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    answer,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, graph_of, imu_frame
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

SHIFT = "timeshift "
_CAMERA = re.compile(r"^cam\d+$")
_ALIKE, _CONTRADICT = 1e-4, (2.0, 10.0)
"""Rad and m up to which the chain and the poses to the IMU say the same, and (deg, mm) from which they contradict: of
two calibrations of one rig they differ by less."""
_PLACES = ("chain", "imu")


def chain_nodes(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """cam0, cam1, … of a file, in the order of their numbers; none where one of them is no camera."""
    names = sorted((str(k) for k in data if _CAMERA.match(str(k))), key=lambda name: int(name[3:]))
    return {name: data[name] for name in names} if all(is_chain_camera(data[name]) for name in names) else {}


def _matches(document: Document) -> bool:
    nodes = chain_nodes(document.mapping)
    return bool(nodes) and not any("T_imu_cam" in node for node in nodes.values())


def chain_cameras(nodes: Mapping[str, Mapping[str, Any]], options: ReadOptions, source: str) -> dict[str, Camera]:
    """The camera of each of the file's nodes. Raises: InputError where there are none, or as `chain_camera`."""
    if not nodes:
        raise InputError("no cam0, cam1, … with camera_model and intrinsics in it")
    return {
        name: chain_camera(node, options.image_size, f"{source}: {name}", options.answers)
        for name, node in nodes.items()
    }


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    nodes, source = chain_nodes(document.mapping), str(document.path)
    cameras = chain_cameras(nodes, options, source)
    to_imu = {n: from_matrix(node["T_cam_imu"], f"{n}.T_cam_imu") for n, node in nodes.items() if "T_cam_imu" in node}
    places = _places(_links(nodes), to_imu, answer(options.answers, "places", _PLACES), source)
    used = {*USED, "T_cn_cnm1", "T_cam_imu", "timeshift_cam_imu"}
    unused = [f"{name}.{key}" for name, node in nodes.items() for key in node if key not in used]
    note_unused(source, [*(str(key) for key in document.mapping if key not in nodes), *unused])
    return read_cameras(cameras, transforms=tuple(places), figures=shifts_of(nodes))


def shifts_of(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Measured]:
    """Each camera's time shift to the IMU, s. Raises: InputError for one that is no number."""
    found = {}
    for name, node in nodes.items():
        if node.get("timeshift_cam_imu") is not None:
            value = finite(node["timeshift_cam_imu"], f"{name}.timeshift_cam_imu")
            if value.size != 1:
                raise InputError(f"{name}.timeshift_cam_imu holds {value.size} numbers, expected one, in seconds")
            found[f"{SHIFT}{name}"] = Measured(float(value[0]), unit="s")
    return found


def _links(nodes: Mapping[str, Mapping[str, Any]]) -> dict[tuple[str, str], Array]:
    """T_cnm1_cn between neighbours of the chain."""
    found = {}
    for before, name in pairwise(nodes):
        if nodes[name].get("T_cn_cnm1") is not None:
            T = from_matrix(nodes[name]["T_cn_cnm1"], f"{name}.T_cn_cnm1")
            found[before, name] = se3.inverse(T)
    return found


def _places(
    links: Mapping[tuple[str, str], Array], to_imu: Mapping[str, Array], asked: str | None, source: str
) -> list[TransformEstimate]:
    """The poses to the IMU, then what the chain adds. Where both say where a camera is the chain is taken, as of
    cameras to each other it was estimated, and it is said; or what was asked.

    Raises: InputError where they contradict beyond what two calibrations do.
    """
    doubled = [(a, b) for a, b in links if a in to_imu and b in to_imu]
    apart = {pair: se3.local(to_imu[pair[0]] @ se3.inverse(to_imu[pair[1]]), links[pair]) for pair in doubled}
    dropped = doubled
    for (a, b), delta in apart.items():
        mm, deg = (float(np.max(v)) for v in se3.mm_and_deg(delta))
        words = f"{b}.T_cn_cnm1 contradicts T_cam_imu of {a} and {b} by {mm:.3g} mm and {deg:.3g} deg"
        if asked is None and (deg > _CONTRADICT[0] or mm > _CONTRADICT[1]):
            raise InputError(f"{words}: say --answer places=chain or places=imu")
        if float(np.abs(delta).max()) > _ALIKE and asked != "imu":
            note(f"{source}: {words}; T_cn_cnm1 is taken between cameras")
            dropped = []
    kept = {name: T for name, T in to_imu.items() if dropped or not any(name == b for _, b in doubled)}
    return [as_transform(IMU, name, se3.inverse(T)) for name, T in kept.items()] + [
        as_transform(a, b, T) for (a, b), T in links.items() if (a, b) not in dropped
    ]


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    imu, graph = imu_frame(result, options.answers.get("imu")), graph_of(result)
    lines: list[str] = []
    before: str | None = None
    for i, (name, camera) in enumerate(result.cameras.items()):
        lines += [
            f"cam{i}:",
            *camera_lines(camera, "  "),
            "  cam_overlaps: []",
            f"  rostopic: {quoted(f'/{name}/image_raw')}",
        ]
        if imu is not None:
            lines += ["  T_cam_imu:", rows_text(graph.T(name, imu), "  "), *shift_line(result, name)]
        if before is not None:
            lines += ["  T_cn_cnm1:", rows_text(graph.T(name, before), "  ")]
        before = name
    return ("\n".join(lines) + "\n").encode()


def shift_line(result: CalibrationResult, name: str) -> list[str]:
    """The line of a camera's time shift; 0 where none is known."""
    shift = result.figures.get(f"{SHIFT}{name}")
    return [f"  timeshift_cam_imu: {digits(0.0 if shift is None else shift.value)}"]


FORMAT: ExchangeFormat = ExchangeFormat(
    name="kalibr",
    title="Kalibr camchain, camchain-imucam (YAML)",
    suffix=".yaml",
    matches=_matches,
    read=_read,
    write=_write,
    models=MODELS,
    lacks=LACKS,
    asks=ASKS
    | {
        "imu": "the frame that is the IMU, where its name does not begin with imu",
        "places": "chain (T_cn_cnm1) or imu (T_cam_imu), where these contradict",
    },
)
