"""Optimisation of a file with [optimize]: the search for its design variables, for the nominal run
or over the runs of [dispersion], and its result."""
