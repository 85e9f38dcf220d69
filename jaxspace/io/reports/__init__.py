"""Texts that commands print: reports of runs, optima and campaigns, in the units of the file."""
