"""The methods among which the library chooses, by their purpose.

Outside of `solvers` no other file names a concrete solver (`tests/test_layers.py`): code that
depends on a method reads its traits."""

from ..solvers import DOP853, RKN1210, AdaptiveRegularised, ExponentialRosenbrock, Tsit5

# For every system; of order 8.
HIGH_ORDER = DOP853()
# For every system; of order 5, with fewer evaluations at loose tolerances.
LOW_ORDER = Tsit5()
# For r' = v, v' = a(t, r) alone.
SECOND_ORDER = RKN1210()
# For eccentric orbits.
REGULARISED = AdaptiveRegularised()
# For slow motion together with a fast linear one.
STIFF = ExponentialRosenbrock()
