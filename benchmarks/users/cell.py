"""A camera on an arm, or beside it: sessions drawn at random with their truth, and the least sigma they allow.

T_base_flange X T_camera_board = Z with the camera on the flange (X = T_flange_camera, Z = T_base_board);
T_base_flange Z = X T_camera_board with the board on it (X = T_base_camera, Z = T_flange_board).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from users.photos import Draw, Photos, draw_board, draw_lens, look, slopes
from users.rigid import Array, back, moved, rigid, step_between, turn
from users.robot import HOME, Arm, Fault, draw_arm

IN_HAND, TO_HAND = "eye-in-hand", "eye-to-hand"
METRES_A_RADIAN = 0.5
"""How turns count against shifts where an average frame is sought: at the end of an arm of that length."""


HANDS = Draw((8, 25), (0.8, 1.6), roll=60.0, tilt=(0.0, 40.0), fill=(0.35, 0.8))
"""Photos from an arm: it cannot go all around."""


@dataclass(frozen=True)
class CellDraw:
    """From what sessions are drawn: photos, noise of the robot (1 sigma a axis) in mm and degrees."""

    photos: Draw = HANDS
    setup: str = IN_HAND
    mm: tuple[float, float] = (0.02, 0.15)
    deg: tuple[float, float] = (0.003, 0.04)


@dataclass(eq=False)
class Session:
    """q (v, 6) joints in the order of the visit; true, reported (v, 4, 4) T_base_flange; others: joints (m, 6) of the
    same work, that are not photographed. truths: what a person may call T_flange_camera (or T_base_camera).
    lens: fx fy cx cy k1 k2 p1 p2 k3 where given. pairs: T_camera_board (v, 4, 4) instead of photos. off: how far
    the flange is off over that work, rms, metres."""

    photos: Photos
    setup: str
    arm: Arm
    X: Array
    Z: Array
    q: Array
    others: Array
    true: Array
    reported: Array
    mm: float
    deg: float
    rng: np.random.Generator
    truths: list[Array]
    lens: Array | None = None
    pairs: Array | None = None
    off: float = 0.0
    options: dict[str, object] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.q)

    def stand(self, true: Array) -> None:
        """The flange stands at `true` (v, 4, 4) when the photos are taken."""
        self.true = true
        self.photos.T = seen_from(self.setup, true, self.X, self.Z)

    def noisy(self, T: Array) -> Array:
        """What the robot reports of T, with its white noise."""
        level = np.array([np.deg2rad(self.deg)] * 3 + [1e-3 * self.mm] * 3)
        return moved(T, level * self.rng.standard_normal((len(T), 6)))


def seen_from(setup: str, A: Array, X: Array, Z: Array) -> Array:
    """T_camera_board."""
    return back(A @ X) @ Z if setup == IN_HAND else back(X) @ A @ Z


def draw_session(seed: int, draw: CellDraw) -> Session:
    """One session without a fault but noise. The same seed: the same arm, camera, board, poses."""
    rng = np.random.default_rng([2026, 12, seed])
    for _ in range(20):
        size, K, D = draw_lens(rng, draw.photos)
        board, arm = draw_board(rng), draw_arm(rng)
        n = int(rng.integers(draw.photos.views[0], draw.photos.views[1] + 1))
        B = look(rng, max(4 * n, 60), size, K, D, board, draw.photos)
        X, Z, wanted = placed(rng, draw.setup, arm, board, B)
        q, reached = arm.reach(wanted, HOME + 0.2 * rng.standard_normal((len(B), 6)))
        q, good = (q + np.pi) % (2 * np.pi) - np.pi, np.flatnonzero(reached)
        if len(good) >= n + 12:
            break
    else:
        raise RuntimeError("the drawn arm reaches too few views")
    mine = along_a_path(q[good[:n]])
    sigma = float(np.exp(rng.uniform(*np.log(draw.photos.sigma))))
    mm, deg = (float(np.exp(rng.uniform(*np.log(r)))) for r in (draw.mm, draw.deg))
    T = arm.poses(mine)
    photos = Photos(
        size, np.tile(K, (n, 1)), np.tile(D, (n, 1)), board, board, seen_from(draw.setup, T, X, Z), sigma, rng
    )  # fmt: skip
    session = Session(photos, draw.setup, arm, X, Z, mine, q[good[n:]], T, T, mm, deg, rng, [X])
    session.reported = session.noisy(T)
    return session


def placed(rng: np.random.Generator, setup: str, arm: Arm, board: Array, B: Array) -> tuple[Array, Array, Array]:
    """X, Z and where the flange has to be (m, 4, 4) for the views B: the work lies about the arm's home."""
    home = arm.poses(HOME[None])[0]
    middle = rigid(np.eye(3), np.array([0, 0, np.median(B[:, 2, 3])]) - board.mean(axis=0))
    small = turn(0.15 * rng.standard_normal(3)) @ turn([0, 0, rng.uniform(-np.pi, np.pi)])
    if setup == IN_HAND:
        X = rigid(small, rng.uniform((-0.08, -0.08, 0.02), (0.08, 0.08, 0.12)))
        Z = home @ X @ middle
        return X, Z, Z @ back(X @ B)
    out = small @ turn([np.pi, 0, 0])  # the board's face looks out of the flange
    Z = rigid(out, rng.uniform((-0.05, -0.05, 0.02), (0.05, 0.05, 0.1)) - out @ board.mean(axis=0))
    X = home @ Z @ back(middle)
    return X, Z, X @ B @ back(Z)


def along_a_path(q: Array) -> Array:
    """The same joints in an order of short ways, as robots are led."""
    order, left = [0], list(range(1, len(q)))
    while left:
        order.append(left.pop(int(np.argmin([np.abs(q[i] - q[order[-1]]).max() for i in left]))))
    return q[order]


def misled(session: Session, fault: Fault, *, average: bool) -> None:
    """The arm stands elsewhere than it says. average: the truth is the camera in the flange as the arm reports it on
    average over its work, for what an arm errs by everywhere is nothing that any data tell; else in the arm's own."""
    where = fault(session.arm, session.q, session.rng)
    session.stand(where(session.q))
    true, says = where(session.others), session.arm.poses(session.others)
    if average:
        dB, dF = frames_between(true, says)
        session.truths = [back(dF) @ session.X if session.setup == IN_HAND else dB @ session.X]
        true = dB @ true @ dF
    session.off = float(np.sqrt(np.mean(np.sum((true - says)[:, :3, 3] ** 2, axis=1))))


def frames_between(true: Array, says: Array) -> tuple[Array, Array]:
    """dB, dF (4, 4), small, with which says = dB true dF at best: what moves of the base and the flange explain.

    A session without end over the same work would find dF^-1 T_flange_camera, or dB T_base_camera.
    """
    weight = np.array([METRES_A_RADIAN] * 3 + [1.0] * 3)
    h, columns = 1e-6, []
    for i in range(6):
        step = h * np.eye(6)[i]
        columns.append(step_between(true, moved(np.eye(4), step) @ true) / h)
        columns.append(step_between(true, true @ moved(np.eye(4), step)) / h)
    J = np.stack(columns, axis=-1) * weight[:, None]
    sizes = np.linalg.lstsq(J.reshape(-1, 12), (step_between(true, says) * weight).ravel(), rcond=None)[0]
    return moved(np.eye(4), sizes[0::2]), moved(np.eye(4), sizes[1::2])


def least_covariance(session: Session, *, lens_free: bool = True) -> Array:
    """Covariance (6, 6) of X, its axes those of `moved`, that white noise of pixels and robot allows at best."""
    photos = session.photos
    J_lens, J_pose = slopes(replace(photos, T=photos.T))
    h = 1e-6

    def change(which: int) -> Array:
        """How T_camera_board moves with the flange (0), X (1), Z (2): (v, 6, 6)."""
        columns = []
        for i in range(6):
            parts = [session.true, session.X, session.Z]
            parts[which] = moved(parts[which], h * np.eye(6)[i])
            columns.append(step_between(photos.T, seen_from(session.setup, *parts)) / h)
        return np.stack(columns, axis=-1)

    J_E = J_pose @ change(0)
    shared = [J_pose @ change(1), J_pose @ change(2)] + ([J_lens] if lens_free else [])
    J = np.concatenate(shared, axis=2) / photos.sigma
    J_E = J_E / photos.sigma
    known = np.diag([np.deg2rad(session.deg) ** -2] * 3 + [(1e-3 * session.mm) ** -2] * 3)
    JJ, JE, EE = (np.swapaxes(a, 1, 2) @ b for a, b in ((J, J), (J, J_E), (J_E, J_E)))
    F = np.sum(JJ - JE @ np.linalg.solve(EE + known, np.swapaxes(JE, 1, 2)), axis=0)
    scale = 1 / np.sqrt(np.diag(F))
    return (np.linalg.inv(F * scale * scale[:, None]) * scale * scale[:, None])[:6, :6]
