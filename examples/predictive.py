"""Model-predictive control by sampling: `pter watch examples/predictive.py:Predictive`.

It plans with the nominal machine and the mean push on the paper's path, without the hand's sines.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from pter_gym import PathFollowing
from pter_gym.benchmark import print_boards, run_scenario
from pter_gym.controllers import Policy
from pter_gym.envs import PathFollowingVectorEnv
from pter_gym.tasks.path_following import OBS

HELD, HORIZON = 3, 12  # control steps for which a voltage is held; steps planned, 0.36 s
TASK = PathFollowing()
CALM = replace(TASK, hand=replace(TASK.hand, amplitudes=(0.0,) * 5))
SAMPLES, ROUNDS, TEMPERATURE = 256, 5, 0.01
ERROR, PACE, ACROSS = 250.0, 8.0, 5.0  # costs: per m, per fraction of the pace, per m/s across


@cache
def model(machine, task):
    """Return worlds to try plans in, and their states at the start of the path."""
    held = {"action_unit": "volt", "frame_skip": HELD, "telemetry": False}
    env = PathFollowingVectorEnv(SAMPLES, machine=machine, task=task, **held)
    env.reset(seed=[0] * SAMPLES)
    return env, env.get_worlds()


def search(env, seen, mean, random, top):
    """Improve a plan, (HORIZON, 4) square roots of shares of the largest voltage."""
    for _ in range(ROUNDS):
        shift = random.standard_normal((SAMPLES, 1, 4)) * (random.random((SAMPLES, 1, 4)) < 0.6)
        plans = mean + 0.2 * shift + 0.1 * random.standard_normal((SAMPLES, HORIZON, 4))
        plans[0], plans[1:64] = mean, random.uniform(-0.1, 1.0, (63, 1, 4))
        plans, cost, alive = plans.clip(0.0, 1.0), np.zeros(SAMPLES), np.ones(SAMPLES, bool)
        env.set_worlds(seen)
        for k in range(HORIZON):
            obs, _, ended, _, infos = env.step(top * plans[:, k] ** 2)
            now = np.abs(obs * env.observation_layout.scales)
            bad = ERROR * now[:, OBS.normal_error] + PACE * now[:, OBS.pace_error]
            bad += ACROSS * now[:, OBS.speed.across] + 200.0 * (ended & ~infos["is_success"])
            cost += np.where(alive, bad, 0.0)
            alive &= ~ended
        cost -= cost.min()
        weight = np.exp(-cost / (TEMPERATURE * np.median(cost) + 1e-9))
        mean = np.tensordot(weight / weight.sum(), plans, 1)
    return mean


class Predictive:
    def bind(self, machine, layout):
        scales, top, length = layout.scales, machine.clutch.voltage_max, TASK.path.length
        curves = machine.clutch.breakaway, machine.clutch.dynamic
        lag = 1.0 - np.exp(-0.01 / machine.clutch.time_constant)

        def decide(obs, torques, mean, random):
            env, rest = model(machine, replace(CALM, pace=round(float(obs[OBS.pace]), 6)))
            links = obs[[OBS.cos_a, OBS.sin_a, OBS.cos_b, OBS.sin_b]]
            theta, omega = np.arctan2(links[1::2], links[::2]), obs[[OBS.omega_a, OBS.omega_b]]
            covered = obs[OBS.progress] * length
            seen = rest._replace(
                motion=rest.motion._make([*theta, *omega, *links]),
                torques=rest.torques._make(map(rest.torque._make, torques)),
                command=rest.command._make(obs[[*OBS.volts]]),
                foot=rest.foot._replace(arc_length=covered),
                reached=covered,
            )
            return search(env, seen, mean, random, top)

        def act(observations, memory):
            volts = np.zeros((len(observations), 4), np.float32)
            for k in np.flatnonzero(observations.any(axis=1)):  # whose episodes go on
                obs, plan = observations[k] * scales, memory[k, 9:].reshape(HORIZON, 4)
                torques = memory[k, 1:9].reshape(2, 4)
                if memory[k, 0] % HELD == 0.0:
                    plan[:-1] = plan[1:].copy()
                    plan[:] = decide(obs, torques, plan, np.random.default_rng(int(memory[k, 0])))
                volts[k] = top * plan[0] ** 2
                goal = np.array([[curve.torque(v) for v in volts[k]] for curve in curves])
                torques += lag * (goal - torques)
                memory[k, 0] += 1.0
            return volts

        def start(worlds):
            return np.repeat([[0.0] * 9 + [0.6] * 4 * HORIZON], worlds, axis=0)

        return Policy.from_function(act, layout, start=start)


if __name__ == "__main__":
    print_boards(run_scenario("standard", {"planner": Predictive()}, "medium", episodes=5))
