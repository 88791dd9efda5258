"""What a finished cell says of errors that its poses share."""

from __future__ import annotations

import numpy as np

from calibrant.calibrate.cell.certainty.given_lens import LensDoubt
from calibrant.calibrate.cell.certainty.lens import LensShift
from calibrant.calibrate.cell.certainty.neighbours import NeighbourErrors
from calibrant.cameras import Camera
from calibrant.data import Check
from calibrant.data.details import ArmError

LIKELY = 0.99
"""Chance from which errors are said to be shared; sigma holds them from the first per cent on."""
ORDER_LIKELY = 0.9
"""Share of that chance from which the order of the poses is named as what they go by."""


def shared_errors_check(found: NeighbourErrors, growth: float) -> tuple[Check, ...]:
    """Do neighbouring poses err alike? growth: sigma of the camera's position over that of independent errors."""
    if found.chance < LIKELY:
        return ()
    alike = (
        "poses taken one after the other err alike: something drifts or lags"
        if found.order > ORDER_LIKELY * found.chance
        else "poses near each other err alike: the robot's geometry, or the images' target poses"
    )
    return (
        Check("shared-errors", "ok", f"{alike}; sigma holds it, {growth:.2g} times that of independent errors", growth),
    )


def geometry_check(found: ArmError, *, seen: bool, identified: bool) -> Check:
    """How far may the arm's own geometry be off, beside what sigma holds? seen: whether its poses show that it is;
    identified: whether its geometry was found with the rest, as far as asked."""
    arm, camera = f"{found.unseen_mm:.2g} mm", f"{found.camera_mm:.2g} mm"
    held = (
        f"the robot's poses err as those of an arm that is off by {found.held_mm:.2g} mm, which sigma holds; "
        if seen
        else ""
    )
    could = (
        f"the poses tell little of the arm's own geometry: {arm} at the flange, assumed, as of an arm as delivered, "
        f"would move the camera by {camera}"
        if found.assumed
        else f"errors of the arm's own geometry of up to {arm} at the flange (95 %) do not show in these poses, and "
        f"would move the camera by {camera}"
    )
    cure = "--robot-accuracy says how large they are" + ("" if identified else ", --identify finds them")
    return Check("robot-geometry", "ok", f"{held}{could} (1σ), smoother ones by more: {cure}", found.camera_mm)


ROBOT_BENDS = ("the robot's poses", "the robot's errors (--identify)")
"""Who bends a lens, and what to look for."""
BY_ROBOT, BY_OTHERS = "lens-by-robot", "lens-by-others"
"""What the check is called of a cell with robots, and of a rig, which has none."""


def lens_shift_check(camera: Camera, found: LensShift, *, rig: bool = False) -> tuple[Check, ...]:
    """Do the robot's poses, or the other cameras of a rig, bend the lens away from what its photos say?"""
    if not found.bent:
        return ()
    known = found.sigma > 0
    k = int(np.argmax(np.where(known, np.abs(found.moved) / np.where(known, found.sigma, 1.0), 0.0)))
    name, value = camera.model.parameter_names[k], float(camera.values[k])
    who, cure = ("the other cameras", "what moved, or whose clock is late") if rig else ROBOT_BENDS
    message = (
        f"{who} bend the lens: {name} is {value:.6g} with them and {value - float(found.moved[k]):.6g} ± "
        f"{float(found.sigma[k]):.2g} by the photos alone; sigma holds it. Give a camera calibrated by itself "
        f"(--camera), or find {cure}"
    )
    return (Check(BY_OTHERS if rig else BY_ROBOT, "warn", message, float(np.abs(found.moved[k]) / found.sigma[k])),)


def given_lens_check(camera: Camera, found: LensDoubt, *, rig: bool = False) -> tuple[Check, ...]:
    """Is a lens that was given as exact the one that took the pictures?"""
    if not found.wrong:
        return ()
    k = int(np.argmax(np.abs(found.moved / found.sigma)))
    value = float(camera.values[camera.model.parameter_names.index(found.names[k])])
    message = (
        f"{'the other cameras' if rig else 'robot'} and pictures contradict the lens that was given: {found.names[k]} "
        f"is {value:.6g} as given and "
        f"{value + float(found.moved[k]):.6g} ± {float(found.sigma[k]):.2g} by them; sigma holds the difference. Is it "
        "this camera's, at this size and focus? Without --camera the photos calibrate it"
    )
    return (Check("given-lens", "warn", message, float(np.abs(found.moved[k]) / found.sigma[k])),)


def untold_lens_check(name: str, found: LensDoubt, metres: float) -> Check:
    """What sigma holds nothing of: a lens that was given as exact, as far as the pictures do not tell it."""
    told = ", ".join(f"{n} to {s:.2g} px" for n, s in zip(found.names, found.sigma))
    message = (
        f"the lenses count as exact and the pictures agree with them, but of {name} they only tell {told}: off by as "
        f"much, it would move a camera by {1e3 * metres:.2g} mm, which sigma does not hold. Give cameras with their "
        "uncertainty (a result of calibrant), or leave --camera out"
    )
    return Check("exact-lenses", "ok", message, 1e3 * metres)
