"""OpenVINS's kalibr_imucam_chain.yaml: Kalibr's cameras, each with its own place on the IMU.

    X_imu = T_imu_cam X_cam        rotation from camera to IMU, position of the camera in the IMU's frame
    t_imu = t_cam + timeshift_cam_imu

Metres and seconds. (With T_cam_imu, as Kalibr writes it, the file is Kalibr's, and OpenVINS inverts it.) Source:
OpenVINS's docs, "Sensor calibration", and core/VioManagerOptions.h with utils/opencv_yaml_parse.h.
"""

from __future__ import annotations

from calibrant.data import CalibrationResult, as_transform
from calibrant.formats.cameras.calibrators.chain import LACKS, MODELS, USED, camera_lines
from calibrant.formats.cameras.calibrators.kalibr import (
    chain_cameras,
    chain_nodes,
    shift_line,
    shifts_of,
)
from calibrant.formats.cameras.calibrators.rigid import from_matrix, quoted, rows_text
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, imu_frame, places_in, world_of
from calibrant.reading.notes import note_unused


def _matches(document: Document) -> bool:
    return any("T_imu_cam" in node for node in chain_nodes(document.mapping).values())


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    nodes, source = chain_nodes(document.mapping), str(document.path)
    cameras = chain_cameras(nodes, options, source)
    places = tuple(
        as_transform(IMU, name, from_matrix(node["T_imu_cam"], f"{name}.T_imu_cam"))
        for name, node in nodes.items()
        if "T_imu_cam" in node
    )
    used = {*USED, "T_imu_cam", "timeshift_cam_imu"}
    unused = [f"{name}.{key}" for name, node in nodes.items() for key in node if key not in used]
    note_unused(source, [*(str(key) for key in document.mapping if key not in nodes), *unused])
    return read_cameras(cameras, transforms=places, figures=shifts_of(nodes))


def _write(result: CalibrationResult, options: WriteOptions) -> bytes:
    imu = imu_frame(result, options.answers.get("imu")) or world_of(result)
    places = places_in(result, imu, tuple(result.cameras))
    lines = ["%YAML:1.0", ""]
    for i, (name, camera) in enumerate(result.cameras.items()):
        lines += [f"cam{i}:", "  T_imu_cam:", rows_text(places[name], "    "), "  cam_overlaps: []"]
        lines += [*camera_lines(camera, "  "), f"  rostopic: {quoted(f'/{name}/image_raw')}", *shift_line(result, name)]
    return ("\n".join(lines) + "\n").encode()


FORMAT = ExchangeFormat(
    name="openvins",
    title="OpenVINS kalibr_imucam_chain (YAML)",
    suffix=".yaml",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(name for name in MODELS if name in ("pinhole", "brown", "kannala_brandt")),
    lacks=LACKS,
    asks=ASKS | {"imu": "the frame that is the IMU, where its name does not begin with imu"},
)
