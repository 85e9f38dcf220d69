"""jaxspace: differentiable space dynamics in JAX.

The packages, from the ground up:

    constants       numbers with unit and source
    core            foundations: the interface of a system, declared quantities, checks
    rotations       orientation: quaternion, Euler angles, matrix
    bodies          bodies with mass: inertia, mass properties, Newton-Euler, interface of effects
    orbits          point motion under gravity: two-body motion, elements, Kepler, oblateness
    attitude        rigid-body rotation: torque-free, heavy top, despin
    gyros           instruments: two-gimbal gyro, gyrocompass, rate gyro, platform
    rockets         variable mass: thrust, jet damping, rocket equation
    vehicles        rockets in air: airframe, wind, rail, flights (imported by name)
    mechanics       systems from a Lagrangian, impulse and impact (imported by name)
    scene           a body and its effects as one system
    solvers         integrators as diffrax solvers
    integration     integration of a system: method, tolerances, events, derivatives
    simulation      simulation of one or many runs of a system or a mission of phases
    studies         analyses of a run: cost of accuracy, influence of effects, modes
    control         sampled controllers, sensors, environments (imported by name)
    sampling        random inputs: distributions, designs (imported by name)
    statistics      statistics of many runs: limits, joint spread, contributors, requirements
    stores          campaigns on disk (imported by name)
    engines         engines for campaign runs, local or on a cluster (imported by name)
    dispersion      campaigns of many runs
    minimisation    constrained minimisation (imported by name)
    optimization    staging, steering
    robust          design optimisation under dispersion (imported by name)
    estimation      parameters and states from data (imported by name)
    verification    edge cases and laws (imported by name)
    io, plots, cli  files, figures, the command line (imported by name, with the extra `app`)

Each package is imported on first use of it or of one of its names: `import jaxspace` itself loads
none of them, nor JAX.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    # For editors and type checkers, which do not treat `_PACKAGES` and `_MODULE_OF` as imports.
    from . import attitude as attitude
    from . import bodies as bodies
    from . import constants as constants
    from . import core as core
    from . import dispersion as dispersion
    from . import gyros as gyros
    from . import integration as integration
    from . import optimization as optimization
    from . import orbits as orbits
    from . import rockets as rockets
    from . import rotations as rotations
    from . import scene as scene
    from . import simulation as simulation
    from . import solvers as solvers
    from . import statistics as statistics
    from . import studies as studies
    from ._jax_settings import enable_x64 as enable_x64
    from ._jax_settings import keep_programs as keep_programs
    from ._jax_settings import stored_as as stored_as
    from ._load import example as example
    from ._load import load as load
    from .bodies import BodyState as BodyState
    from .core import AbstractSystem as AbstractSystem
    from .scene import Scene as Scene
    from .simulation import Accuracy as Accuracy
    from .simulation import Event as Event
    from .simulation import FinalError as FinalError
    from .simulation import Mission as Mission
    from .simulation import Phase as Phase
    from .simulation import Status as Status
    from .simulation import Trajectory as Trajectory
    from .simulation import simulate as simulate
    from .simulation import simulate_batch as simulate_batch
    from .simulation import simulate_mission as simulate_mission
    from .simulation import simulate_mission_batch as simulate_mission_batch

    __version__: str

# The names above for Python: the packages, and the module that each other name comes from.
_PACKAGES = (
    "attitude",
    "bodies",
    "constants",
    "core",
    "dispersion",
    "gyros",
    "integration",
    "optimization",
    "orbits",
    "rockets",
    "rotations",
    "scene",
    "simulation",
    "solvers",
    "statistics",
    "studies",
)
_MODULE_OF = {
    "enable_x64": "_jax_settings",
    "keep_programs": "_jax_settings",
    "stored_as": "_jax_settings",
    "example": "_load",
    "load": "_load",
    "BodyState": "bodies",
    "AbstractSystem": "core",
    "Scene": "scene",
    "Accuracy": "simulation",
    "FinalError": "simulation",
    "Event": "simulation",
    "Mission": "simulation",
    "Phase": "simulation",
    "Status": "simulation",
    "Trajectory": "simulation",
    "simulate": "simulation",
    "simulate_batch": "simulation",
    "simulate_mission": "simulation",
    "simulate_mission_batch": "simulation",
}

if not TYPE_CHECKING:
    # Out of the sight of type checkers, for which a module with a `__getattr__` has every name.
    __all__ = [*_PACKAGES, *_MODULE_OF]

    def __getattr__(name):
        """A package, or a name of one, which is imported on first use."""
        # Here, because the names of this file are those of the library.
        from importlib import import_module, metadata

        if name == "__version__":
            try:
                # Of the installation: its build takes the version from the tag of the repository.
                return metadata.version(__name__)
            except metadata.PackageNotFoundError:
                # Sources on the path that were not installed.
                return "0+unknown"
        if name in _PACKAGES:
            # The import sets the attribute too: the next use does not come here.
            return import_module(f"{__name__}.{name}")
        if name not in _MODULE_OF:
            if name.startswith("_"):
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
            unknown_name = import_module(f"{__name__}.core.modules").unknown_name
            raise unknown_name(__name__, name)
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__():
        """The public names, whether they are imported yet or not."""
        return sorted({*globals(), *__all__} - {"TYPE_CHECKING"})
