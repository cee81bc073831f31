"""Data sets for offline learning: episodes of policies at several skill levels, in Minari's format.

``pter record`` writes them, of training episodes.
"""
