"""What is added to a record is seen, kept and cleared as its record says, wherever it stands there.

Each test runs another process, in which a module of the package has further lines.
"""

import os
import subprocess
import sys

CHANGED = """
import sys
from importlib.machinery import PathFinder, SourceFileLoader

CHANGES = {changes!r}

class Changed(SourceFileLoader):
    def get_code(self, name):
        text = self.get_data(self.path).decode()
        for line, more in CHANGES[name].items():
            assert text.count(line) == 1, line
            text = text.replace(line, line + more)
        return self.source_to_code(text.encode(), self.path)

class Finder:
    def find_spec(name, path, target=None):
        if name in CHANGES:
            spec = PathFinder.find_spec(name, path)
            spec.loader = Changed(name, spec.origin)
            return spec

sys.meta_path.insert(0, Finder)
"""


def run(changes: dict[str, dict[str, str]], test: str) -> None:
    """Run a test where lines of modules are followed by others."""
    code = CHANGED.format(changes={f"pter_gym.{name}": x for name, x in changes.items()}) + test
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


OBSERVED = """
import numpy as np
from pter_gym._engine.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensing

for sensors, count in (("encoders", 1), ("torque", 2), ("force", 3)):
    for sensing in (Sensing(), Sensing(velocity_noise=1e-12)):
        batch = Batch(BASELINE, PathFollowing(sensing=sensing), 1, sensors=sensors)
        batch.reset([0])
        obs, row, *_ = batch.step_alone(np.full(4, 3.0))
        seen = dict(zip(batch.layout.names, batch.layout.scales * obs))
        added = [seen.get(f"of_{kind}") for kind in ("encoders", "torque", "force")]
        np.testing.assert_allclose(added[:count], [7.0, 8.0, 9.0][:count])
        assert added[count:] == [None] * (3 - count)
        np.testing.assert_allclose(seen["volts_4"], 3.0)
        if count > 1:
            torque = [seen[f"torque_{k}"] for k in (1, 2, 3, 4)]
            np.testing.assert_allclose(torque, row[[*COLUMN.torque]], rtol=1e-5)
        assert len(obs) == len(batch.layout)
"""


def test_an_entry_is_observed_with_the_sensors_that_it_needs_and_moves_no_other() -> None:
    entry = '\n    of_{}: Annotated[float, Entry("1", "a number", 10.0)]'
    lines = {
        "encoders": '    volts: Annotated[PerClutch, Entry("V", "last voltage", largest_voltage)]',
        "torque": '[PerClutch, Entry("N·m", "generated torque", TORQUE_SCALE)]',
        "force": '    force: Annotated[PathVector, Entry("N", "the hand\'s force", FORCE_SCALE)]',
    }
    changes = {line: entry.format(sensors) for sensors, line in lines.items()}
    values = "\n        of_encoders=7.0,\n        of_torque=8.0,\n        of_force=9.0,"
    changes["        pace_error=at.speed.along / pace - 1.0,"] = values
    run({"tasks.path_following._observation": changes}, OBSERVED)


REMEMBERED = """
import numpy as np
from pter_gym._engine.batch import Batch
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing, Sensing

for sensing in (Sensing(), Sensing(velocity_noise=0.1, delay=1)):
    batch = Batch(BASELINE, PathFollowing(sensing=sensing), 2)
    obs = [batch.reset([0, 1])[0].copy()]
    obs += [batch.step(np.full((2, 4), 3.0)).obs.copy() for _ in range(5)]
    at = [batch.layout.index(name) for name in ("omega_a", "turned")]
    omega, turned = np.moveaxis(np.array(obs)[..., at] * batch.layout.scales[at], -1, 0)
    assert (omega[-1] != 0.0).all()
    np.testing.assert_allclose(turned, np.cumsum(omega, axis=0), rtol=1e-5)
"""


def test_an_entry_with_state_sees_what_the_others_show_once_a_step() -> None:
    """A sum of a velocity, as CONTRIBUTING says: of noisy and late readings where sensors are."""
    entry = '    volts: Annotated[PerClutch, Entry("V", "last voltage", largest_voltage)]'
    loop = '    Each passes here once a control step, and once at a reset.\n    """\n'
    summed = "    for i in range(first, last):\n        "
    summed += "w[ROW.sum_omega, i] = w[ROW.seen.turned, i] = turned(load(w, ROW.seen, i), "
    function = "\n\ndef turned(seen, last):\n    return last + seen.omega_a\n"
    observation = {
        entry: '\n    turned: Annotated[float, Entry("rad/s", "sum of a velocity")]',
        "        pace_error=at.speed.along / pace - 1.0,": "\n        turned=0.0,",
        "force=measured.force,  # pyright: ignore[reportCallIssue]\n    )\n": function,
    }
    changes = {
        "_engine.world": {'over the commanded pace")\n    ]': "\n    sum_omega: float"},
        "_engine.sensors": {
            loop: summed + "w[ROW.sum_omega, i])\n",
            "from pter_gym.tasks.path_following._specification import MAX_DELAY\n": (
                "from pter_gym.tasks.path_following._observation import turned\n"
            ),
        },
        "tasks.path_following._observation": observation,
    }
    run(changes, REMEMBERED)


CLEARED = """
from pter_gym._engine.batch import Batch
from pter_gym._engine.world import ROW
from pter_gym.params import BASELINE
from pter_gym.tasks.path_following import PathFollowing, Sensing

for sensing in (Sensing(), Sensing(velocity_noise=0.1)):
    batch = Batch(BASELINE, PathFollowing(sensing=sensing), 2)
    batch.reset([0, 1])
    state = batch.get_state()
    rows = [ROW.first_kept, ROW.last_kept, ROW.address]
    rows += [ROW.first_extra, ROW.last_extra] if sensing != Sensing() else []
    state["worlds"][:, rows] = 1.0
    batch.set_state(state)
    batch.reset([0, None])
    after = batch.get_state()["worlds"][0, rows, :2].tolist()
    assert after == [[0.0] * 2, [0.0] * 2, [1.0] * 2, [0.0] * 2, [0.0] * 2][: len(rows)]
    batch.step([[0.0] * 4] * 2)
    assert (batch.get_state()["worlds"][0, rows, :2] == after).all()
"""


def test_a_row_is_cleared_by_a_reset_if_its_record_is() -> None:
    changes = {
        'unless a reset sets it."""\n': "\n    first_kept: float",
        'over the commanded pace")\n    ]': "\n    last_kept: float",
        'number of contexts that it draws from")]': "\n    address: float",
        'in others it is zero and is not stored."""\n': "\n    first_extra: float",
        '    heat: Annotated[PerClutch, Entry("J", "heat")]': "\n    last_extra: float",
    }
    run({"_engine.world": changes}, CLEARED)
