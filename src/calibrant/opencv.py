"""OpenCV's one door: `from calibrant.opencv import cv2`. What is wrong with an installation is said in words.

PyPI has four wheels of OpenCV (plain, headless, each with or without contrib modules) that write one folder, `cv2`. pip
lets them stand side by side: the one written last answers, and removing either leaves a torn folder. So the folder is
looked at when OpenCV is first needed, which costs one listing.
"""

from __future__ import annotations

import os
import sysconfig
import warnings
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from calibrant.errors import CalibrantError

WHEELS = ("opencv-python", "opencv-python-headless", "opencv-contrib-python", "opencv-contrib-python-headless")
OLDEST = (4, 12)
"""The oldest OpenCV that the package's requirements admit."""
NEEDED = ("__version__", "aruco", "findChessboardCornersSB", "imdecode", "remap")
"""Names that a whole OpenCV has: its version, one from Python, and one from each part that calibrant uses."""


class OpenCVError(CalibrantError):
    """OpenCV cannot be loaded or is not the one that is required; the message names the wheels and the cure."""

    exit_status = 2


def wheels_in(folder: Path) -> dict[str, str]:
    """Name and version of each wheel of OpenCV installed in a folder of packages, in order of their names."""
    found = {}
    for entry in os.listdir(folder) if folder.is_dir() else ():
        stem, extension = os.path.splitext(entry)
        name, _, version = stem.partition("-")
        if extension == ".dist-info" and name.replace("_", "-") in WHEELS:
            found[name.replace("_", "-")] = version
    return dict(sorted(found.items()))


def check_opencv(module: ModuleType | None, folder: Path, reason: str = "") -> None:
    """Look at what `import cv2` gave and at the wheels beside it.

    module: cv2 as it was loaded; None where that failed, with the reason. folder: the folder of packages it lies in.
    Raises: OpenCVError for an OpenCV that does not load, is torn or too old. Warns: two wheels of different versions.
    """
    wheels = wheels_in(folder)
    if module is None:
        raise OpenCVError(_opencv_trouble(f"cannot be loaded: {reason}", wheels, folder))
    lacking = [name for name in NEEDED if not hasattr(module, name)]
    if lacking:
        raise OpenCVError(_opencv_trouble(f"is torn: cv2 has no {', '.join(lacking)}", wheels, folder))
    if tuple(int(n) for n in module.__version__.split(".")[:2]) < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise OpenCVError(_opencv_trouble(f"is {module.__version__}, expected {oldest} or later", wheels, folder))
    if len(set(wheels.values())) > 1:
        text = f"answers with version {module.__version__}, and removing or renewing either wheel breaks the other"
        warnings.warn(_opencv_trouble(text, wheels, folder), stacklevel=3)


def _opencv_trouble(what: str, wheels: dict[str, str], folder: Path) -> str:
    """What failed, what is installed, and the commands that mend it."""
    required = f"'opencv-python-headless>={'.'.join(map(str, OLDEST))},<6'"
    names = " ".join(wheels)
    if len(wheels) > 1:
        listed = ", ".join(f"{name} {version}" for name, version in wheels.items())
        found = f"{listed} are installed in {folder} and write the same folder cv2"
        cure = f"keep one of them: pip uninstall -y {names}, then pip install {required}"
    elif wheels:
        found = f"{names} {wheels[names]} is installed in {folder}"
        cure = f"install it anew: pip uninstall -y {names}, then pip install {required}"
    else:
        found = f"no wheel of it is installed in {folder}"
        cure = f"install it: pip install {required}"
    return f"OpenCV {what}. {found[0].upper()}{found[1:]}. To mend it, {cure}."


def _opencv_folder() -> Path:
    """The folder of packages that holds cv2, or the one that pip installs to where there is no cv2."""
    spec = find_spec("cv2")
    places = [] if spec is None else [*(spec.submodule_search_locations or ()), *([spec.origin] if spec.origin else [])]
    return Path(places[0]).parent if places else Path(sysconfig.get_paths()["purelib"])


try:
    import cv2 as cv2
except (ImportError, AttributeError) as error:
    # AttributeError: files of two versions in one folder, where Python code asks for what the binary does not have.
    check_opencv(None, _opencv_folder(), f"{type(error).__name__}: {error}")
    raise
check_opencv(cv2, _opencv_folder())
