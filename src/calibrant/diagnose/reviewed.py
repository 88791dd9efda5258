"""What the review of a calibration says of it, by name, for whoever shows a result: reports reach no calibration."""

from __future__ import annotations

from calibrant.calibrate.review.coverage import CameraCoverage as CameraCoverage
from calibrant.calibrate.review.residuals import ViewResiduals as ViewResiduals
