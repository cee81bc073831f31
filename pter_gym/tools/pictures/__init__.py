"""Pictures and films: what a world looks like, and figures of scores."""
