"""Data sets for offline learning: episodes of policies at several skill levels, in Minari's format.

``pter record`` writes them. Only training draws are used, never the episodes on which policies are
compared.
"""
