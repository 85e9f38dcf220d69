"""What an entry of a file can be: how a value is read, what is expected of it, its JSON schema, and
the sentences about what is wrong. It knows no table of a file and no physics."""
