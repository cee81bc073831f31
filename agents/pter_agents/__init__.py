"""Reinforcement-learning training and export for PTER, on top of pter_gym's public interface."""

from pter_agents.environment import make_env

__all__ = ["make_env"]
