"""Coloured cubes on a table: where their centres are, with covariance; nothing typed in but their side."""

from __future__ import annotations

from calibrant.cameras import Camera
from calibrant.data.devices import Picture
from calibrant.errors import InputError, RefusedError
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import find_segments
from calibrant.perceive.object_pose.locate import locate
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.seen import Scene
from calibrant.perceive.object_pose.shapes import box
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig

BASELINE_M = 0.050
"""Of the D435; a longer one has less noise, which the table shows."""


def locate_cubes(
    picture: Picture,
    camera: Camera,
    colour: ColourRange,
    *,
    side: float,
    rig: DepthRig | None = None,
    noise: DepthNoise | None = None,
) -> list[ObjectPose]:
    """T_camera_cube of every cube of a colour, largest in the picture first; the cube's frame stands in its middle.

    Args: camera: of the colour picture; side, metres; rig: where depth has a camera of its own, else it is in the
    colour picture's grid; noise: of the depth, by default a D435's at its focal length. Raises: InputError for a
    picture without depth; RefusedError where no cube was located, with the reason for each part of that colour.
    """
    if picture.depth is None:
        raise InputError(f"picture {picture.name} has no depth: where a cube is, its colour alone does not tell")
    cameras = rig or DepthRig.aligned(camera)
    if noise is None:
        noise = DepthNoise.stereo(focal_px=cameras.depth.parameters["fx"], baseline_m=BASELINE_M)
    scene = Scene.of(picture.colour, picture.depth, cameras, noise=noise)
    found = find_segments(picture.colour, colour)
    if not found:
        raise RefusedError(f"picture {picture.name}: nothing has the colour {colour.spec}; is a cube in view?")
    cube, poses, reasons = box([side] * 3, name="cube"), [], []
    for segment in found:
        try:
            poses.append(locate(scene, segment, cube, others=[s for s in found if s is not segment]))
        except RefusedError as error:
            reasons.append(f"{segment.words}: {error}")
    if not poses:
        raise RefusedError(f"picture {picture.name}: no cube was located. " + "\n".join(reasons))
    return poses
