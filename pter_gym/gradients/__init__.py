"""Rollouts of one machine with their exact gradients, through stick-slip.

``rollout`` simulates a machine with given voltages and forces; ``Rollout.gradient`` returns the
derivatives of a scalar with respect to voltages, forces, the initial state and the machine.
``pter_gym.gradients.jax`` does the same for ``jax.grad``.
"""

from pter_gym.gradients._rollout import Gradient, Rollout, rollout

__all__ = ["Gradient", "Rollout", "rollout"]
