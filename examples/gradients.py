"""Differentiate through stick-slip: find voltages under which a push takes the tip to a target."""

import numpy as np

from pter_gym import initial_state
from pter_gym.gradients import rollout

STEPS, ITERATIONS = 100, 40  # steps of 10 ms

start, push, goal = initial_state(None, (1.9, 0.6)), np.array([40.0, 0.0]), np.array([0.5, 0.7])
volts = np.full((STEPS, 4), 10.0)
for iteration in range(ITERATIONS):
    run = rollout(None, start, volts, push)  # None: the machine of the paper
    miss = run.tip_position[-1] - goal
    if iteration % 10 == 0:
        print(f"iteration {iteration:2}: {1000 * np.hypot(*miss):5.1f} mm from the goal")

    # from the derivative of miss² with respect to the tip's positions to those with respect to
    # voltages, forces, start and machine
    by_position = np.zeros_like(run.tip_position)
    by_position[-1] = 2.0 * miss
    gradient = run.gradient(tip_position=by_position)
    scale = np.sqrt(np.square(gradient.volts).mean()) + 1e-12
    volts = np.clip(volts - 0.5 * 0.9**iteration * gradient.volts / scale, 0.0, 24.0)

print(f"at the end: {1000 * np.hypot(*miss):5.1f} mm")
print(f"d(miss²)/d(time constant) = {gradient.machine['clutch.time_constant']:.2g} m²/s")
