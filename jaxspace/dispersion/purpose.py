"""Request for the accuracy of a campaign by its purpose."""

__all__ = ["ByPurpose"]

import dataclasses
from typing import TypeAlias, final

import equinox as eqx
import jax.numpy as jnp

from ..core import InputError, Scalar
from ..core.suggestions import suggests
from ..integration.accuracy import DEFAULT, DEFAULT_RTOL, Accuracy, as_accuracy

BY_PURPOSE = "by purpose"


@suggests
@final
class ByPurpose(eqx.Module):
    """The loosest tolerance sufficient for a campaign: `disperse(..., accuracy="by purpose")`.

    The numerical error of each output is then below a twentieth of its sampling error, that of the
    mean over the runs, `std / sqrt(runs)`. It is determined from runs at several tolerances;
    `Dispersion.purpose` reports the result. Studies without runs, and a replay without the
    tolerance of the campaign, use the default tolerance.

    - `accuracy`: method and limits of the steps, without `rtol` and `atol`, which are determined.

    **Raises** `InputError` for an `accuracy` with a tolerance."""

    accuracy: Accuracy = DEFAULT

    def __check_init__(self):
        given = self.accuracy
        # A placeholder of a tree transformation passes.
        if isinstance(given, Accuracy) and (given.rtol is not None or given.atol is not None):
            raise InputError(
                "ByPurpose.accuracy sets a tolerance, which is derived from the purpose: specify "
                "only its method and limits, or the tolerance instead of ByPurpose."
            )


# A number is the relative tolerance of each step, a text `BY_PURPOSE`.
CampaignAccuracy: TypeAlias = Accuracy | ByPurpose | Scalar | str | None


def as_campaign_accuracy(given: object) -> Accuracy | ByPurpose:
    """The accuracy requested for a campaign, from any of its forms.

    **Raises** `InputError` for text other than "by purpose", and as `as_accuracy` does."""
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


def with_tolerance(accuracy: Accuracy) -> Accuracy:
    """The accuracy with the default tolerance where it has none."""
    if accuracy.rtol is not None:
        return accuracy
    return dataclasses.replace(accuracy, rtol=DEFAULT_RTOL[jnp.result_type(float).name])
