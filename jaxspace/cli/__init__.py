"""The command line: the one place that turns strings into classes, and radians into degrees."""

from ._main import main as main
from ._registry import REGISTRY as REGISTRY
from ._registry import load as load
