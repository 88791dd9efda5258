"""Hand-eye from a bag: its pictures in place of photos, and the robot's pose at each in place of a file of poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs import session
from calibrant.tasks.inputs.bags.topics import ONLY, bag_files
from calibrant.tasks.robots.hand_eye_list import ListRequest

if TYPE_CHECKING:
    from calibrant.calibrate.clocks.offset import TimeOffset
    from calibrant.data import CalibrationResult, Check
    from calibrant.formats.poses.read import RawPoses
    from calibrant.tasks.inputs.bags.poses import PosedPictures
    from calibrant.tasks.options.bags import PosedBagOptions

LARGEST_S = 2.0
"""How far the clocks are searched to either side."""


@dataclass(frozen=True, eq=False)
class BagLists:
    """images as --images would name them; raw: the pose of each; later: the poses for an offset of the clocks that is
    larger by its sigma, where it was found; offset: what was found."""

    images: tuple[str, ...]
    raw: RawPoses
    words: str
    later: RawPoses | None = None
    offset: TimeOffset | None = None

    @property
    def checks(self) -> tuple[Check, ...]:
        """What the result says of its moments and clocks."""
        from calibrant.data import Check

        found = self.offset
        if found is None:
            return (Check("moments", "ok", self.words),)
        clocks = (
            f"t_robot = t_camera {'+' if found.offset >= 0 else '−'} {abs(1e3 * found.offset):.3f} ms ± "
            f"{1e3 * found.sigma:.3f} ms, found from the motion; what its sigma moves the result by is in every sigma"
        )
        return (Check("moments", "ok", self.words), Check("time-offset", "ok", clocks, found.offset))


def require_one_source(options: PosedBagOptions, *, images: Sequence[str], poses: Sequence[str], points: bool) -> None:
    """Raises: InputError where neither a bag nor poses are given, or both, or photos beside a bag."""
    options.check()
    if options.bag is None:
        if not poses:
            raise InputError("robot poses are missing: give --poses FILES, or a recording that has them, --bag FILE")
        return
    for option, given in (("--images", bool(images)), ("--poses", bool(poses)), ("--observations", points)):
        if given:
            raise InputError(f"{option}: the bag has pictures and poses; give --bag FILE or {option}, not both")


def read_bag(
    options: PosedBagOptions, common: ListRequest, target: str | None, cameras: Mapping[str, Path], setup: str
) -> BagLists:
    """The bag's pictures and poses; on the move, with the offset of the clocks found first.

    Args: common: what all lists have in common; target, setup: of the only camera.
    Raises: InputError, RefusedError as the parts do.
    """
    from calibrant.tasks.inputs.bags.poses import posed_pictures

    with common.listener.status("Reading the bag …"):
        posed = posed_pictures(options, common.arm)
    if options.moments == "still" or options.offset_s is not None:
        return BagLists(_images(posed), posed.raw(), posed.words)
    if len(posed.pictures) > 1:
        raise InputError(
            "--moments moving finds the offset of one camera's clock: calibrate each camera by itself, or give the "
            "offset they share (--clock-offset)"
        )
    return _on_the_move(posed, common, target, next(iter(cameras.values()), None), setup)


def _on_the_move(
    posed: PosedPictures, common: ListRequest, target: str | None, camera: Path | None, setup: str
) -> BagLists:
    from calibrant.formats.cameras.read import read_camera
    from calibrant.tasks.inputs.bags.clocks import clock_offset, seen_motion, thinned
    from calibrant.tasks.options.words import split_names

    (name, recorded), *_ = posed.pictures.items()
    recorded = thinned(recorded)
    source = replace(common, images=tuple(map(str, recorded.files)), target=target).source
    found = source.read(source.files())
    session.load_solver(common.listener)
    size = next(iter(found.image_sizes.values()))
    lens = None if camera is None else read_camera(camera, image_size=size)
    with common.listener.status("Aligning the clocks …"):
        seen = seen_motion(found, recorded, lens, common.lens.model, split_names(common.lens.fix))
        try:
            offset, _ = clock_offset(posed.robot, seen, setup=setup, largest=LARGEST_S)
        except RefusedError as error:
            raise RefusedError(f"the offset of the clocks: {error}") from error
    only = replace(posed, pictures={name: recorded})
    here = only.shifted(offset.offset)
    later = replace(only, pictures=here.pictures).shifted(offset.offset + offset.sigma)
    words = f"{len(here.raw())} {here.words}, each with the pose at its time"
    return BagLists(_images(here), here.raw(), words, later.raw(), offset)


def _images(posed: PosedPictures) -> tuple[str, ...]:
    return tuple(
        f"{name}={file}" if name != ONLY else str(file) for name, p in posed.pictures.items() for file in p.files
    )


def poses_named(options: PosedBagOptions, poses: tuple[str, ...]) -> tuple[str, ...]:
    """What stands for the files of poses: the bag's own files, where one is given."""
    return poses if options.bag is None else tuple(bag_files(options.bag))


def with_offset_error(result: CalibrationResult, later: CalibrationResult) -> CalibrationResult:
    """The result with what an error of the offset by its sigma moves every transform by, d, in its covariance:

        C + d d^T.

    later: the result at the offset that is larger by its sigma.
    """
    import numpy as np

    from calibrant.geometry import se3

    moved = {(t.parent, t.child): se3.local(t.matrix, o.matrix) for t, o in zip(result.transforms, later.transforms)}
    transforms = tuple(
        t if t.covariance is None else replace(t, covariance=t.covariance + np.outer(d, d))
        for t in result.transforms
        for d in (moved[t.parent, t.child],)
    )
    joint = result.joint_covariance
    if joint is not None and all(frame in moved for frame in joint.frames):
        d = np.concatenate([moved[frame] for frame in joint.frames])
        joint = replace(joint, matrix=joint.matrix + np.outer(d, d))
    return replace(result, transforms=transforms, joint_covariance=joint)
