"""What a recording says of its camera: a file of intrinsics, or of a rig's two cameras, colour and depth."""

from __future__ import annotations

from pathlib import Path

from calibrant.data.devices import DeviceCalibration


def stated_in(file: str | Path | None, size: tuple[int, int] | None = None) -> DeviceCalibration:
    """The colour camera of a file in any format; empty without one. Raises: InputError as `read_camera`."""
    if not file:
        return DeviceCalibration()
    from calibrant.formats.cameras.read import read_camera

    return DeviceCalibration(colour=read_camera(Path(file), image_size=size))
