"""Options that ask for the accuracy where the robot works."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calibrant.tasks.options.option import Option

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult


@dataclass(frozen=True, kw_only=True)
class WorkspaceOptions:
    """A volume of the base, and what is asked of the errors in it."""

    workspace: Annotated[str | None, Option("VOLUME")] = None
    """Say the accuracy in this volume of the base: 300mm:700mm,-200mm:200mm,0mm:100mm (x, y, z)."""
    tolerance: Annotated[str | None, Option("LENGTH")] = None
    """Fail unless 95 % of the errors in the workspace stay below this, e.g. 1mm."""
    target_sigma: Annotated[str | None, Option("PERCENT")] = None
    """How well the board's size is known (1 sigma), for the workspace; 0.05% unless given."""

    def check(self) -> None:
        """Raises: InputError for a volume, a tolerance or a sigma that cannot be read."""
        from calibrant.diagnose.budget.volume import check_request

        check_request(self.workspace, self.tolerance, self.target_sigma)

    def applied(self, result: CalibrationResult) -> CalibrationResult:
        """The result with its accuracy in the workspace asked for, where one is. Raises: InputError for a wrong one."""
        self.check()
        if self.workspace is None:
            return result
        from calibrant.diagnose.budget.workspace import with_workspace

        return with_workspace(result, self.workspace, tolerance=self.tolerance, target_sigma=self.target_sigma)
