"""Training on the batch engine, and export of what it has learned; needs the extra ``agents``."""
