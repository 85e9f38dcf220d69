"""The accuracy of a campaign by its purpose: how it is asked for, and what was found."""

__all__ = ["ByPurpose", "Purpose"]

from typing import Any, NamedTuple, TypeAlias, final

import equinox as eqx

from ..core import InputError, Scalar
from ..core.printing import printed
from ..integration.accuracy import DEFAULT, Accuracy, as_accuracy

BY_PURPOSE = "by purpose"


@final
class ByPurpose(eqx.Module):
    """The loosest tolerance that serves a campaign: `disperse(..., accuracy="by purpose")`.

    The numerical error of each output is then below a twentieth of its sampling error, which is
    that of the mean of so many runs, `std / sqrt(runs)`. Runs at several tolerances tell; the
    result says what they showed (`Dispersion.purpose`). Studies that draw no runs, and a replay
    that is not told the tolerance of the campaign, take the default tolerance.

    - `accuracy`: method and limits of the steps, without `rtol` and `atol`, which are found.

    **Raises** `InputError` for an `accuracy` with a tolerance."""

    accuracy: Accuracy = DEFAULT

    def __check_init__(self):
        given = self.accuracy
        # A placeholder of a tree transformation passes.
        if isinstance(given, Accuracy) and (given.rtol is not None or given.atol is not None):
            raise InputError(
                "ByPurpose.accuracy has a tolerance, which follows from the purpose: give its "
                "method and limits alone, or the tolerance in place of ByPurpose."
            )


@printed()
class Purpose(NamedTuple):
    """The tolerance that serves a campaign.

    - `tolerance`: relative, of each step.
    - `default`: the one that it takes the place of; `evaluations` of the vector field, as a share
      of those there.
    - `excess`: the largest numerical error, in units of what is allowed: above one where even the
      tightest tolerance does not serve."""

    tolerance: float
    default: float
    evaluations: float
    excess: float

    @property
    def sentence(self) -> str:
        """The tolerance, whether it serves, and what it saves."""
        if self.excess > 1.0:
            return (
                f"accuracy by purpose: at {self.tolerance:.0e}, the tightest tolerance that was "
                f"tried, the largest numerical error is {self.excess:.2g} times what is allowed, a "
                f"twentieth of the sampling error."
            )
        if self.excess == 0.0:
            return (
                f"accuracy by purpose: {self.tolerance:.0e}, the default, for no output that "
                f"scatters depends on it."
            )
        change = 100.0 * (self.evaluations - 1.0)
        spent = f"{abs(change):.0f} % {'more' if change > 0.0 else 'fewer'} evaluations than"
        return (
            f"accuracy by purpose: {self.tolerance:.0e}, with {spent} at the default "
            f"{self.default:.0e}; numerical errors are below a twentieth of the sampling errors."
        )


# A number is the relative tolerance of each step, a text `BY_PURPOSE`.
CampaignAccuracy: TypeAlias = Accuracy | ByPurpose | Scalar | str | None


def as_campaign_accuracy(given: Any) -> Accuracy | ByPurpose:
    """What a campaign is asked for, from one of its forms.

    **Raises** `InputError` for another text than "by purpose", and as `as_accuracy`."""
    if isinstance(given, ByPurpose):
        return given
    if isinstance(given, str):
        if given == BY_PURPOSE:
            return ByPurpose()
        raise InputError(
            f'accuracy is {given!r}: it must be a relative tolerance, an Accuracy or "{BY_PURPOSE}"'
            f".{InputError.hint(given, [BY_PURPOSE])}"
        )
    return as_accuracy(given)
