"""Errors of training."""

from pter_gym.errors import PterError


class TrainingDivergedError(PterError, ArithmeticError):
    """A loss or a gradient is no longer a finite number; the message names the last good checkpoint."""
