"""`servo run` on a robot and a camera that are opened by a spec: to what `servo teach` wrote, as a result."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import Listener
from calibrant.tasks.outcome import Document, Outcome
from calibrant.tasks.servo.teach import camera_name

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult
    from calibrant.data.records.servoing import TaughtFeatures
    from calibrant.servoing.loop import ServoOptions
    from calibrant.tasks.servo.run import Request


def run_on_devices(request: Request, options: ServoOptions, listener: Listener) -> Outcome:
    """The run as a result of kind "servo". Raises: InputError; RefusedError where the arm may not move or does not
    arrive; DeviceError for devices that stop answering."""
    from dataclasses import replace

    import numpy as np

    from calibrant.data.result_file import read_result
    from calibrant.servoing.laws.registry import law_of
    from calibrant.servoing.loop import servo
    from calibrant.servoing.result import servo_result
    from calibrant.servoing.sight.eye import Eye, Model, finder
    from calibrant.servoing.sight.mounting import Mounting
    from calibrant.servoing.stability import margin_of
    from calibrant.servoing.teach import features_from
    from calibrant.targets.registry import parse_target

    if request.target_file is None or request.devices.robot_device is None or request.devices.camera_device is None:
        raise InputError(
            "give the target file of `calibrant servo teach`, --robot-device and --camera-device, or --cell for "
            "simulated cells"
        )
    if (request.depth, request.focal_error, request.hand_eye_error) != ("estimated", "0%", "0deg"):
        raise InputError("--depth, --focal-error and --hand-eye-error try control in simulated cells: give --cell")
    taught = read_result(request.target_file)
    record, name = taught_in(taught), camera_name(taught, None)
    camera, target, mounting = taught.cameras[name], parse_target(record.target), Mounting.of(taught, name)
    wanted = features_from(record, camera)
    session.load_solver(listener)
    with request.devices.opened() as devices:
        source = devices.camera
        eye = Eye(camera, mounting, source, finder(target), Model.target(target))
        words = f"{request.control} control leads it to the pose that {request.target_file} taught, by {source.name}"
        request.devices.confirm(devices.robot, words, listener)
        with listener.status("Servoing …"):
            found = servo(devices.robot, eye, wanted, law_of(request.control), options=options)
    margin = margin_of(wanted, camera, mounting, np.eye(4))
    result = servo_result(found, control=request.control, options=options, camera=camera, name=name, margin=margin)
    said = {"control": request.control, "robot": request.devices.robot_device, "camera": request.devices.camera_device}
    result = replace(result, options=said, inputs=session.file_records([request.target_file]))
    return Outcome(result=result, documents=_plot(request, result))


def taught_in(taught: CalibrationResult) -> TaughtFeatures:
    """What was taught. Raises: InputError for a result of another kind."""
    from calibrant.data.records.servoing import TaughtFeatures

    record = next((d for d in taught.details if isinstance(d, TaughtFeatures)), None)
    if record is None:
        raise InputError(f"the target file is a result of kind {taught.kind!r}; expected one of calibrant servo teach")
    return record


def _plot(request: Request, result: CalibrationResult) -> tuple[Document, ...]:
    if request.plot is None:
        return ()
    from calibrant.reports.servo_plots import servo_png

    return (Document(request.plot, partial(servo_png, list(result.details))),)
