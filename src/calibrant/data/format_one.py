"""Result files of format calibrant/1: what they kept among the options is put where format 2 has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibrant.data.typed_json import Json
from calibrant.errors import InputError

FORMAT_ONE = "calibrant/1"

_LOOPS = ("loop_before", "loop_after")
_ERRORS = ("rms_before", "rms_after")


def from_format_one(data: Json) -> Json:
    """The file's object as format 2 has it, but for its `format`.

    Raises: InputError where the options are no object, or one that was a finding is not as it was written.
    """
    options = data.get("options") or {}
    if not isinstance(options, dict):
        raise InputError(f"file.options is {str(options)[:60]}, expected an object")
    asked = dict(options)
    try:
        moved = {
            "figures": _figures(asked),
            "decided": _decided(asked, kind=str(data.get("kind"))),
            "cell": _cell(asked),
            "details": {**_details(asked), **_target(data.get("target_shape"))},
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        what = f"{type(error).__name__}: {error}"
        raise InputError(f"file.options is not as {FORMAT_ONE} has it ({what}); calibrate again") from error
    scale = data.get("target_scale")
    known = {"target_scale": {k: scale[k] for k in ("value", "sigma") if k in scale}} if isinstance(scale, dict) else {}
    others = {key: value for key, value in data.items() if key != "target_shape"}
    return {**others, **known, "options": asked, **{key: value for key, value in moved.items() if value}}


def _figures(asked: Json) -> Json:
    out: Json = {}
    if "offset_s" in asked:
        out["offset"] = {"value": asked.pop("offset_s"), "sigma": asked.pop("offset_sigma_s"), "unit": "s"}
    for name in (*_LOOPS, *_ERRORS):
        for unit, value in (asked.pop(name, None) or {}).items():
            out[f"{name}_{unit}"] = {"value": value, "unit": unit}
    for source, share in (asked.pop("shares", None) or {}).items():
        out[f"variance by {source}"] = {"value": share}
    if "without_source" in asked:
        out["without_source"] = {"value": asked.pop("without_source")}
    return out


def _decided(asked: Json, *, kind: str) -> Json:
    out: Json = {}
    if "camera" in asked:
        out["camera"] = asked.pop("camera")
    if "measurements" in asked:
        out["measurements"] = asked.pop("measurements")
    # The doctor is asked for a setup and decides it; only what it decided was written.
    if kind == "doctor" and "setup" in asked:
        out["setup"] = asked.pop("setup")
    for name, words in (asked.pop("cameras", None) or {}).items():
        out[f"camera {name}"] = words
    reading = asked.pop("pose_reading", None)
    if isinstance(reading, Mapping):
        out |= {f"pose_reading {name}": words for name, words in reading.items()}
    elif reading is not None:
        out["pose_reading"] = reading
    return out


def _cell(asked: Json) -> Json | None:
    pictures = asked.pop("pictures", None)
    found = {
        "sigma_px": asked.pop("sigma_px_of", None),
        "sigma_robot": asked.pop("sigma_robot_of", None),
        "sigma_joint_deg": asked.pop("sigma_joint_deg", None),
    }
    if pictures is None:
        return None
    return {"pictures": pictures, **{key: value for key, value in found.items() if value}}


def _target(shape: Mapping[str, Any] | None) -> Json:
    """A target whose shape was estimated, by the record of its kind."""
    if shape is None:
        return {}
    figures = {key: value for key, value in shape.items() if key != "kind"}
    return {{"paraboloid": "bent_target", "free": "free_target"}[shape["kind"]]: figures}


def _details(asked: Json) -> Json:
    out: Json = {}
    parameters: Any = asked.pop("parameters", None)
    if parameters is not None:
        # A kinematic calibration has one robot, without a name.
        out["robot_parameters"] = {"robots": parameters if isinstance(parameters, dict) else {"robot": parameters}}
    if "axes" in asked:
        out["joint_axes"] = {"axes": asked.pop("axes")}
    if "model_choice" in asked:
        out["model_choice"] = {"candidates": asked.pop("model_choice")}
        asked["model"] = "auto"
    found = [asked.pop(key) for key in ("findings", "repaired") if key in asked]
    if found:
        out["faults"] = {"found": found[0]}
    if "touched_point_mm" in asked:
        out["touched_point"] = {"point_mm": asked.pop("touched_point_mm"), "off_mm": asked.pop("off_mm")}
    if "valid_region" in asked:
        out["valid_region"] = dict(zip(("x", "y", "width", "height"), asked.pop("valid_region"), strict=True))
    return out
