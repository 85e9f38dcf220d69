"""The requests of a file for its runs: accuracy, dispersed inputs, recorded outputs and
optimisation."""
