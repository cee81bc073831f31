"""The paper of 1999: its experiments, its figures, and its claims beside our measurements."""
