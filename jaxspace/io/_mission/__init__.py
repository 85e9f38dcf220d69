"""The dynamics of a file: its tables of systems, bodies, effects, phases, branches, control and
flights, their consistency checks, and the mission that is built from them."""
