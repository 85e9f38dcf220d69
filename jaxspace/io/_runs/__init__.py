"""What a checked file computes: its nominal run, the campaign of its [dispersion], and the outputs
of both."""
