"""calibrant: calibrate cameras and robots, and prove it.

The names below are the public API; each loads what it needs on first use, so that `import calibrant` stays light.
"""

from __future__ import annotations

from calibrant.version import __version__ as __version__

# As `typing` has it, which takes longer to load than Ctrl-C may find nobody to answer it.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from calibrant import geometry as geometry
    from calibrant.calibrate.cell.calibrate import calibrate_cell as calibrate_cell
    from calibrant.calibrate.cell.calibrate import calibrate_several as calibrate_several
    from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye as calibrate_hand_eye
    from calibrant.calibrate.cell.problem.joint_offsets import JointReadings as JointReadings
    from calibrant.calibrate.cell.problem.layout import Pictures as Pictures
    from calibrant.calibrate.cell.problem.layout import TargetPoses as TargetPoses
    from calibrant.calibrate.cell.problem.touches import Touches as Touches
    from calibrant.calibrate.cell.rig import calibrate_rig as calibrate_rig
    from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics as calibrate_intrinsics
    from calibrant.calibrate.stereo.calibrate import calibrate_stereo as calibrate_stereo
    from calibrant.cameras import Camera as Camera
    from calibrant.data import CalibrationResult as CalibrationResult
    from calibrant.data import Check as Check
    from calibrant.data import Observations as Observations
    from calibrant.data import RobotPoses as RobotPoses
    from calibrant.data import View as View
    from calibrant.data import result_file
    from calibrant.detection.pipeline import detect as detect
    from calibrant.errors import CalibrantError as CalibrantError
    from calibrant.errors import InputError as InputError
    from calibrant.errors import RefusedError as RefusedError
    from calibrant.geometry.frames import FrameGraph as FrameGraph
    from calibrant.reports.html import write_report as write_report
    from calibrant.targets.registry import parse_target as parse_target
    from calibrant.tasks.inputs.pose_files import read_poses as read_poses
    from calibrant.tasks.verbs import capture as capture
    from calibrant.tasks.verbs import compare as compare
    from calibrant.tasks.verbs import convert as convert
    from calibrant.tasks.verbs import demo as demo
    from calibrant.tasks.verbs import depth as depth
    from calibrant.tasks.verbs import doctor as doctor
    from calibrant.tasks.verbs import dynamic as dynamic
    from calibrant.tasks.verbs import epipolar as epipolar
    from calibrant.tasks.verbs import hand_eye as hand_eye
    from calibrant.tasks.verbs import hand_eye_point as hand_eye_point
    from calibrant.tasks.verbs import intrinsics as intrinsics
    from calibrant.tasks.verbs import kinematics as kinematics
    from calibrant.tasks.verbs import locate as locate
    from calibrant.tasks.verbs import next_pose as next_pose
    from calibrant.tasks.verbs import point as point
    from calibrant.tasks.verbs import pose as pose
    from calibrant.tasks.verbs import project_add as project_add
    from calibrant.tasks.verbs import project_check as project_check
    from calibrant.tasks.verbs import project_list as project_list
    from calibrant.tasks.verbs import project_new as project_new
    from calibrant.tasks.verbs import project_remove as project_remove
    from calibrant.tasks.verbs import project_rename as project_rename
    from calibrant.tasks.verbs import project_set as project_set
    from calibrant.tasks.verbs import project_solve as project_solve
    from calibrant.tasks.verbs import project_status as project_status
    from calibrant.tasks.verbs import projector_calibrate as projector_calibrate
    from calibrant.tasks.verbs import projector_patterns as projector_patterns
    from calibrant.tasks.verbs import rectify as rectify
    from calibrant.tasks.verbs import report as report
    from calibrant.tasks.verbs import rig as rig
    from calibrant.tasks.verbs import ros_launch as ros_launch
    from calibrant.tasks.verbs import ros_run as ros_run
    from calibrant.tasks.verbs import scan as scan
    from calibrant.tasks.verbs import servo_conveyor as servo_conveyor
    from calibrant.tasks.verbs import servo_run as servo_run
    from calibrant.tasks.verbs import servo_teach as servo_teach
    from calibrant.tasks.verbs import stereo as stereo
    from calibrant.tasks.verbs import study_methods as study_methods
    from calibrant.tasks.verbs import study_paper_tables as study_paper_tables
    from calibrant.tasks.verbs import target as target
    from calibrant.tasks.verbs import time_offset as time_offset
    from calibrant.tasks.verbs import tool_seen as tool_seen
    from calibrant.tasks.verbs import tool_self_visibility as tool_self_visibility
    from calibrant.tasks.verbs import tool_touch as tool_touch
    from calibrant.tasks.verbs import undistort as undistort
    from calibrant.tasks.verbs import vanishing as vanishing
    from calibrant.tasks.verbs import verify_depth as verify_depth
    from calibrant.tasks.verbs import verify_held_out as verify_held_out
    from calibrant.tasks.verbs import verify_pick_place as verify_pick_place
    from calibrant.tasks.verbs import verify_pinpoint as verify_pinpoint
    from calibrant.tasks.verbs import verify_stitch as verify_stitch
    from calibrant.tasks.verbs import verify_touch as verify_touch
    from calibrant.tasks.verbs import verify_unchanged as verify_unchanged
    from calibrant.tasks.verbs import verify_watch as verify_watch

    read = result_file.read_result


_PUBLIC = {
    "CalibrantError": ("calibrant.errors", "CalibrantError"),
    "CalibrationResult": ("calibrant.data", "CalibrationResult"),
    "Camera": ("calibrant.cameras", "Camera"),
    "Check": ("calibrant.data", "Check"),
    "FrameGraph": ("calibrant.geometry.frames", "FrameGraph"),
    "InputError": ("calibrant.errors", "InputError"),
    "JointReadings": ("calibrant.calibrate.cell.problem.joint_offsets", "JointReadings"),
    "Observations": ("calibrant.data", "Observations"),
    "RefusedError": ("calibrant.errors", "RefusedError"),
    "Pictures": ("calibrant.calibrate.cell.problem.layout", "Pictures"),
    "Touches": ("calibrant.calibrate.cell.problem.touches", "Touches"),
    "RobotPoses": ("calibrant.data", "RobotPoses"),
    "TargetPoses": ("calibrant.calibrate.cell.problem.layout", "TargetPoses"),
    "View": ("calibrant.data", "View"),
    "calibrate_cell": ("calibrant.calibrate.cell.calibrate", "calibrate_cell"),
    "calibrate_hand_eye": ("calibrant.calibrate.cell.hand_eye", "calibrate_hand_eye"),
    "calibrate_intrinsics": ("calibrant.calibrate.intrinsics.calibrate", "calibrate_intrinsics"),
    "calibrate_rig": ("calibrant.calibrate.cell.rig", "calibrate_rig"),
    "calibrate_stereo": ("calibrant.calibrate.stereo.calibrate", "calibrate_stereo"),
    "calibrate_several": ("calibrant.calibrate.cell.calibrate", "calibrate_several"),
    "detect": ("calibrant.detection.pipeline", "detect"),
    "compare": ("calibrant.tasks.verbs", "compare"),
    "convert": ("calibrant.tasks.verbs", "convert"),
    "depth": ("calibrant.tasks.verbs", "depth"),
    "doctor": ("calibrant.tasks.verbs", "doctor"),
    "dynamic": ("calibrant.tasks.verbs", "dynamic"),
    "undistort": ("calibrant.tasks.verbs", "undistort"),
    "rig": ("calibrant.tasks.verbs", "rig"),
    "stereo": ("calibrant.tasks.verbs", "stereo"),
    "study_methods": ("calibrant.tasks.verbs", "study_methods"),
    "study_paper_tables": ("calibrant.tasks.verbs", "study_paper_tables"),
    "demo": ("calibrant.tasks.verbs", "demo"),
    "capture": ("calibrant.tasks.verbs", "capture"),
    "geometry": ("calibrant.geometry", ""),
    "epipolar": ("calibrant.tasks.verbs", "epipolar"),
    "hand_eye_point": ("calibrant.tasks.verbs", "hand_eye_point"),
    "hand_eye": ("calibrant.tasks.verbs", "hand_eye"),
    "intrinsics": ("calibrant.tasks.verbs", "intrinsics"),
    "kinematics": ("calibrant.tasks.verbs", "kinematics"),
    "locate": ("calibrant.tasks.verbs", "locate"),
    "next_pose": ("calibrant.tasks.verbs", "next_pose"),
    "parse_target": ("calibrant.targets.registry", "parse_target"),
    "point": ("calibrant.tasks.verbs", "point"),
    "pose": ("calibrant.tasks.verbs", "pose"),
    "project_add": ("calibrant.tasks.verbs", "project_add"),
    "project_check": ("calibrant.tasks.verbs", "project_check"),
    "project_list": ("calibrant.tasks.verbs", "project_list"),
    "project_new": ("calibrant.tasks.verbs", "project_new"),
    "project_remove": ("calibrant.tasks.verbs", "project_remove"),
    "project_rename": ("calibrant.tasks.verbs", "project_rename"),
    "project_set": ("calibrant.tasks.verbs", "project_set"),
    "project_solve": ("calibrant.tasks.verbs", "project_solve"),
    "project_status": ("calibrant.tasks.verbs", "project_status"),
    "projector_calibrate": ("calibrant.tasks.verbs", "projector_calibrate"),
    "projector_patterns": ("calibrant.tasks.verbs", "projector_patterns"),
    "read": ("calibrant.data.result_file", "read_result"),
    "read_poses": ("calibrant.tasks.inputs.pose_files", "read_poses"),
    "rectify": ("calibrant.tasks.verbs", "rectify"),
    "report": ("calibrant.tasks.verbs", "report"),
    "ros_launch": ("calibrant.tasks.verbs", "ros_launch"),
    "ros_run": ("calibrant.tasks.verbs", "ros_run"),
    "scan": ("calibrant.tasks.verbs", "scan"),
    "target": ("calibrant.tasks.verbs", "target"),
    "time_offset": ("calibrant.tasks.verbs", "time_offset"),
    "tool_seen": ("calibrant.tasks.verbs", "tool_seen"),
    "tool_self_visibility": ("calibrant.tasks.verbs", "tool_self_visibility"),
    "tool_touch": ("calibrant.tasks.verbs", "tool_touch"),
    "vanishing": ("calibrant.tasks.verbs", "vanishing"),
    "verify_depth": ("calibrant.tasks.verbs", "verify_depth"),
    "verify_held_out": ("calibrant.tasks.verbs", "verify_held_out"),
    "verify_pick_place": ("calibrant.tasks.verbs", "verify_pick_place"),
    "verify_pinpoint": ("calibrant.tasks.verbs", "verify_pinpoint"),
    "verify_stitch": ("calibrant.tasks.verbs", "verify_stitch"),
    "verify_touch": ("calibrant.tasks.verbs", "verify_touch"),
    "verify_unchanged": ("calibrant.tasks.verbs", "verify_unchanged"),
    "verify_watch": ("calibrant.tasks.verbs", "verify_watch"),
    "servo_teach": ("calibrant.tasks.verbs", "servo_teach"),
    "servo_run": ("calibrant.tasks.verbs", "servo_run"),
    "servo_conveyor": ("calibrant.tasks.verbs", "servo_conveyor"),
    "write_report": ("calibrant.reports.html", "write_report"),
}

__all__ = [*_PUBLIC, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'calibrant' has no attribute {name!r}; it has {', '.join(__all__)}")
    from importlib import import_module

    module, attribute = _PUBLIC[name]
    found = import_module(module)
    value = getattr(found, attribute) if attribute else found
    called = getattr(value, "__name__", name)
    if called != name and called in _PUBLIC:
        value = globals().get(called) or __getattr__(called)  # an older name of the same function
    elif callable(value) and not isinstance(value, type) and module != "calibrant.tasks.verbs":
        from calibrant.advice import python_door

        value = python_door(value, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
