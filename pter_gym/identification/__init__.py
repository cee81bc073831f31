"""Parameters of a real machine from a log of it."""
