"""Model-predictive control by sampling: `pter watch examples/predictive.py:Predictive`.

Corrects the best law by plans with the nominal machine and the mean push on the paper's path."""

from dataclasses import replace
from functools import cache

import numpy as np

from pter_gym import PathFollowing
from pter_gym.benchmark import find_policy, print_boards, run_scenario
from pter_gym.controllers import Policy, bind
from pter_gym.envs import PathFollowingVectorEnv
from pter_gym.tasks.path_following import OBS

HELD, HORIZON = 3, 10  # control steps for which a correction is held; corrections planned, 0.3 s
TASK = PathFollowing()
CALM = replace(TASK, hand=replace(TASK.hand, amplitudes=(0.0,) * 5))
PARTS = 1, 9, 9 + 4 * HORIZON  # of what a world remembers: step, torques, plan, and the law's
SAMPLES, ROUNDS, SPREAD, TEMPERATURE = 64, 2, 0.1, 0.01
COSTS, CHANGE = (250.0, 1.0, 5.0), 20.0  # of error [m], pace, speed across [m/s]; of corrections


@cache
def model(machine, task):
    """Return worlds to try plans in, and their states at the start of the path."""
    volts = {"action_unit": "volt", "frame_skip": 1, "telemetry": False}
    env = PathFollowingVectorEnv(SAMPLES, machine=machine, task=task, **volts)
    env.reset(seed=[0] * SAMPLES)
    return env, env.get_worlds()


def corrected(law, obs, memory, correction):
    """Return the law's voltages, corrected in square roots of shares of the largest voltage."""
    top = law.machine.clutch.voltage_max
    shares = np.sqrt(law.act(obs, memory) / top) + correction
    return (top * shares.clip(0.0, 1.0) ** 2).astype(np.float32)


def search(env, law, seen, obs, memory, plan, random):
    """Improve a plan, (HORIZON, 4), from the worlds' state and what the law sees and remembers."""
    for _ in range(ROUNDS):
        shift = random.standard_normal((SAMPLES, 1, 4)) * (random.random((SAMPLES, 1, 4)) < 0.6)
        plans = plan + SPREAD * (shift + 0.5 * random.standard_normal((SAMPLES, HORIZON, 4)))
        plans[0], plans[1] = plan, 0.0
        cost, alive = CHANGE * (plans**2).sum(axis=(1, 2)), np.ones(SAMPLES, bool)
        env.set_worlds(seen)
        now, remembered = np.repeat([obs], SAMPLES, 0), np.repeat([memory], SAMPLES, 0)
        for k in range(HELD * HORIZON):
            now, _, ended, _, infos = env.step(corrected(law, now, remembered, plans[:, k // HELD]))
            off = np.abs(now * env.observation_layout.scales)
            bad = off[:, [OBS.normal_error, OBS.pace_error, OBS.speed.across]] @ COSTS
            bad += 200.0 * (ended & ~infos["is_success"])
            cost, alive = cost + alive * bad, alive & ~ended
        weight = np.exp((cost.min() - cost) / (TEMPERATURE * np.median(cost - cost.min()) + 1e-9))
        plan = np.tensordot(weight / weight.sum(), plans, 1)
    return plan


class Predictive:
    def bind(self, machine, layout):
        law = bind(find_policy("single-dof-tuned"), machine, layout)
        curves = machine.clutch.breakaway, machine.clutch.dynamic
        lag = 1.0 - np.exp(-0.01 / machine.clutch.time_constant)

        def improved(plan, obs, torques, own, step):
            now = obs * layout.scales
            env, rest = model(machine, replace(CALM, pace=round(float(now[OBS.pace]), 6)))
            links = now[[OBS.cos_a, OBS.sin_a, OBS.cos_b, OBS.sin_b]]
            theta, omega = np.arctan2(links[1::2], links[::2]), now[[OBS.omega_a, OBS.omega_b]]
            covered = float(now[OBS.progress]) * TASK.path.length
            seen = rest._replace(
                motion=rest.motion._make([*theta, *omega, *links]),
                torques=rest.torques._make(map(rest.torque._make, torques)),
                command=rest.command._make(now[[*OBS.volts]]),
                foot=rest.foot._replace(arc_length=covered),
                reached=covered,
            )
            return search(env, law, seen, obs, own, plan, np.random.default_rng(int(step[0])))

        def act(observations, memory):
            volts = np.zeros((len(observations), 4), np.float32)
            for k in np.flatnonzero(observations.any(axis=1)):  # whose episodes go on
                obs, (step, torques, plan, own) = observations[k], np.split(memory[k], PARTS)
                plan, torques = plan.reshape(HORIZON, 4), torques.reshape(2, 4)  # views
                if step % HELD == 0.0:
                    plan[:] = improved(np.vstack([plan[1:], plan[-1:]]), obs, torques, own, step)
                volts[k] = corrected(law, obs[None], own[None], plan[:1])[0]
                goal = np.array([[curve.torque(v) for v in volts[k]] for curve in curves])
                step[:], torques[:] = step + 1.0, torques + lag * (goal - torques)
            return volts

        def start(worlds):
            return np.hstack([np.zeros((worlds, PARTS[-1])), law.start(worlds)])

        return Policy.from_function(act, layout, start=start)


if __name__ == "__main__":
    print_boards(run_scenario("standard", {"planner": Predictive()}, "medium", episodes=5))
