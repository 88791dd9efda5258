"""The doctor: what is wrong with hand-eye data, how sure that is, and the repair."""

from __future__ import annotations

from calibrant.diagnose.doctor.evidence.case import Case, case_of_poses, case_of_views
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence, Loop
from calibrant.diagnose.doctor.search import Examination, examine

__all__ = ["Case", "Evidence", "Examination", "Finding", "Loop", "case_of_poses", "case_of_views", "examine"]
