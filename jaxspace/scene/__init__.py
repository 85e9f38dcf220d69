"""Composition: a body and its effects as one system, which integrates only what they require."""

from ._custom import Custom as Custom
from ._explain import EffectRow as EffectRow
from ._explain import budget as budget
from ._explain import compile_vector_field as compile_vector_field
from ._explain import explain as explain
from ._explain import operation_count as operation_count
from ._ground import ground_warning as ground_warning
from ._outputs import end_time as end_time
from ._reading import Reading as Reading
from ._reading import read_effects as read_effects
from ._scaled import Scaled as Scaled
from ._scaled import scaled as scaled
from ._scene import Scene as Scene
