"""Reinforcement-learning training and export for PTER, on top of pter_gym's public interface."""
