"""Words that options choose from, for shells to complete: literals, so that help and completion load no library.

tests/tasks/options/test_choices.py compares them with the registries that they name.
"""

from __future__ import annotations

SETUPS = ("auto", "eye-in-hand", "eye-to-hand")
MODELS = (
    *("pinhole", "pinhole_skew", "brown", "rational", "thin_prism", "tilted", "inverse_brown", "division"),
    *("kannala_brandt", "unified", "extended_unified", "double_sphere", "orthographic", "splined", "auto"),
)
"""Camera models."""
METHODS = (
    *("joint", "tsai", "park", "horaud", "andreff", "daniilidis", "daniilidis-screw", "chou", "shah", "li"),
    *("dornaika", "convex", "mean"),
)
"""Ways to solve a hand-eye."""
MAKERS = ("ur", "franka", "kuka", "fanuc", "abb", "yaskawa", "staubli", "kawasaki")
UNITS = ("auto", "m", "mm", "cm", "in")
ANGLES = ("auto", "deg", "rad")
ROTATIONS = ("auto", "quat-xyzw", "quat-wxyz", "rotvec", "matrix", "euler:ZYX", "euler:XYZ", "euler:ZYZ", "euler:xyz")
DIRECTIONS = ("auto", "base-gripper", "gripper-base")
TARGET_DIRECTIONS = ("auto", "camera-target", "target-camera")
PAGES = ("auto", "fit", "a4", "a3", "a2", "a1", "a0", "letter", "tabloid")
PAIR_RULES = ("auto", "name", "order", "time")
"""How images of two cameras are paired."""
