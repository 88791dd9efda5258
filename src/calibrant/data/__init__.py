"""Floor 2: observations, robot poses and results: frozen, checked once at construction."""

from calibrant.data.cell_layout import CellLayout as CellLayout
from calibrant.data.cell_layout import PictureList as PictureList
from calibrant.data.cell_layout import SigmaRobot as SigmaRobot
from calibrant.data.devices import CameraSource as CameraSource
from calibrant.data.devices import DeviceCalibration as DeviceCalibration
from calibrant.data.devices import GripperState as GripperState
from calibrant.data.devices import Picture as Picture
from calibrant.data.devices import Robot as Robot
from calibrant.data.devices import RobotLimits as RobotLimits
from calibrant.data.observations import DEFAULT_CAMERA as DEFAULT_CAMERA
from calibrant.data.observations import Missed as Missed
from calibrant.data.observations import Observations as Observations
from calibrant.data.observations import View as View
from calibrant.data.poses import RobotPoses as RobotPoses
from calibrant.data.results import CalibrationResult as CalibrationResult
from calibrant.data.results import Check as Check
from calibrant.data.results import HeldOut as HeldOut
from calibrant.data.results import JointCovariance as JointCovariance
from calibrant.data.results import Measured as Measured
from calibrant.data.results import MethodResult as MethodResult
from calibrant.data.results import TransformEstimate as TransformEstimate
from calibrant.data.results import ViewResult as ViewResult
from calibrant.data.results import as_transform as as_transform
from calibrant.data.results import verdict_of as verdict_of
