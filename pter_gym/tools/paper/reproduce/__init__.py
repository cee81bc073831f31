"""``pter reproduce``: experiments and plots joined to files that a person reads."""
