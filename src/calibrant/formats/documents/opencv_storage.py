"""OpenCV's FileStorage (YAML, XML, JSON) read and written as plain data, without OpenCV.

FileStorage writes YAML that is not quite YAML (`%YAML:1.0`) and marks matrices: by the tag `!!opencv-matrix`, by the
attribute or key `type_id="opencv-matrix"`. A matrix becomes an array (rows, cols), or
(rows, cols, channels) where it has several.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.documents.number_text import digits
from calibrant.reading.json_text import DEEPEST, TOO_DEEP, parse_json
from calibrant.targets.yaml_file import parse_documents

_LENGTH_OF_LINE = 72
_LONGEST_INTEGER = 18
_CHANNELS = re.compile(r"^\(?(\d*)[a-z]\)?$")
_HEADER = re.compile(r"\A\s*%YAML:1\.\d[^\n]*\n")
_TIGHT = re.compile(r"^(\s*[A-Za-z_][\w.-]*):(?=[\[{\"'+.\d-])", re.MULTILINE)
"""A key with no blank before its value, as OpenCV's parser takes it and YAML does not."""


def _construct_matrix(loader: Any, node: Any) -> NDArray:
    if not hasattr(node, "value") or not isinstance(node.value, list) or node.id != "mapping":
        raise InputError("an opencv-matrix without rows, cols, dt and data")
    return _stored_matrix({str(key): value for key, value in loader.construct_mapping(node, deep=True).items()})


_CONSTRUCTORS = dict.fromkeys(
    ("tag:yaml.org,2002:opencv-matrix", "tag:yaml.org,2002:opencv-nd-matrix"), _construct_matrix
)


def read_yaml(text: str, source: str) -> Any:
    """Data of a YAML document, OpenCV's dialect included. Raises: InputError with file and line, or for several."""
    documents = read_yaml_documents(text, source)
    if len(documents) > 1:
        raise InputError(f"{source}: {len(documents)} documents, separated by ---; expected one")
    return documents[0] if documents else None


def read_yaml_documents(text: str, source: str) -> list[Any]:
    """Data of each YAML document that holds something, as `ros2 topic echo` prints messages. Raises: as `read_yaml`."""
    # A byte order mark and blanks before OpenCV's header; the line stays, so that line numbers hold.
    body = _TIGHT.sub(r"\1: ", _HEADER.sub("\n", text)) if _HEADER.match(text) else text
    try:
        return parse_documents(body, _CONSTRUCTORS)
    except InputError as error:
        line = re.match(r"line (\d+): ", str(error))
        words = str(error)[line.end() :] if line else str(error)
        raise InputError(
            f"{source}:{line[1]}: not YAML ({words})" if line else f"{source}: not YAML ({words})"
        ) from error


def read_json(text: str, source: str) -> Any:
    """Data of a JSON document, OpenCV's matrices as arrays. Raises: InputError with file and line."""
    try:
        return parse_json(text, object_hook=_json_object)
    except json.JSONDecodeError as error:
        raise InputError(f"{source}:{error.lineno}: not JSON ({error.msg})") from error
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def read_xml(text: str, source: str) -> dict[str, Any]:
    """Data of a FileStorage XML document. Raises: InputError with file and line."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{source}: document types and entities are not part of a FileStorage; remove them")
    try:
        root = ElementTree.fromstring(text.strip())
    except ElementTree.ParseError as error:
        raise InputError(f"{source}:{error.position[0]}: not XML ({error})") from error
    if root.tag != "opencv_storage":
        raise InputError(f"{source}: the XML root is <{root.tag}>, expected <opencv_storage>")
    check_depth(root, source)
    twice = next((tag for tag, times in Counter(child.tag for child in root).items() if times > 1), None)
    if twice is not None:
        raise InputError(f"{source}: <{twice[:40]}> stands there twice; keep one")
    try:
        return {child.tag: _xml_value(child) for child in root}
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def check_depth(root: ElementTree.Element, source: str) -> None:
    """Raises: InputError where elements lie too deep in each other."""
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
        if not level:
            return
    raise InputError(f"{source}: {TOO_DEEP}")


Storable = NDArray | float | int | str | list[str]
"""What is stored: matrices, numbers, texts and lists of texts."""


def yaml_text(values: Mapping[str, Storable]) -> str:
    """FileStorage YAML; numbers with all their digits."""
    lines = ["%YAML:1.0", "---"]
    for key, value in values.items():
        if isinstance(value, np.ndarray):
            lines += _yaml_matrix(key, np.atleast_2d(value))
        elif isinstance(value, list):
            lines.append(f"{key}: [ {', '.join(map(_quoted, value))} ]")
        else:
            lines.append(f"{key}: {_quoted(value) if isinstance(value, str) else _number_text(value)}")
    return "\n".join(lines) + "\n"


def json_text(values: Mapping[str, Storable]) -> str:
    """FileStorage JSON; numbers with all their digits."""

    def stored(value: Storable) -> Any:
        if not isinstance(value, np.ndarray):
            return value
        M = np.atleast_2d(value)
        data = [float(x) for x in M.ravel()]
        return {"type_id": "opencv-matrix", "rows": M.shape[0], "cols": M.shape[1], "dt": "d", "data": data}

    return json.dumps({key: stored(value) for key, value in values.items()}, ensure_ascii=False, indent=4) + "\n"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _yaml_matrix(key: str, matrix: NDArray) -> list[str]:
    rows, cols = matrix.shape
    head = [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
    line, lines = "   data: [ ", []
    numbers = [_number_text(float(x)) for x in matrix.ravel()]
    for i, number in enumerate(numbers):
        piece = number + (", " if i + 1 < len(numbers) else " ]")
        if len(line) + len(piece) > _LENGTH_OF_LINE:
            lines.append(line.rstrip())
            line = "       "
        line += piece
    return [*head, *lines, line]


def _number_text(value: float | int) -> str:
    """A double as FileStorage writes it, which leaves out a zero behind the point."""
    if isinstance(value, int):
        return str(value)
    mantissa, e, exponent = digits(value).partition("e")
    return (mantissa[:-1] if mantissa.endswith(".0") else mantissa) + e + exponent


def _json_object(data: dict[str, Any]) -> Any:
    return _stored_matrix(data) if data.get("type_id") in ("opencv-matrix", "opencv-nd-matrix") else data


def _xml_value(element: ElementTree.Element) -> Any:
    children = list(element)
    text = (element.text or "").strip()
    if (element.get("type_id") or "").startswith("opencv-"):
        fields = {child.tag: (child.text or "").strip() for child in children}
        return _stored_matrix({**fields, "data": fields.get("data", "").split()})
    if children and all(child.tag == "_" for child in children):
        return [_xml_value(child) for child in children]
    if children:
        return {child.tag: _xml_value(child) for child in children}
    if text.startswith('"') and len(text) > 1:
        return text.strip('"')
    parts = [_scalar(part) for part in text.split()]
    return parts if len(parts) > 1 and all(not isinstance(p, str) for p in parts) else _scalar(text)


def _scalar(text: str) -> Any:
    try:
        return int(text) if len(text) < _LONGEST_INTEGER else float(text)
    except ValueError:
        try:
            return float(text)
        except ValueError:
            return text


def _stored_matrix(fields: Mapping[str, Any]) -> NDArray:
    """The array of an opencv-matrix. Raises: InputError when keys are missing or the count of numbers is wrong."""
    missing = [key for key in ("dt", "data") if key not in fields]
    if missing:
        raise InputError(f"an opencv-matrix without {' and '.join(missing)}")
    match = _CHANNELS.match(str(fields["dt"]).strip("\"' "))
    if match is None:
        raise InputError(f"an opencv-matrix of the unknown type {fields['dt']!r}")
    sizes = fields.get("sizes") or [fields.get("rows"), fields.get("cols")]
    try:
        shape = [int(n) for n in (sizes.split() if isinstance(sizes, str) else sizes)]
        shape += [int(match[1])] if match[1] and int(match[1]) > 1 else []
        return np.array([float(x) for x in fields["data"]]).reshape(shape)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"an opencv-matrix whose data do not fit rows x cols ({error})") from error
