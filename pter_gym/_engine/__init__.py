"""Many worlds: a control step as scalar functions, kernels that loop over worlds, the batch."""
