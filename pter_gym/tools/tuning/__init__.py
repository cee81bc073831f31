"""Gains for laws, searched on training episodes; test episodes are never read."""
