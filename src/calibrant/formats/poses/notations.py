"""What the numbers of a pose file can mean: every notation that the file, the options and plain sense allow.

A notation is a choice of length unit, rotation form, angle unit and direction. Notations come in the order of belief:
first those that keep to what the file's names state, then to what is usual. Those that contradict a name are listed
too, with the contradiction in words: a header can be wrong, and the data can show it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.data import RobotPoses
from calibrant.errors import InputError
from calibrant.formats.poses.columns import LENGTH_UNITS
from calibrant.formats.poses.raw import PoseOptions, RawPoses
from calibrant.geometry import rotations, se3

ROTATIONS = ("auto", "quat-xyzw", "quat-wxyz", "rotvec", *(f"euler:{o}" for o in rotations.EULER_ORDERS), "matrix")
_CHOICES = {
    "units": ("auto", *LENGTH_UNITS),
    "rotation": ROTATIONS,
    "angle": ("auto", "deg", "rad"),
    "direction": ("auto", "base-gripper", "gripper-base"),
}
_FARTHEST_M = 50.0
"""No arm, gantry or rail carries a calibration target or camera farther than this from its base."""
_NEAREST_M = 0.005
"""No arm keeps every pose of a calibration this close to its base."""
_ROTATION_WORDS = {"quat-xyzw": "quaternions x y z w", "quat-wxyz": "quaternions w x y z", "matrix": "matrices"}


@dataclass(frozen=True, eq=False)
class PoseNotation:
    """One meaning of a pose file. T_base_gripper (n, 4, 4), metres; times (n,), seconds, where the file has them.

    rotation_first: the rotation stands before the position in rows of six bare numbers.
    angle is "" where no angle is read. contradicts: what the file states and this notation does not believe.
    """

    units: str
    rotation: str
    angle: str
    direction: str
    ids: tuple[str, ...]
    T_base_gripper: Array
    source: str
    contradicts: tuple[str, ...] = ()
    by_axis_names: bool = False
    times: Array | None = None
    rotation_first: bool = False

    def __repr__(self) -> str:
        return f"PoseNotation({len(self.ids)} poses, {self.source}: {self.description})"

    @property
    def rotation_words(self) -> str:
        """How the rotations are written, in words."""
        if self.rotation in _ROTATION_WORDS:
            return _ROTATION_WORDS[self.rotation]
        notation = "rotation vectors" if self.rotation == "rotvec" else _euler_words(self.rotation, self.by_axis_names)
        return f"{notation} in {'degrees' if self.angle == 'deg' else 'radians'}"

    @property
    def written(self) -> str:
        """How the numbers are written, in words: the notation but for the direction."""
        order = "rotation before position in each row, " if self.rotation_first else ""
        return f"{order}positions in {self.units}, {self.rotation_words}"

    @property
    def description(self) -> str:
        """The notation in words."""
        way = "T_base_gripper" if self.direction == "base-gripper" else "T_gripper_base (inverted)"
        return f"{self.written}, {way}"

    @property
    def rotation_notation(self) -> tuple[str, str, bool, bool]:
        """How the rotations are written: what two notations share that differ in unit of length or direction only."""
        return self.rotation, self.angle, self.by_axis_names, self.rotation_first

    def take(self, rows: Sequence[int], ids: Sequence[str] | None = None) -> PoseNotation:
        """The same notation of some of the poses, in the order of `rows`, renamed when `ids` are given."""
        names = tuple(self.ids[i] for i in rows) if ids is None else tuple(ids)
        times = None if self.times is None else self.times[list(rows)]
        return replace(self, ids=names, T_base_gripper=self.T_base_gripper[list(rows)], times=times)

    @property
    def poses(self) -> RobotPoses:
        """The poses this reading gives."""
        return RobotPoses(self.ids, self.T_base_gripper, f"{self.source}: {self.description}")


@dataclass(frozen=True, eq=False)
class _Turn:
    """Rotations (n, 3, 3) by one notation, and what it contradicts."""

    notation: str
    angle: str
    R: Array
    contradicts: tuple[str, ...] = ()
    by_axis_names: bool = False


def notations(
    raw: RawPoses,
    *,
    units: str | None = None,
    rotation: str | None = None,
    angle: str | None = None,
    direction: str | None = None,
) -> tuple[PoseNotation, ...]:
    """Every notation consistent with the options, the most believable first.

    Options that are not given here are those of `read_poses`. Raises: InputError with reasons when none is left.
    """
    given = {"units": units, "rotation": rotation, "angle": angle, "direction": direction}
    asked = replace(raw.options, **{key: value for key, value in given.items() if value is not None})
    asked = options(**vars(asked))
    dropped: list[str] = []
    turns = list(_turns(raw, asked, dropped))
    lengths = list(_lengths(raw, asked, dropped))
    ids = raw.names if raw.names is not None else tuple(str(i) for i in range(len(raw)))
    found = []
    for turn in turns:
        for unit, against_unit in lengths:
            T = se3.make(turn.R, raw.translation * LENGTH_UNITS[unit])
            for way, against_way in _directions(raw, asked):
                found.append(
                    PoseNotation(
                        units=unit,
                        rotation=turn.notation,
                        angle=turn.angle,
                        direction=way,
                        ids=ids,
                        T_base_gripper=T if way == "base-gripper" else se3.inverse(T),
                        source=raw.source,
                        contradicts=(*turn.contradicts, *against_unit, *against_way),
                        by_axis_names=turn.by_axis_names,
                        times=raw.times,
                    )
                )
    if not found:
        raise InputError(
            f"{raw.source}: the poses cannot be read with {_options_words(asked)}: {'; '.join(dropped)}; "
            "leave the option out to let the data decide"
        )
    return tuple(sorted(found, key=lambda notation: len(notation.contradicts)))


def every_notation(raw: RawPoses) -> tuple[PoseNotation, ...]:
    """`notations`, and of rows of six bare numbers those with the rotation first, which the data must bear out."""
    if raw.rotation_first is None:
        return notations(raw)
    try:
        other = notations(replace(raw.rotation_first, options=raw.options, times=raw.times))
    except InputError:  # the numbers leave the usual order alone
        return notations(raw)
    against = "six numbers a row are a position and a rotation as a rule"
    first = [replace(n, rotation_first=True, contradicts=(*n.contradicts, against)) for n in other]
    return (*notations(raw), *first)


def excluded(raw: RawPoses) -> tuple[str, ...]:
    """Why notations that the options would allow are not among `notations`, in words."""
    dropped: list[str] = []
    list(_turns(raw, raw.options, dropped))
    list(_lengths(raw, raw.options, dropped))
    return tuple(dict.fromkeys(dropped))


def options(*, units: str, rotation: str, angle: str, direction: str) -> PoseOptions:
    """The options, checked. Raises: InputError listing the valid choices."""
    given = {"units": units, "rotation": rotation, "angle": angle, "direction": direction}
    for key, value in given.items():
        if value not in _CHOICES[key]:
            listed = ", ".join(_CHOICES[key]) if key != "rotation" else "auto, quat-xyzw, quat-wxyz, rotvec, matrix, "
            listed += (
                "" if key != "rotation" else "euler:ZYX and the other 23 orders (capitals: moving axes, small: fixed)"
            )
            raise InputError(f"unknown {key} of poses {value!r}; known: {listed}")
    return PoseOptions(**given)


def _lengths(raw: RawPoses, asked: PoseOptions, dropped: list[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Length units and what each contradicts; what the user or the file states is never called impossible."""
    stated = raw.stated.units
    if asked.units != "auto":
        yield asked.units, () if stated in (None, asked.units) else (f"the file says positions are in {stated}",)
        return
    if stated is not None:
        yield stated, ()
    distances = np.linalg.norm(raw.translation, axis=1)
    # One row in another unit, or a slipped decimal point, leaves the unit of the others as it is: the median.
    typical, farthest = float(np.median(distances)), float(distances.max())
    for unit in ("m", "mm"):
        if unit == stated:
            continue
        reach, middle = farthest * LENGTH_UNITS[unit], typical * LENGTH_UNITS[unit]
        if middle > _FARTHEST_M:
            dropped.append(f"positions in {unit}: {middle:.4g} m from the base is beyond any robot")
        elif reach < _NEAREST_M and farthest > 0:
            dropped.append(f"positions in {unit}: every pose would lie within {1e3 * reach:.2g} mm of the base")
        else:
            yield unit, () if stated is None else (f"the file says positions are in {stated}",)


def _directions(raw: RawPoses, asked: PoseOptions) -> Iterator[tuple[str, tuple[str, ...]]]:
    if asked.direction != "auto":
        yield asked.direction, ()
        return
    stated = raw.stated.direction
    for way in ("base-gripper", "gripper-base"):
        yield way, () if stated in (None, way) else (f"the file names the poses {stated}",)


def _turns(raw: RawPoses, asked: PoseOptions, dropped: list[str]) -> Iterator[_Turn]:
    """Rotations by every notation that fits the shape of the numbers."""
    numbers = raw.rotation
    if numbers.ndim == 3:
        if asked.rotation in ("auto", "matrix"):
            yield _Turn("matrix", "", numbers)
        else:
            dropped.append(f"the file holds rotation matrices, not {asked.rotation}")
    elif numbers.shape[1] == 4:
        if asked.rotation in ("auto", "quat-xyzw", "quat-wxyz"):
            yield from _quaternions(raw, asked)
        else:
            dropped.append(f"the file holds four numbers a rotation (quaternions), not {asked.rotation}")
    elif asked.rotation == "auto" or asked.rotation == "rotvec" or asked.rotation.startswith("euler:"):
        yield from _three_numbers(raw, asked, dropped)
    else:
        dropped.append(f"the file holds three numbers a rotation, not {asked.rotation}")


def _quaternions(raw: RawPoses, asked: PoseOptions) -> Iterator[_Turn]:
    stated, first = raw.stated.rotation, raw.stated.rotation or raw.stated.likely or "quat-xyzw"
    convert = {
        "quat-xyzw": rotations.matrix_from_quaternion_xyzw,
        "quat-wxyz": rotations.matrix_from_quaternion_wxyz,
    }
    for order in sorted(convert, key=lambda name: name != first):
        if asked.rotation in ("auto", order):
            against = stated not in (None, order) and asked.rotation == "auto"
            yield _Turn(
                order,
                "",
                convert[order](raw.rotation),
                (f"the file names its quaternions {stated}",) if against else (),
            )


def _three_numbers(raw: RawPoses, asked: PoseOptions, dropped: list[str]) -> Iterator[_Turn]:
    numbers, stated = raw.rotation, raw.stated
    largest = float(np.abs(numbers).max())
    for unit in ("rad", "deg"):
        if asked.angle not in ("auto", unit):
            continue
        if unit == "rad" and largest > 2 * np.pi + 1e-6 and asked.angle == "auto" and stated.angle != "rad":
            dropped.append(f"rotations in radians: {largest:.4g} is more than a full turn")
            continue
        against = stated.angle not in (None, unit)
        angle_words = (f"the file's angles are in {stated.angle}",) if against else ()
        if asked.rotation in ("auto", "rotvec"):
            other = stated.rotation not in (None, "rotvec") and asked.rotation == "auto"
            words: tuple[str, ...] = (f"the columns are named as {stated.rotation}",) if other else ()
            R = rotations.matrix_from_rotation_vector(numbers, unit="deg" if unit == "deg" else "rad")
            yield _Turn("rotvec", unit, R, (*words, *angle_words))
        for notation, sequence, by_names in _euler_products(stated.axes, asked.rotation, stated.rotation):
            words = _against_names(sequence, stated.rotation, stated.axes, asked)
            order = "".join(axis for axis, _ in sequence).upper()
            columns = [column for _, column in sequence]
            R = rotations.matrix_from_euler(numbers[:, columns], order=order, unit="deg" if unit == "deg" else "rad")
            yield _Turn(notation, unit, R, (*words, *angle_words), by_names)


Product = tuple[tuple[str, int], ...]
"""A product of rotations from the left: (axis, column of its angle)."""


def _euler_products(axes: str | None, asked: str, stated: str | None) -> Iterator[tuple[str, Product, bool]]:
    """The Euler notations asked for ("auto": all): angles by the axes the columns name, and in the columns' order.

    "ZYX" and "xyz" of named angles are one product: it comes once, as the file states it where it does.
    """
    seen: set[Product] = set()
    orders = [o for o in rotations.EULER_ORDERS if asked in ("auto", f"euler:{o}")]
    orders.sort(key=lambda o: f"euler:{o}" != stated)
    for order in orders if axes is not None else []:
        if len(set(order.lower())) == 3:
            letters = order.lower() if order.isupper() else order[::-1]
            product = tuple((axis, str(axes).index(axis)) for axis in letters)
            if product not in seen:
                yield f"euler:{order}", product, True
            seen.add(product)
    for order in orders:
        product = _in_column_order(order)
        if product not in seen:
            yield f"euler:{order}", product, False


def _in_column_order(order: str) -> Product:
    pairs = tuple(zip(order.lower(), range(3)))
    return pairs if order.isupper() else pairs[::-1]


def _against_names(product: Product, stated: str | None, axes: str | None, asked: PoseOptions) -> tuple[str, ...]:
    """What an Euler notation contradicts in the names of the columns."""
    if axes is not None and any(axes[column] != axis for axis, column in product):
        return (f"the columns are named after the axes {', '.join(axes)}",)
    if stated is None or asked.rotation != "auto":
        return ()
    agrees = stated.startswith("euler:") and product == _in_column_order(stated.removeprefix("euler:"))
    return () if agrees else (f"the columns are named as {stated}",)


def _euler_words(notation: str, by_axis_names: bool) -> str:
    order = notation.removeprefix("euler:")
    kind = "moving" if order.isupper() else "fixed"
    named = ", angles by the columns' names" if by_axis_names else ", angles in the columns' order"
    return f"Euler angles {order} ({kind} axes{named})"


def _options_words(asked: PoseOptions) -> str:
    chosen = [f"{key} {value}" for key, value in vars(asked).items() if value != "auto"]
    return ", ".join(chosen) or "any convention"
