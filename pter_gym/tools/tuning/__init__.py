"""Gains for controllers, searched on training draws; evaluation episodes are never read."""
