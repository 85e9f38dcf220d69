"""Computations of a validated file: its nominal run, the campaign of its [dispersion], and the
outputs of both."""
