"""What a format of another program is: how it is known, read into a result, and written from one.

Whatever a file describes becomes a `CalibrationResult` of kind "cameras": its cameras by name; where they are as
transforms T_parent_child between frames called as the file calls them, cameras as optical frames (x right, y down, z
ahead), lengths in metres, pixels counted from the middle of the first one; pictures with known places as views
(`T_camera_target`, the target being the file's world). What is not used is noted (`reading.notes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.results import TransformEstimate, ViewResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document

Size = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a person says of a file where it does not say it itself.

    image_size: (width, height) px; unit_m: metres per unit of its lengths; camera: which of several; answers: what a
    format asks beyond these, by name, such as {"index": "1"}; places: whether it matters where cameras are: a reader
    refuses what it cannot know of that only where it does.
    """

    image_size: Size | None = None
    unit_m: float | None = None
    camera: str | None = None
    places: bool = True
    answers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class WriteOptions:
    """How a result is written. transform: (parent, child), the one that formats of one transform write; unit_m: metres
    per unit, where the format leaves the choice; stem: the output's name without its suffix; answers: as for reading;
    approximate: whether a lens that the format can only come near to is to be written so.
    """

    transform: tuple[str, str] | None = None
    unit_m: float | None = None
    stem: str = "camera"
    approximate: bool = False
    answers: Mapping[str, str] = field(default_factory=dict)


Written = bytes | Mapping[str, bytes]
"""A file's content, or of a folder that of each file by its name within."""


@dataclass(frozen=True, kw_only=True)
class ExchangeFormat:
    """A format: name (what `--to` takes), title (for lists), suffix of a file that is written ("" for a folder).

    matches(document): whether the content is this format's, by keys and marks that no other has. read(document,
    options), write(result, options): None where it cannot be. models: the camera models that can be written without
    loss; others are brought into one of these, exactly or, when asked, approximated; lacks: terms of these that the
    format has not, by model. asks: what `answers` it knows, by
    name, with a line of help each.
    """

    name: str
    title: str
    suffix: str
    matches: Callable[[Document], bool]
    read: Callable[[Document, ReadOptions], CalibrationResult] | None = None
    write: Callable[[CalibrationResult, WriteOptions], Written] | None = None
    models: tuple[str, ...] = ()
    lacks: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    asks: Mapping[str, str] = field(default_factory=dict)

    def known_answers(self, answers: Mapping[str, str], *, option: str = "--answer") -> Mapping[str, str]:
        """The answers. Raises: InputError for one that this format does not ask for."""
        strange = next((name for name in answers if name not in self.asks), None)
        if strange is not None:
            listed = "; ".join(f"{name}: {words}" for name, words in self.asks.items()) or "nothing"
            raise InputError(f"{self.title} does not ask for {strange!r} ({option}); it asks for {listed}")
        return answers


def read_cameras(
    cameras: Mapping[str, Camera],
    *,
    transforms: tuple[TransformEstimate, ...] = (),
    views: tuple[ViewResult, ...] = (),
    **more: Any,
) -> CalibrationResult:
    """The result that a reader returns."""
    return CalibrationResult("cameras", "ok", cameras=dict(cameras), transforms=transforms, views=views, **more)


def one_camera(result: CalibrationResult) -> tuple[str, Camera]:
    """The only camera and its name, for formats that hold one. Raises: InputError where there are more, or none."""
    if len(result.cameras) != 1:
        listed = ", ".join(result.cameras) or "none"
        raise InputError(
            f"this format holds one camera, there are {len(result.cameras)} ({listed}); name one: --camera"
        )
    return next(iter(result.cameras.items()))


def answer(answers: Mapping[str, str], name: str, choices: tuple[str, ...] = ()) -> str | None:
    """What was answered, None where nothing was. Raises: InputError for none of the choices."""
    said = answers.get(name)
    if said is not None and choices and said not in choices:
        raise InputError(f"{name}={said}: expected {' or '.join(choices)}")
    return said
