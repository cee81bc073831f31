"""``pter hil``: a controller on its own hardware drives the simulated arm."""

from itertools import zip_longest
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from pter_gym._commands.arguments import AnyPace, look_at, options
from pter_gym._commands.terminal import conclude, say
from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import check_target
from pter_gym.errors import ParameterError
from pter_gym.scenarios import SCENARIOS

BANDS = ("corridor", "wall")
"""Scenarios with a free band around their paths, which C does not know."""

if TYPE_CHECKING:
    from pter_gym.tools.hil.session import Array, Partner

    PathScenario = str
else:
    PathScenario = Literal[tuple(name for name in SCENARIOS if name not in BANDS)]
    """Name of a scenario that exported C can act in."""

FAST_DEADLINE, MAX_DEADLINE = 0.1, 10.0
"""Seconds to wait for an answer where real time does not limit them, and at most."""

MAX_EPISODES = 64
"""The benchmark scores as many together: sums have the same bits."""


def hil(
    policy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME")] = "",
    partner: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="PORT|COMMAND")] = "",
    scenario: PathScenario = "standard",
    pace: AnyPace = "medium",
    episodes: int = 1,
    rate: float = 100.0,
    real_time: bool = False,
    deadline: float | None = None,
    baud: int = 115200,
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None,
) -> None:
    """Let a program on its own hardware drive the simulated arm over a serial line.

    The arm sends what its sensors read and waits for voltages; docs/commands/hil.md has the
    protocol, and examples/serial_loop.c is an example. Scores are compared with those of the policy
    in Python on the same test episodes. For Linux and macOS.

    Example: pter hil residual ./loop --episodes 10

    Args:
        policy: Policy that the program runs, as for `pter benchmark --policies`.
        partner: Serial port, or a command whose standard input and output become the line.
        scenario: Scenario of the episodes.
        pace: Commanded pace: slow, medium, brisk, or a speed in m/s.
        episodes: Test episodes to run, starting with the first, at most 64.
        rate: Control steps per simulated second, from 10 to 1000.
        real_time: Run in real time instead of as fast as answers arrive.
        deadline: Seconds to wait for an answer before the last voltages are kept; by default a
            control period in real time, else 0.1.
        baud: Baud rate of the port.
        csv: File for the telemetry; see docs/watching.md. Its folder must exist.
    """
    look_at(policies=[policy], paces=[pace])
    if not partner:
        raise ParameterError(
            f"partner must be a serial port or a command, as in `pter hil {policy} ./loop`"
        )
    from dataclasses import replace

    from pter_gym.benchmark import find_policy
    from pter_gym.benchmark.episodes import find_episodes
    from pter_gym.benchmark.results import check_csv
    from pter_gym.benchmark.rollout import bind_to
    from pter_gym.scenarios import find_scenario
    from pter_gym.tools.hil.line import SerialLine
    from pter_gym.tools.hil.session import Partner

    if not 10.0 <= rate <= 1000.0:
        raise ParameterError(f"rate must be from 10 to 1000, got {rate!r}")
    deadline = (1.0 / rate if real_time else FAST_DEADLINE) if deadline is None else deadline
    if not 0.0 < deadline <= MAX_DEADLINE:
        raise ParameterError(f"deadline must be within (0, {MAX_DEADLINE:g}] s, got {deadline!r}")
    if whole_number("episodes", episodes) > MAX_EPISODES:
        raise ParameterError(f"episodes must be from 1 to {MAX_EPISODES}, got {episodes}")
    if csv:
        check_target("csv", csv)
        check_csv(csv)
    definition = find_scenario(scenario)
    controller = find_policy(policy, definition.whose_gains)
    episode_set = find_episodes(definition, pace).first(episodes)
    paced = tuple(replace(task, control_period=1.0 / rate) for task in episode_set.tasks)
    driven = replace(episode_set, tasks=paced, time_limits=())
    bind_to(controller, driven)  # raises where it cannot act at this rate
    other = Partner(SerialLine(partner, baud), deadline, real_time=real_time)
    records: list[list[Array]] = [[] for _ in paced]
    try:
        for record, machine, task, seed in zip(
            records, episode_set.machines, paced, episode_set.seeds, strict=True
        ):
            other.drive(machine, task, seed, record)
    finally:
        other.line.close()
        report(records, driven, controller, csv)
        say(timing(other))
        same = options(scenario=scenario, pace=pace)
        conclude([], f"pter benchmark --policies {quote(policy)}{same}")


def report(records: "list[list[Array]]", episodes: Any, controller: Any, csv: Path | None) -> None:
    """Print the scores of the episodes that have begun, beside those in Python; write a table."""
    import numpy as np

    from pter_gym.benchmark.results import write_trajectories
    from pter_gym.benchmark.rollout import evaluate
    from pter_gym.benchmark.scores import score_episodes

    begun = [record for record in records if len(record) > 1]
    if not begun:
        return
    first = episodes.first(len(begun))
    telemetry = np.array([*zip_longest(*begun, fillvalue=np.full_like(begun[0][0], np.nan))])
    own = score_episodes(telemetry, first.tasks, first.machines[0])
    python = evaluate(controller, first, 1)
    same = np.all([own[name] == python[name] for name in own], axis=0)
    for k in range(len(begun)):
        ours, theirs = (1e3 * each["path_error_m"][k] for each in (own, python))
        say(
            f"episode {k + 1}: path error {ours:.4f} mm, {theirs:.4f} mm in Python, "
            f"{'all scores have the same bits' if same[k] else 'scores differ'}; "
            f"{'arrived' if own['completed'][k] else 'ended'} after {own['duration_s'][k]:.2f} s"
        )
    if csv:
        write_trajectories({f"episode {k}": np.array(rows) for k, rows in enumerate(begun, 1)}, csv)
        say(f"wrote {csv}")


def timing(other: "Partner") -> str:
    """Return how fast the partner was, in words."""
    import numpy as np

    if not other.latencies:
        return f"no answer in time, {other.line.broken} frames broken"
    median, most = 1e3 * np.percentile(other.latencies, [50, 99])
    return (
        f"latency {median:.2f} ms at the median, {most:.2f} ms at 99 %; {other.missed} of "
        f"{other.missed + len(other.latencies)} deadlines missed, {other.line.broken} frames broken"
    )
