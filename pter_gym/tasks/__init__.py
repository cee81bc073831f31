"""Goals: reset law, observation, reward and termination."""
