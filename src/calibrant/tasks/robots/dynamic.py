"""Locate a camera beside the robot: read the wrist's calibration and the photos, take the views in one by one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import SILENT, Listener
from calibrant.tasks.options.words import pixels
from calibrant.tasks.outcome import Outcome
from calibrant.tasks.robots.dynamic_request import PLACEMENTS, Needed, Request, needed, reads
from calibrant.tasks.robots.dynamic_views import (
    DO_NOT_FIT,
    NO_FIT,
    Taken,
    boards,
    dynamic_result,
    own_noise,
    take_in,
    wrist_of,
)

if TYPE_CHECKING:
    from calibrant.formats.poses.read import PoseNotation

EXAMPLE = (
    'cb.dynamic(wrist="hand-eye.json", camera="front.json", wrist_images="wrist", external_images="front", '
    'poses="poses.csv", target="chessboard:9x6:25mm")'
)


def run(request: Request, listener: Listener = SILENT) -> Outcome:
    """The external camera in the base. Raises: InputError; RefusedError where the photos do not fit together."""
    from calibrant.data.verdicts import refuse_if_failed
    from calibrant.formats.cameras.read import read_camera
    from calibrant.formats.poses.pairing import match_raw
    from calibrant.tasks.inputs.pose_choice import best_reading

    if request.target_stands not in PLACEMENTS:
        raise InputError(f"--target-stands {request.target_stands}: choose {' or '.join(PLACEMENTS)}")
    if request.live:
        from calibrant.tasks.robots.dynamic_live import live

        return live(request, listener)
    if request.cell or request.wanted is not None or request.pictures or request.device.camera_device is not None:
        raise InputError("--cell, --wanted, --pictures and --camera-device go with --live")
    wrist, noise = wrist_of(needed(request).wrist)
    raw = request.form.read(request.poses, request.arm)
    near = boards(request, request.wrist_images, "wrist", listener)
    far = boards(request, request.external_images, "external", listener)
    if request.target_stands == "moves" and len(near.views) != len(far.views):
        raise InputError(
            f"{len(near.views)} photos of the wrist camera and {len(far.views)} of the external one show the board; "
            "where the target moves, the n-th photos of both belong together: leave out those without a partner"
        )
    external = read_camera(needed(request).camera, image_size=next(iter(far.image_sizes.values())))
    pairing = match_raw(raw, [v.id for v in near.views])
    session.load_solver(listener)
    given = pixels(request.sigma_px, option="--sigma-px")
    noise = replace(noise, external_px=given or own_noise(external, far.views) or noise.external_px)

    def attempt(reading: PoseNotation) -> Taken:
        T = reading.T_base_gripper[list(pairing.pose_index)]
        views = [near.views[i] for i in pairing.view_index]
        return take_in(wrist, external, noise, views, T, far.views, moves=request.target_stands == "moves")

    with listener.status("Taking in the views …"):
        chosen = best_reading(
            raw, attempt, lambda t: t.known.solution.cost if t.known.solution else float("inf"),
            fits=lambda t: t.off < NO_FIT, what=DO_NOT_FIT,
        )  # fmt: skip
    result = dynamic_result(chosen.outcome, request, chosen.reading.description, pairing.message, noise)
    refuse_if_failed(result)
    return Outcome(result=result)


__all__ = ["EXAMPLE", "NO_FIT", "Needed", "Request", "reads", "run", "take_in", "wrist_of"]
