"""What moves in a file: its tables of systems, bodies, effects, phases, branches, control and
flights, the checks of them together, and the mission that is built from them."""
