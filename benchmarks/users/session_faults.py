"""What goes wrong between a robot and its camera. Each changes a session in place, before it is recorded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from users.cell import IN_HAND, Session, misled, seen_from
from users.photos import Photos
from users.rigid import back, moved, rigid, turn
from users.robot import Fault

Edit = Callable[[Session], None]


def seen(edit: Callable[[Photos], None]) -> Edit:
    """A fault of the photos, board or lens; the camera stays where it is."""

    def change(session: Session) -> None:
        edit(session.photos)

    return change


def arm(fault: Fault, *, average: bool = False) -> Edit:
    """A fault of the arm, see `cell.misled`."""

    def change(session: Session) -> None:
        misled(session, fault, average=average)

    return change


def drift(mm: float, deg: float, *, walk: bool = False) -> Edit:
    """The arm's stand (or a warming arm) moves by `mm`, `deg` over the session, evenly or as a random walk."""

    def change(session: Session) -> None:
        v, rng = len(session), session.rng
        size = np.array([np.deg2rad(deg)] * 3 + [1e-3 * mm] * 3)
        way = np.linspace(-0.5, 0.5, v)[:, None] * rng.standard_normal(6)
        if walk:
            way = np.cumsum(rng.standard_normal((v, 6)), axis=0) / np.sqrt(v)
        session.stand(moved(np.eye(4), size * (way - way.mean(axis=0))) @ session.true)

    return change


def late(seconds: float, *, speed: float = 0.1, turning: float = 10.0) -> Edit:
    """Photos are taken in motion towards the next view (m/s, deg/s), the poses are of `seconds` before."""

    def change(session: Session) -> None:
        rng, T = session.rng, session.true
        ahead = np.diff(T[:, :3, 3], axis=0, append=T[-1:, :3, 3] + 0.01)
        ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        axis = rng.standard_normal((len(T), 3))
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        gone = np.concatenate([np.deg2rad(turning) * axis, speed * ahead], axis=1) * seconds
        session.reported = moved(session.reported, -gone)

    return change


def pivoting(session: Session) -> None:
    """All motions turn about one point, as a spherical wrist's or a ball joint's do; target poses instead of photos."""
    v, rng = len(session), session.rng
    at = session.true[0, :3, 3] + rng.uniform(-0.1, 0.1, 3)
    T = rigid(turn(rng.uniform(-0.6, 0.6, (v, 3))), np.zeros(3))
    about = rigid(np.eye(3), at)
    session.stand(about @ T @ back(about) @ session.true[0])
    session.reported = session.noisy(session.true)
    measured_pairs(0.1, 0.02)(session)


def wrong_poses(share: float) -> Edit:
    """A share of the poses belongs to nothing: 20 to 200 mm and 5 to 40 degrees off."""

    def change(session: Session) -> None:
        v, rng = len(session), session.rng
        bad = rng.permutation(v)[: max(1, round(share * v))]
        way = rng.standard_normal((len(bad), 6))
        way = way / np.repeat(np.linalg.norm(way.reshape(-1, 2, 3), axis=2), 3, axis=1)
        size = np.stack([np.deg2rad(rng.uniform(5, 40, len(bad))), rng.uniform(0.02, 0.2, len(bad))], axis=1)
        size = np.repeat(size, 3, axis=1)
        session.reported[bad] = moved(session.reported[bad], way * size)

    return change


def stale_poses(share: float) -> Edit:
    """A share of the poses is that of the view before, whose file was not yet written anew."""

    def change(session: Session) -> None:
        v = len(session)
        bad = session.rng.permutation(np.arange(1, v))[: max(1, round(share * v))]
        session.reported[bad] = session.reported[bad - 1]

    return change


def shifted_by_one(session: Session) -> None:
    """Every picture has the pose of the one before."""
    session.reported = np.roll(session.reported, 1, axis=0)


def nudged(mm: float) -> Edit:
    """The board (or the camera beside the arm) is pushed by `mm` half way. Before or after, the camera's place on the
    arm is the same; beside the arm it has two."""

    def change(session: Session) -> None:
        turning, way = session.rng.standard_normal((2, 3))
        push = moved(np.eye(4), np.concatenate([0.005 * turning, 1e-3 * mm * way / np.linalg.norm(way)]))
        after = np.arange(len(session)) >= len(session) // 2
        if session.setup == IN_HAND:
            T = seen_from(session.setup, session.true, session.X, push @ session.Z)
        else:
            session.truths = [session.X, push @ session.X]
            T = seen_from(session.setup, session.true, push @ session.X, session.Z)
        session.photos.T = np.where(after[:, None, None], T, session.photos.T)

    return change


def lens_given(*, focal: float = 0.0, shift: float = 0.0) -> Edit:
    """The lens is given as exact: right, or its focal length wrong by a share, its centre by pixels."""

    def change(session: Session) -> None:
        K, D = session.photos.K[0], session.photos.D[0]
        angle = session.rng.uniform(0, 2 * np.pi)
        off = shift * np.array([np.cos(angle), np.sin(angle)])
        session.lens = np.concatenate([K[:2] * (1 + focal), K[2:] + off, D])

    return change


def measured_pairs(mm: float, deg: float) -> Edit:
    """Target poses instead of photos, with white noise: three times as large along the view."""

    def change(session: Session) -> None:
        level = np.array([deg * np.pi / 180] * 3 + [1e-3 * mm] * 2 + [3e-3 * mm])
        session.pairs = moved(session.photos.T, level * session.rng.standard_normal((len(session), 6)))

    return change


def track(mm: float, deg: float, *, drift: float, scale: float = 1.0) -> Edit:
    """A camera's own track (odometry): its frame is its first pose. drift: the walk's step, in noise levels; scale: of
    its lengths."""

    def change(session: Session) -> None:
        v, rng = len(session), session.rng
        in_world = session.true @ session.X  # T_base_camera
        camera = back(in_world[0]) @ in_world
        level = np.array([np.deg2rad(deg)] * 3 + [1e-3 * mm] * 3)
        walk = drift * np.cumsum(rng.standard_normal((v, 6)), axis=0) + rng.standard_normal((v, 6))
        camera = moved(camera, level * walk)
        camera[:, :3, 3] *= scale
        session.pairs = back(camera)

    return change


def with_options(**options: object) -> Edit:
    """What the person tells beside."""

    def change(session: Session) -> None:
        session.options.update(options)

    return change
