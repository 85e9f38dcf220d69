"""Composition: a body and its effects as one system, which integrates only what they require."""

from typing import TYPE_CHECKING

from ..core.modules import modules_of as _modules_of
from ._custom import Custom as Custom
from ._explain import EffectRow as EffectRow
from ._explain import budget as budget
from ._explain import explain as explain
from ._scaled import Scaled as Scaled
from ._scaled import scaled as scaled
from ._scene import Scene as Scene

if TYPE_CHECKING:
    # For type checkers, which do not see how a module is imported when it is first used.
    from . import outputs as outputs
    from . import random_loads as random_loads
else:
    __getattr__, __dir__ = _modules_of(__name__)
