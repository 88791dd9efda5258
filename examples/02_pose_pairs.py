"""Where is the camera on the gripper? From pairs of poses: the robot's, and the target's in the camera.

Then three data sets that look alike and cannot be right; each is refused, with the reason.
"""

from __future__ import annotations

import numpy as np

import calibrant as cb
from calibrant.simulate.scenes import hand_eye_scene

scene = hand_eye_scene("good", setup="eye-in-hand", seed=3)
T_base_gripper = scene.robot_poses.T_base_gripper  # (15, 4, 4), metres
T_camera_target = scene.measured_T_camera_target  # (15, 4, 4), as a detector would report them

result = cb.calibrate_hand_eye(T_base_gripper, T_camera_target, setup="eye-in-hand")
camera = result.transform("gripper", "camera")
print("T_gripper_camera:")
print(np.round(camera.matrix, 5))
print("1 sigma, mm: ", np.round(camera.sigma_translation_mm, 3), " deg:", np.round(camera.sigma_rotation_deg, 4))
error_mm = 1e3 * np.linalg.norm(camera.matrix[:3, 3] - scene.X[:3, 3])
print(f"off the truth by {error_mm:.3f} mm")

for name in ("parallel-axes", "pure-translation", "two-poses"):
    bad = hand_eye_scene(name, setup="eye-in-hand", seed=3)
    try:
        cb.calibrate_hand_eye(bad.robot_poses, bad.measured_T_camera_target, setup="eye-in-hand")
    except cb.RefusedError as refusal:
        print(f"\n{name} is refused: {refusal}")
    else:
        raise SystemExit(f"{name} must not give a result")
