"""Scene files: TOML descriptions of systems and their runs, fully validated before anything is
computed.

This package knows the form of a file (bodies, phases, dispersions, units) and no particular force:
systems, effects, jumps, events and outputs are declared by the packages of physics."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._catalog.catalog import Catalog as Catalog
from ._catalog.catalog import catalog as catalog
from ._kinds.errors import SceneError as SceneError
from ._listing import listing as listing
from ._listing import schema as schema
from ._load import load as load
from ._load import stored_scene as stored_scene
from ._scene_file import SceneFile as SceneFile
from ._search.optimum import Optimum as Optimum
from .examples import example as example

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import ephemeris as ephemeris
    from . import examples as examples
    from . import flight_logs as flight_logs
    from . import log_comparison as log_comparison
    from . import maps as maps
    from . import mean_elements as mean_elements
    from . import orbit_state as orbit_state
    from . import tracks as tracks
else:
    __getattr__, __dir__ = _modules_of(__name__)
