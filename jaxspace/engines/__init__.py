"""Engines, which compute the runs of a campaign chunk by chunk: in this process, in other processes
of this machine, on a Dask cluster, or on several hosts.

All give bit-identical results: the numbers of a run follow from the campaign and the number of the
run only. A chunk that is lost with its worker is computed again, and finished results are stored
before the next chunk begins."""

from ._dask import DaskCluster as DaskCluster
from ._interface import AbstractEngine as AbstractEngine
from ._interface import AbstractRunner as AbstractRunner
from ._process_pool import ProcessPool as ProcessPool
from .named import MultiHost as MultiHost
from .named import Part as Part
