"""Tasks: reset, observation, reward and termination."""
