"""Schemes of splitting: the sequence of drifts and kicks, and their fractions of a step.

    K(o_0 h) D(i_1 h) K(o_1 h) ... D(i_m h) K(o_m h)      the drifts inside, or with D and K
                                                          interchanged: the kicks inside
    o_k = o_(m-k),   i_k = i_(m+1-k),   sum o = sum i = 1

For a kick of the size eps relative to the drift, the error is of the size

    2, 4, 6        eps h^2, eps h^4, eps h^6                   compositions of Strang's step
    (8, 2)         eps h^8 + eps^2 h^2                         four kicks, at Gauss's places
    (8, 6, 4)      eps h^8 + eps^2 h^6 + eps^3 h^4             seven kicks

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration, II.4 (order 4: Suzuki's five),
V.3.2 (order 6: Yoshida's seven); McLachlan (1995), Composition methods in the presence of small
parameters, BIT 35, 258, and Laskar, Robutel (2001), Celestial Mechanics 80, 39 (8, 2); Blanes and
others (2013), New families of symplectic splitting methods for numerical integration in dynamical
astronomy, Applied Numerical Mathematics 68, 58 (8, 6, 4).
"""

from typing import NamedTuple

import numpy as np


class Scheme(NamedTuple):
    """The parts of a step: the map `outside` has one part more than the other.

    - `outside`, `inside`: o_k and i_k.
    - `kicks_inside`: whether the drift is outside."""

    outside: tuple[float, ...]
    inside: tuple[float, ...]
    kicks_inside: bool = False

    @property
    def kicks(self) -> int:
        """Number of kicks per step; the last of a step and the first of the next count as one."""
        return len(self.inside)

    def rows(self) -> np.ndarray:
        """The table of one step, with a column for each part inside.

        The rows are fractions of the step: the length of the part and its start; the length of the
        part outside that follows and its place; and what the next step adds to the latter."""
        inside, outside = np.array(self.inside), np.array(self.outside)
        # The time passes in the drifts.
        passed = np.cumsum(outside[:-1]) if self.kicks_inside else np.cumsum(inside) - inside
        after = passed if self.kicks_inside else np.cumsum(inside)
        joined = np.append(np.zeros(inside.size - 1), outside[0])
        return np.stack([inside, passed, outside[1:], after, joined], axis=1)


def _strang(*parts: float) -> Scheme:
    """A composition of Strang's steps of these lengths, with successive half kicks joined."""
    g = np.array([0.0, *parts, 0.0])
    return Scheme(tuple(0.5 * (g[1:] + g[:-1])), parts)


def _kicks_inside(drifts: tuple[float, ...], kicks: tuple[float, ...]) -> Scheme:
    """A symmetric scheme from the first halves of its drifts and its kicks; the middle part belongs
    to the half of the map with an odd number of parts."""
    # There is one drift more than kicks, so that one of both numbers is odd.
    odd = len(drifts) > len(kicks)
    return Scheme(
        (*drifts, *reversed(drifts[:-1] if odd else drifts)),
        (*kicks, *reversed(kicks if odd else kicks[:-1])),
        kicks_inside=True,
    )


_SUZUKI = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
_YOSHIDA = (0.78451361047755726382, 0.23557321335935813368, -1.17767998417887100695)
SCHEMES: dict[int | tuple[int, ...], Scheme] = {
    2: _strang(1.0),
    4: _strang(_SUZUKI, _SUZUKI, 1.0 - 4.0 * _SUZUKI, _SUZUKI, _SUZUKI),
    6: _strang(*_YOSHIDA, 1.0 - 2.0 * sum(_YOSHIDA), *reversed(_YOSHIDA)),
    (8, 2): _kicks_inside(
        (0.06943184420297371239, 0.26057763400459815521, 0.33998104358485626480),
        (0.17392742256872692869, 0.32607257743127307131),
    ),
    (8, 6, 4): _kicks_inside(
        (
            *(0.07113342649822311778, 0.24115342795664009874),
            *(0.52141176177281478921, -0.33369861622767800573),
        ),
        (
            *(0.18308368747219722196, 0.31078285989857486951),
            *(-0.02656461851195880070, 0.06539614228237341846),
        ),
    ),
}
