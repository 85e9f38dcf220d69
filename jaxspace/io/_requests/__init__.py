"""What a file requests of its runs: their accuracy, the inputs that scatter, the outputs that are
kept, and what is to be best."""
