"""Worlds as arrays: one control step as scalar functions, the kernels that loop over worlds, the batch."""
