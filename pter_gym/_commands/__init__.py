"""``pter``: one file for each command."""
