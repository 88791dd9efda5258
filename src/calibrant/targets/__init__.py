"""Floor 1: calibration targets, one file each: their points and their artwork; no image processing."""

from calibrant.targets.target import Artwork as Artwork
from calibrant.targets.target import Disc as Disc
from calibrant.targets.target import MarkerArt as MarkerArt
from calibrant.targets.target import Polygon as Polygon
from calibrant.targets.target import Target as Target
