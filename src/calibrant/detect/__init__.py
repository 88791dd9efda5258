"""Floor 3: find targets in images, one detector a target."""

from calibrant.detect.detection import Detection as Detection
from calibrant.detect.pipeline import detect as detect
