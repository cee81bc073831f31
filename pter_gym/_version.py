"""The version of pter_gym, in its one place."""

__version__ = "0.1.0"
