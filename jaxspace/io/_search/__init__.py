"""What the [optimize] of a file computes: the search for the best of its free numbers, for the
nominal run or over the runs of [dispersion], and its result."""
