# %% [markdown]
# # A calibration in a notebook
#
# Open this file as a notebook (VS Code, PyCharm, or `jupytext --to ipynb examples/12_notebook.py`). A result as the
# last line of a cell shows itself; here it is printed, so that the file runs anywhere.

# %%
from __future__ import annotations

import numpy as np

import calibrant as cb
from calibrant.simulate.scenes import hand_eye_scene, intrinsics_scene

# %% [markdown]
# ## The camera
# 20 views of 88 corners, 0.1 px of noise. `from_points` takes what any detector found.

# %%
views = intrinsics_scene(20, seed=1).observations.views
observations = cb.Observations.from_points([v.points for v in views], [v.uv for v in views], image_size=(1280, 1024))
camera = cb.calibrate_intrinsics(observations, model="brown")
print(camera)

# %% [markdown]
# ## The camera on the gripper

# %%
scene = hand_eye_scene("noisy", seed=2)
result = cb.calibrate_hand_eye(scene.robot_poses, scene.observations, setup="eye-in-hand", camera=camera.camera)
print(result)

# %% [markdown]
# ## What there is to look at

# %%
T = result.transform("gripper", "camera")
print("sigma, mm:", np.round(T.sigma_translation_mm, 3), " deg:", np.round(T.sigma_rotation_deg, 4))
print("held out: ", result.held_out)
print("left out: ", [view.id for view in result.views if not view.used])
print("checks:   ", {check.name: check.status for check in result.checks})

# %%
page = result._repr_html_()  # what a notebook shows of `result`
print(f"in a notebook: {len(page)} characters of HTML; result.summary() has {len(result.summary().splitlines())} lines")
