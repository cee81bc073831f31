"""A PID law as a template: `pter watch examples/pid.py:Pid`, `pter tune examples/pid.py:Pid`."""

from dataclasses import astuple, dataclass

from pter_gym.benchmark import print_boards, run_scenario
from pter_gym.controllers import PerClutch, Policy, compiled
from pter_gym.tasks.path_following import OBS


@compiled
def brake(torque, slip):  # V: a clutch only opposes its slip
    return min(0.5 * abs(torque), 24.0) if torque * slip < 0.0 else 0.0


@compiled
def pid(obs, scales, gains, memory):
    kp, ki, kd, damping, length_a, length_b = gains
    error = obs[OBS.normal_error] * scales[OBS.normal_error]
    speed = obs[OBS.speed.across] * scales[OBS.speed.across]
    memory[0] += 0.01 * error  # the integral, 0 when an episode begins
    across = -kp * error - ki * memory[0] - kd * speed  # N
    along = -damping * max(obs[OBS.pace_error], 0.0)
    force = complex(along, across) * complex(obs[OBS.heading.cos], obs[OBS.heading.sin])
    a = length_a * (force.imag * obs[OBS.cos_a] - force.real * obs[OBS.sin_a])  # N·m: Jᵀ·force
    b = length_b * (force.imag * obs[OBS.cos_b] - force.real * obs[OBS.sin_b])
    w_a, w_b = obs[OBS.omega_a], obs[OBS.omega_b]
    return PerClutch(brake(a, w_a), brake(b, w_b), brake(a - b, w_a - w_b), brake(a + b, w_a + w_b))


@dataclass(frozen=True)
class Pid:
    kp: float = 2800.0  # N/m
    ki: float = 500.0  # N/(m·s)
    kd: float = 500.0  # N·s/m
    damping: float = 90.0  # N at twice the pace
    search = {"kp": (100.0, 2e4), "ki": (1.0, 1e4), "kd": (1.0, 2e3), "damping": (10.0, 1e3)}

    def bind(self, machine, layout):
        gains = [*astuple(self), machine.arm.length_a, machine.arm.length_b]
        return Policy.from_law(pid, gains, machine, layout)


if __name__ == "__main__":
    policies = {"pid": Pid(), "paper": "torque-feedback"}
    print_boards(run_scenario("standard", policies, "medium", episodes=20))
