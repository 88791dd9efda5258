"""An estimate against the truth that only a simulation has: is the error as large as it was predicted to be?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from calibrant.arrays import Array
from calibrant.data import TransformEstimate
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

CONFIDENCE = 0.99


@dataclass(frozen=True, eq=False)
class TransformTruth:
    """error (6,) = (rotation, radians; translation, metres), truth minus estimate, along the parent's axes; sigma (6,).

    normalised = e^T C^-1 e follows chi-square with 6 degrees of freedom when the covariance tells the truth; `limit`
    is where its CONFIDENCE region ends.
    """

    error: Array
    sigma: Array
    normalised: float
    limit: float

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the region of CONFIDENCE."""
        return self.normalised <= self.limit

    @property
    def translation_mm(self) -> float:
        """Distance between the estimated and the true origin."""
        return float(se3.mm_and_deg(self.error)[0])

    @property
    def rotation_deg(self) -> float:
        """Angle between the estimated and the true rotation."""
        return float(se3.mm_and_deg(self.error)[1])


@dataclass(frozen=True)
class PointTruth:
    """Distance in millimetres between where a point is and where the estimate puts it; sigma is its predicted RMS."""

    error_mm: float
    sigma_mm: float


def transform_truth(estimate: TransformEstimate, T_true: ArrayLike) -> TransformTruth:
    """Compare an estimate with the truth, both T_parent_child. Raises: InputError when it carries no covariance."""
    covariance = _stated_covariance(estimate)
    error = se3.local(estimate.matrix, T_true)
    limit = float(chi2.ppf(CONFIDENCE, 6))
    return TransformTruth(error, np.sqrt(np.diag(covariance)), chi_square(error, covariance), limit)


def normalised(estimate: TransformEstimate, T_true: ArrayLike) -> float:
    """e^T C^-1 e of an estimate and the truth, chi-square with 6 degrees of freedom when its covariance is right.

    Raises: InputError when the estimate carries no covariance.
    """
    return transform_truth(estimate, T_true).normalised


def chi_square(error: ArrayLike, covariance: ArrayLike | None) -> float:
    """e^T C^-1 e of an error (k,) and its covariance (k, k): chi-square with k degrees of freedom when that is right.

    Raises: InputError when there is no covariance.

    >>> chi_square([2.0, 0.0], [[4.0, 0.0], [0.0, 1.0]])
    1.0
    """
    if covariance is None:
        raise InputError("an error has no chi-square without its covariance")
    e = np.asarray(error, dtype=np.float64)
    return float(e @ np.linalg.solve(np.asarray(covariance, dtype=np.float64), e))


def point_truth(estimate: TransformEstimate, T_true: ArrayLike, p_child: ArrayLike) -> PointTruth:
    """Error of a point of the child frame taken to the parent frame, p_parent = T_parent_child p_child.

    Predicted: C_p = J C J^T with J = [-hat(R p), I]; the RMS distance is sqrt(trace C_p). Args: p_child (3,) metres.
    """
    p = np.asarray(p_child, dtype=np.float64)
    covariance = _stated_covariance(estimate)
    J = np.hstack([-so3.hat(estimate.matrix[:3, :3] @ p), np.eye(3)])
    error = se3.apply(T_true, p) - se3.apply(estimate.matrix, p)
    sigma = float(np.sqrt(np.trace(J @ covariance @ J.T)))
    return PointTruth(float(1e3 * np.linalg.norm(error)), 1e3 * sigma)


def _stated_covariance(estimate: TransformEstimate) -> Array:
    if estimate.covariance is None:
        raise InputError(
            f"the estimate {estimate.parent} -> {estimate.child} has no covariance to compare with the truth"
        )
    return estimate.covariance
