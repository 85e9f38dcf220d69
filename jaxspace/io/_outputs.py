"""The numbers of interest at the end of a mission, for every run of a campaign."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import AbstractBody, BodyState
from ..simulation import MissionTrajectory
from ._lanes import Lanes
from ._values import replaced


class End(NamedTuple):
    """How runs side by side ended, runs last.

    - `final`: the state after the last jump; `burnout`: at the end of the last phase with thrust,
      else the final state.
    - `body`, `values`: what was flown. `intended`: the initial state that the file asks for, of one
      run: vectors (3, 1).
    - `nominal`: the end of the nominal run, in the same form; `None` while that one is itself
      looked at."""

    final: BodyState
    burnout: BodyState
    body: AbstractBody
    values: dict[str, Any]
    intended: BodyState
    nominal: "End | None"


class Outputs(eqx.Module):
    """The `outputs` of a campaign: those of the names `wanted`.

    `reference`: final state and state at burnout of the nominal run, as `nominal_states` gives
    them."""

    file: Any = eqx.field(static=True)
    values: dict[str, Any]
    wanted: tuple[str, ...] = eqx.field(static=True)
    reference: tuple[BodyState, BodyState] | None

    def __call__(self, result: Any, samples: dict[str, Array]) -> dict[str, Array]:
        last = jax.tree.map(lambda x: x[-1], result.spans[burn_phase(self.values)].states)
        return self.numbers(result.final, last, samples)

    def numbers(
        self, final: BodyState, burnout: BodyState, samples: dict[str, Array]
    ) -> dict[str, Array]:
        """The outputs from the final state and the one at burnout; with a reference, compared with
        the nominal run."""
        intended = self.file.registry.initial.build(self.values, Lanes(1))
        nominal = None
        if self.reference is not None:
            nominal = End(
                *self.reference, self.file.body(self.values, Lanes(1)), self.values, intended, None
            )
        values = replaced(self.values, samples)
        runs = final.position.shape[-1] if final.position is not None else final.omega.shape[-1]
        end = End(final, burnout, self.file.body(values, Lanes(runs)), values, intended, nominal)
        entries = self.file.registry.outputs
        return {name: jnp.broadcast_to(entries[name].value(end), (runs,)) for name in self.wanted}


def burn_phase(values: dict[str, Any]) -> int:
    """Index of the last phase in which a thrust acts; -1 where none does."""
    burning = [k for k, phase in enumerate(values.get("phase", ())) if "thrust" in phase["effects"]]
    return burning[-1] if burning else -1


def nominal_states(values: dict[str, Any], flown: MissionTrajectory) -> tuple[BodyState, BodyState]:
    """Final state and state at burnout of one flown mission, with an axis of one run."""
    return jax.tree.map(
        lambda x: x[..., None], (flown.final, flown.phases[burn_phase(values)].final)
    )
