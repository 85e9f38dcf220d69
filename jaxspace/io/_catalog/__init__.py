"""Names available in scene files: the classes and functions of the library and of users' modules,
with the entries that follow from their declarations."""
