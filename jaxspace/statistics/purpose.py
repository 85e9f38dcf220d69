"""The tolerance sufficient for the purpose of a campaign, and its savings."""

__all__ = ["Purpose"]

from typing import NamedTuple

from ..core.printing import printed


@printed()
class Purpose(NamedTuple):
    """The tolerance sufficient for a campaign.

    - `tolerance`: relative, of each step.
    - `default`: the one that it replaces; `evaluations` of the vector field, as a share
      of those there.
    - `excess`: the largest numerical error, in units of the allowed error: above one where even the
      tightest tolerance is insufficient."""

    tolerance: float
    default: float
    evaluations: float
    excess: float

    @property
    def sentence(self) -> str:
        """The tolerance, whether it is sufficient, and its savings."""
        if self.excess > 1.0:
            return (
                f"accuracy by purpose: at {self.tolerance:.0e}, the tightest tolerance tried, the "
                f"largest numerical error is {self.excess:.2g} times the allowed one, a twentieth "
                "of the sampling error."
            )
        if self.excess == 0.0:
            return (
                f"accuracy by purpose: {self.tolerance:.0e}, the default, because no dispersed "
                "output depends on it."
            )
        change = 100.0 * (self.evaluations - 1.0)
        spent = f"{abs(change):.0f} % {'more' if change > 0.0 else 'fewer'} evaluations than"
        return (
            f"accuracy by purpose: {self.tolerance:.0e}, with {spent} at the default "
            f"{self.default:.0e}; numerical errors are below a twentieth of the sampling errors."
        )
