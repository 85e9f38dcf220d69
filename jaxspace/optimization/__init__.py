"""Optimal rockets and transfers: staging, steering, direct shooting, rendezvous, and a constrained
minimiser by gradients."""

from ._ascent import AbstractThrustAcceleration as AbstractThrustAcceleration
from ._ascent import Ascent as Ascent
from ._ascent import ConstantMassFlow as ConstantMassFlow
from ._ascent import ConstantThrustAcceleration as ConstantThrustAcceleration
from ._ascent import FlightState as FlightState
from ._ascent import apex as apex
from ._ascent import burnout_state as burnout_state
from ._criterion import Criterion as Criterion
from ._criterion import Minimum as Minimum
from ._criterion import StopReason as StopReason
from ._drive import Progress as Progress
from ._minimise import minimise as minimise
from ._minimise import minimise_from as minimise_from
from ._propellant_use import PropellantUse as PropellantUse
from ._propellant_use import propellant_use as propellant_use
from ._rendezvous import Rendezvous as Rendezvous
from ._rendezvous import least_rendezvous as least_rendezvous
from ._shooting import SteeredFlight as SteeredFlight
from ._shooting import SteeringOptimum as SteeringOptimum
from ._shooting import SteeringProfile as SteeringProfile
from ._shooting import optimise_steering as optimise_steering
from ._staging import Staging as Staging
from ._staging import equal_stages_payload as equal_stages_payload
from ._staging import optimal_staging as optimal_staging
from ._staging import optimal_staging_by_gradient as optimal_staging_by_gradient
from ._staging import stationary_mass_ratio as stationary_mass_ratio
from ._steering import LinearTangentSteering as LinearTangentSteering
from ._steering import MaximumVelocitySteering as MaximumVelocitySteering
from ._steering import linear_tangent_steering as linear_tangent_steering
from ._steering import maximum_velocity_steering as maximum_velocity_steering
from ._steering import minimum_time_steering as minimum_time_steering
