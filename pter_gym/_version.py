"""The version of pter_gym, in its one place."""

__version__ = "1.0.0"
