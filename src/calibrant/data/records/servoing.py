"""Records of servoing: what was taught, and how a run went."""

from __future__ import annotations

from dataclasses import dataclass

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Row = tuple[float, float, float, float]


@dataclass(frozen=True)
class TaughtFeatures:
    """What a camera sees from where it is wanted.

    target: spec of what bears the features; setup: eye-in-hand or eye-to-hand; ids, uv_px, sigma_px (per axis) and
    depth_m of each; points_m: the target's points, its frame; T_camera_target: rows of the wanted pose, metres;
    from_: "picture" or "stereo"; pictures: how many were averaged; T_base_gripper: where the arm stood, where that is
    known.
    """

    target: str
    setup: str
    image_size: tuple[int, int]
    ids: tuple[int, ...]
    uv_px: tuple[Pair, ...]
    sigma_px: tuple[float, ...]
    depth_m: tuple[float, ...]
    points_m: tuple[Triple, ...]
    T_camera_target: tuple[Row, ...]
    from_: str
    pictures: int
    T_base_gripper: tuple[Row, ...] = ()


@dataclass(frozen=True)
class ServoSample:
    """One picture of a run: seconds from its start; whether the arm stood; rms of the features' error per axis; what
    remained with 1 sigma; the gain, 1/s; the camera's speeds; the arm's smallest singular value (None at the end)."""

    time_s: float
    resting: bool
    error_px: float
    mm: float
    deg: float
    sigma_mm: float
    sigma_deg: float
    gain: float
    mm_s: float
    deg_s: float
    manipulability: float | None = None
    held_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class ServoTrace:
    """How a run went, picture by picture."""

    control: str
    samples: tuple[ServoSample, ...]
