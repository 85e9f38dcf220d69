"""Scene files: TOML that says what moves, checked as a whole before anything is computed.

The room knows the form of a file - bodies, phases, dispersions, units - and no particular force:
which systems, effects, jumps, events and outputs there are, the rooms of physics declare."""

from ._campaign_report import comparison_table as comparison_table
from ._campaign_report import failures_report as failures_report
from ._campaign_report import moments_report as moments_report
from ._campaign_report import replay_report as replay_report
from ._catalog import Catalog as Catalog
from ._catalog import catalog as catalog
from ._ephemeris import Ephemeris as Ephemeris
from ._ephemeris import read_oem as read_oem
from ._ephemeris import write_oem as write_oem
from ._errors import SceneError as SceneError
from ._listing import listing as listing
from ._listing import schema as schema
from ._load import load as load
from ._mean_elements import CataloguedOrbit as CataloguedOrbit
from ._mean_elements import read_omm as read_omm
from ._mean_elements import read_tle as read_tle
from ._optimum import Optimum as Optimum
from ._report import dispersion_report as dispersion_report
from ._report import mission_report as mission_report
from ._report import optimum_report as optimum_report
from ._report import run_report as run_report
from ._report import sensitivity_report as sensitivity_report
from ._scene_file import SceneFile as SceneFile
from ._stored import stored_scene as stored_scene
from ._units import read_option as read_option
