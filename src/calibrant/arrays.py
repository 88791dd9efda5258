"""Arrays by the type of their elements, named once for all rooms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]
Index = NDArray[np.intp]
Grey = NDArray[np.uint8]
