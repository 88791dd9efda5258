"""The kinds of results there are. A new one is a file beside this one and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from calibrant.data import CalibrationResult
from calibrant.reports.kinds import (
    cameras,
    comparison,
    doctor,
    dynamic,
    hand_eye,
    intrinsics,
    kinematics,
    located,
    next_pose,
    observations,
    pose,
    rig,
    self_visibility,
    servoing,
    time_offset,
    tool,
    unchanged,
    undistorted,
    vanishing,
)
from calibrant.reports.kinds.eyes import depth, depth_camera, epipolar, pointing, projector, rectified, scan, stereo
from calibrant.reports.kinds.verified import runs, watch
from calibrant.reports.parts.kind import Kind
from calibrant.reports.parts.phrases import first_transform, placed

KINDS: Mapping[str, Kind] = {
    "intrinsics": intrinsics.KIND,
    "hand-eye": hand_eye.KIND,
    "rig": rig.KIND,
    "stereo": stereo.KIND,
    "doctor": doctor.KIND,
    "next-pose": next_pose.KIND,
    "kinematics": kinematics.KIND,
    "time-offset": time_offset.KIND,
    "tool": tool.KIND,
    "dynamic": dynamic.KIND,
    "self-visibility": self_visibility.KIND,
    "pose": pose.KIND,
    "located": located.KIND,
    "depth-scale": depth_camera.SCALE,
    "hand-eye-point": depth_camera.ONE_POINT,
    "vanishing": vanishing.KIND,
    "undistorted": undistorted.KIND,
    "rectified": rectified.KIND,
    "epipolar": epipolar.KIND,
    "depth": depth.KIND,
    "unchanged": unchanged.KIND,
    "watch": watch.KIND,
    "pinpoint": runs.PINPOINT,
    "touch": runs.TOUCH,
    "stitch": runs.STITCH,
    "pick-place": runs.PICK_PLACE,
    "held-out": runs.HELD_OUT,
    "observations": observations.KIND,
    "cameras": cameras.KIND,
    "comparison": comparison.KIND,
    "pointing": pointing.KIND,
    "projector": projector.KIND,
    "scan": scan.KIND,
    "servo-target": servoing.TARGET,
    "servo": servoing.RUN,
}


def kind_of(result: CalibrationResult) -> Kind:
    """The kind of a result; for one that nobody registered, its name as the title and what every result has."""
    head = placed if result.transforms else intrinsics.KIND.headline
    return KINDS.get(result.kind) or Kind(f"Calibration: {result.kind}", head, first_transform)
