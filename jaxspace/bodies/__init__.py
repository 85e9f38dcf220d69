"""Bodies with mass: inertia, mass properties, state, equations of motion, and the interface of
effects."""

from ._body import AbstractBody as AbstractBody
from ._body import BurningBody as BurningBody
from ._body import RigidBody as RigidBody
from ._effect import AbstractEffect as AbstractEffect
from ._effect import Load as Load
from ._free_motion import FreeRotation as FreeRotation
from ._inertia import AbstractInertia as AbstractInertia
from ._inertia import InertiaTensor as InertiaTensor
from ._inertia import PrincipalInertia as PrincipalInertia
from ._inertia import as_inertia as as_inertia
from ._inertia import kinetic_energy as kinetic_energy
from ._inertia import parallel_axes as parallel_axes
from ._jump import AbstractJump as AbstractJump
from ._newton_euler import angular_acceleration as angular_acceleration
from ._newton_euler import linear_acceleration as linear_acceleration
from ._principal_axes import principal_axes as principal_axes
from ._principal_axes import tensor_function as tensor_function
from ._principal_frame import free_turn as free_turn
from ._state import PARTS as PARTS
from ._state import BodyState as BodyState
from ._state import sample_state as sample_state
