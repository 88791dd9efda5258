"""Floor 6: robots and cameras behind the protocols of `data.devices`: the simulated cell, recordings, and hardware.

A driver is a file, and a line in `register`; a spec such as `cell:seed=3` or `opencv:0` opens it.
"""

from calibrant.devices.register import Devices as Devices
from calibrant.devices.register import open_devices as open_devices
