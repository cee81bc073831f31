"""Doors to the simulator: many worlds in one call, and Gymnasium's single environment as a batch of one.

``acting`` is about policies in these environments.
"""
