"""``pter reproduce``: experiments and plots combined into files for a reader."""
