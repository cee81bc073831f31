"""Gains for controllers, searched on training draws of a scenario; evaluation episodes are never read."""
