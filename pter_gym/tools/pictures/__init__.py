"""Pictures and videos of worlds, and figures of scores."""
