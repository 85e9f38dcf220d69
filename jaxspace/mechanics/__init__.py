"""General mechanics: impulse and impact."""

from ._impact import contact_impulse as contact_impulse
from ._impact import contact_inverse_mass as contact_inverse_mass
from ._impact import crushable_pad as crushable_pad
from ._impact import impact_energy_loss as impact_energy_loss
