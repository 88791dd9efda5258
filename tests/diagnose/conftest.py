"""The results that are looked at here."""

from tests.made_results import hand_eye_result as hand_eye_result
from tests.made_results import intrinsics_result as intrinsics_result
