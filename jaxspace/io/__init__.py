"""Scene files: TOML that says what flies, checked as a whole before anything is computed.

The room knows the form of a file - bodies, phases, dispersions, units - and no particular force:
which effects, systems, jumps and outputs there are, a `Registry` says."""

from ._errors import SceneError as SceneError
from ._lanes import Lanes as Lanes
from ._load import load as load
from ._outputs import End as End
from ._quantities import Choice as Choice
from ._quantities import Measure as Measure
from ._quantities import Quantity as Quantity
from ._registry import EffectEntry as EffectEntry
from ._registry import InitialEntry as InitialEntry
from ._registry import JumpEntry as JumpEntry
from ._registry import OutputEntry as OutputEntry
from ._registry import Registry as Registry
from ._registry import SystemEntry as SystemEntry
from ._scene_file import SceneFile as SceneFile
from ._tables import Key as Key
from ._tables import ListOf as ListOf
