"""Every format of cameras, rigs, scenes and transforms: one file each, one line here.

Specific formats stand before general ones: the first whose marks are in the content reads it. Modules are loaded when
their kind of content turns up: tree (JSON, YAML, TOML, OpenCV's FileStorage), xml, text, binary, folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module

from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat


@dataclass(frozen=True)
class Line:
    """module, attribute: where the format is, below calibrant.formats; content: the kinds of content that it can be
    found in; read: whether it is read at all."""

    module: str
    content: tuple[str, ...] = ("tree",)
    read: bool = True

    attribute: str = "FORMAT"

    def load(self) -> ExchangeFormat:
        """The format."""
        found: ExchangeFormat = getattr(import_module(f"calibrant.formats.{self.module}"), self.attribute)
        return found


FORMATS: dict[str, Line] = {
    "project": Line("projects.exchange", ("tree", "folder")),
    "calibrant": Line("cameras.calibrant_result"),
    "easycalib": Line("cameras.easycalib"),
    "easycalib-json": Line("cameras.easycalib", read=False, attribute="JSON_FORMAT"),
    "kalibr": Line("cameras.calibrators.kalibr"),
    "openvins": Line("cameras.calibrators.openvins"),
    "mrcal": Line("cameras.calibrators.mrcal", ("text",)),
    "basalt": Line("cameras.calibrators.basalt"),
    "euroc": Line("cameras.calibrators.euroc", ("tree", "folder")),
    "vins": Line("cameras.calibrators.vins", ("tree", "folder")),
    "camodocal": Line("cameras.calibrators.camodocal", ("tree", "folder")),
    "calib-io": Line("cameras.calibrators.calib_io"),
    "caliscope": Line("cameras.calibrators.caliscope"),
    "aniposelib": Line("cameras.calibrators.caliscope", attribute="ANIPOSELIB_FORMAT"),
    "ocam": Line("cameras.calibrators.ocam", ("text",)),
    "rovio": Line("cameras.calibrators.rovio", ("text", "folder")),
    "opencv-stereo": Line("cameras.opencv_pair", ("tree", "folder")),
    "opencv": Line("cameras.opencv_camera"),
    "camera-info": Line("cameras.ros.yaml_file"),
    "camera-info-ini": Line("cameras.ros.ini", ("text",)),
    "camera-info-pair": Line("cameras.ros.folder", ("folder",)),
    "camera-calibration": Line("cameras.ros.archive", ("binary",)),
    "easy-handeye": Line("transforms.easy_handeye"),
    "easy-handeye2": Line("transforms.easy_handeye", read=False, attribute="SECOND_FORMAT"),
    "ros1-static-transform": Line("transforms.command_lines", ("text",), attribute="ROS1_FORMAT"),
    "ros2-static-transform": Line("transforms.command_lines", read=False, attribute="ROS2_FORMAT"),
    "ros1-launch": Line("transforms.launch_xml", ("xml",), attribute="ROS1_FORMAT"),
    "ros2-launch-xml": Line("transforms.launch_xml", read=False, attribute="ROS2_FORMAT"),
    "ros2-launch": Line("transforms.launch_python", ("text",)),
    "moveit": Line("transforms.launch_python", read=False, attribute="MOVEIT_FORMAT"),
    "urdf-joint": Line("transforms.urdf_joint", ("xml",)),
    "usd": Line("scenes.usd", ("text", "binary")),
    "blender": Line("scenes.blender", ("tree", "text")),
    "unity": Line("scenes.unity"),
    "coppelia": Line("scenes.coppelia"),
    "mjcf": Line("scenes.mjcf", ("xml",)),
    "mjcf-body": Line("scenes.mjcf", read=False, attribute="BODY_FORMAT"),
    "xacro": Line("transforms.urdf_joint", read=False, attribute="XACRO_FORMAT"),
    "ur-pose": Line("transforms.maker_poses", read=False, attribute="UR"),
    "franka-pose": Line("transforms.maker_poses", read=False, attribute="FRANKA"),
    "kuka-pose": Line("transforms.maker_poses", read=False, attribute="KUKA"),
    "fanuc-pose": Line("transforms.maker_poses", read=False, attribute="FANUC"),
    "abb-pose": Line("transforms.maker_poses", read=False, attribute="ABB"),
    "yaskawa-pose": Line("transforms.maker_poses", read=False, attribute="YASKAWA"),
    "staubli-pose": Line("transforms.maker_poses", read=False, attribute="STAUBLI"),
    "kawasaki-pose": Line("transforms.maker_poses", read=False, attribute="KAWASAKI"),
    "colmap": Line("cameras.photogrammetry.colmap", ("text", "binary", "folder")),
    "nerf": Line("cameras.photogrammetry.nerf"),
    "bundler": Line("cameras.photogrammetry.bundler", ("text",)),
    "agisoft": Line("cameras.photogrammetry.agisoft", ("xml",)),
    "bouguet": Line("cameras.matlab.bouguet", ("text", "binary")),
    "matlab": Line("cameras.matlab.camera_parameters", ("text", "binary")),
    "realsense": Line("cameras.sensors.realsense", ("text",)),
    "azure-kinect": Line("cameras.sensors.azure_kinect"),
    "zed": Line("cameras.sensors.zed", ("text",)),
    "described": Line("cameras.described_file"),
}
"""By the name that `--to` and `--read-as` take."""


def format_named(name: str) -> ExchangeFormat:
    """The format of that name. Raises: InputError listing the names."""
    if name not in FORMATS:
        raise InputError(f"unknown format {name!r}; formats: {', '.join(FORMATS)}")
    return FORMATS[name].load()


def formats_for(document: Document) -> Iterator[tuple[str, ExchangeFormat]]:
    """Formats that may be in such a document, in the order in which they are asked."""
    kinds = content_of(document)
    for name, line in FORMATS.items():
        if line.read and kinds & set(line.content):
            yield name, line.load()


def content_of(document: Document) -> set[str]:
    """Which kinds of content a document has: a tree is a text as well."""
    if document.is_folder:
        return {"folder"}
    if document.text is None:
        return {"binary"}
    return (
        {"text"}
        | ({"tree"} if document.data is not None else set())
        | ({"xml"} if document.root is not None else set())
    )
