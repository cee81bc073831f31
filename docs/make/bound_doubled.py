"""Other rollouts to begin `docs/make/bound.py` of commit c4ffb27 with: `bound_doubled.py OUT 3 6 0:standard:slow …`.

Those of rank 3 to 5 among all laws and policies; a run is a block of episodes, a scenario and a pace. The best of a
run's result and of that in bound.jsonl has twice the effort. From rank 6 on, which nothing has, starts are new rollouts
of those of rank 0 to 2, with voltages that are disturbed by up to 1 V, drawn anew every 0.1 to 1 s, in the loop:
open-loop voltages with as little as 0.03 V of noise leave the path.
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import bound
import numpy as np

POLICIES, NOISE, VOLTS = 6, 1.0, 24.0


class Disturbed:
    """A bound policy whose voltages get noise that is held for a while."""

    def __init__(self, policy, rng):
        self._policy, self._rng, self._left = policy, rng, 0

    def reset(self):
        self._policy.reset()

    def __call__(self, obs):
        if self._left == 0:
            self._left = int(self._rng.integers(10, 101))
            self._noise = self._rng.uniform(-NOISE, NOISE, (len(obs), 4))
        self._left -= 1
        return (self._policy(obs) + self._noise).clip(0.0, VOLTS).astype(np.float32)


out, first, last, *runs = sys.argv[1:]
source = Path(bound.__file__).read_text("utf-8")
code = source[source.index("def one(") : source.index("def known(")]
code = code.replace("reshape(STARTS", f"reshape({last} - {first}").replace("rng([FRESH,", f"rng([FRESH, {first},")
if int(first) < POLICIES:
    code = code.replace("[:STARTS]", f"[{first}:{last}]")
else:
    assert int(last) - int(first) == bound.STARTS
    code = code.replace("simulate(batches.batch(0, acting.sensors), acting.policy,",
                        "simulate(batches.batch(0, acting.sensors), disturbed(acting.policy),")
    noise = np.random.default_rng(int(first))
    bound.disturbed = lambda policy: Disturbed(policy, noise)
exec(code, vars(bound))
if __name__ == "__main__":
    for each in runs:
        block, scenario, pace = each.split(":")
        found = bound.one(bound.Run(int(block), scenario, pace))
        line = json.dumps([[int(block), scenario, pace], int(first), int(last), found["bound"], found["seconds"]])
        with Path(out).open("a") as file:
            print(line, file=file)
