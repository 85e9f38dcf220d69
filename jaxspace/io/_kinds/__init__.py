"""Kinds of file entries: reading of values, expectations, JSON schema and error messages. It knows
no table of a file and no physics."""
