"""``pter``: one file for each command of the core."""
