"""Floor 1: camera models, one file each, and the registry that names them."""

from calibrant.cameras.camera import Camera as Camera
from calibrant.cameras.model import CameraModel as CameraModel
from calibrant.cameras.registry import MODELS as MODELS
from calibrant.cameras.registry import camera_model as camera_model
