"""Write the tables of docs/classical-control.md.

    python docs/make/classical_pages.py RESULTS

RESULTS is a folder of `pter benchmark --scenario standard` and `--scenario everything` at all paces. All else is
simulated here, on training draws, with the gains that the package ships; it takes two to three minutes of one core.
`docs/make/images.py` draws the pictures of that page.
"""

import itertools
import time
from pathlib import Path

import numpy as np
import tyro
from pages import BELOW, LEFT_OUT, ROOT, board_table, joined, read_boards, signed, table, write_block
from studies.bounds import DRAWS, SEARCH_DRAWS, SEED, Actuators, Outcome, adapted, try_out
from studies.clutch_use import clutch_use

from pter_gym.benchmark.measures import column
from pter_gym.benchmark.simulation import simulate, time_limit
from pter_gym.benchmark.standard import TIME_CONSTANTS
from pter_gym.benchmark.tuned import TUNED, find_tuned
from pter_gym.engine.batch import Batch
from pter_gym.hands import HumanArm
from pter_gym.params import TIME_CONSTANT
from pter_gym.paths import Arc, Circle
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import PACES, find_scenario

PAGE = ROOT / "docs" / "classical-control.md"
CLASSICAL = ["impedance", "torque-feedback", *TUNED]
BOUNDED = ("impedance-tuned", "single-dof-tuned")
LOST_DRAWS = 256
TORQUES = (0.5, 0.75, 1.0, 1.5, 2.0)
DRAWS_NOTE = f"{DRAWS} training draws of `standard`, seeds {SEED} to {SEED + DRAWS - 1}."


def by_tuning(boards: list[dict]) -> str:
    """By how much tuning changes the path error on `standard`, and by how much another law does."""
    found = {board["pace"]: board["policies"] for board in boards if board["scenario"] == "standard"}
    pairs = [("impedance-tuned", "impedance"), ("torque-feedback-tuned", "torque-feedback")]
    pairs += [(name, "impedance-tuned") for name in ("velocity-ratio-tuned", "single-dof-tuned")]
    lines = []
    for name, other in pairs:
        errors = [[found[pace][each]["path_error_m"]["value"] for each in (name, other)] for pace in PACES]
        changes = signed(", ".join(f"{100 * (mine / its - 1):+z.0f} %" for mine, its in errors))
        lines.append(f"- `{name}` against `{other}`: {changes}.\n")
    return "\nPath error at the three paces:\n\n" + "".join(lines)


def separation() -> str:
    """What the laws do with the clutches."""
    header = ["Law", "path error [mm]", "signed error [mm]", "volts, clutches 1 to 4", "saturated [%]"]
    header += ["one stuck [%]", "at rest [%]", "stuck, clutches 1 to 4 [%]"]
    parts = [f"{DRAWS_NOTE} Path error: interquartile mean; the others are means over time.\n"]
    for pace, speed in PACES.items():
        rows = []
        for name in CLASSICAL:
            use = clutch_use(name, pace)
            row = [
                f"`{name}`",
                f"{1000 * use.path_error.value:.1f}",
                signed(f"{1000 * use.signed_error:+z.1f}"),
            ]
            row += [joined(", ".join(f"{x:.1f}" for x in use.volts))]
            row += [f"{100 * x:.0f}" for x in (use.any_saturated, use.one_stuck, use.at_rest)]
            rows.append([*row, joined(", ".join(f"{100 * x:.0f}" for x in use.stuck))])
        parts.append(f"{pace.capitalize()} pace, {speed:g} m/s:\n\n{table(header, rows)}")
    return "\n".join(parts)


def error(outcome: Outcome) -> str:
    """Path error in mm, marked where arrivals or pace miss the leaderboard's limits."""
    return f"{1000 * outcome.path_error.value:.1f}" + (f" {BELOW}" if outcome.shortfall > 0.0 else "")


def kinds(law: str) -> dict[str, Actuators]:
    """The actuators on which a law is tried, by name."""
    found = {}
    for pushes, lag, torque in itertools.product((False, True), (TIME_CONSTANT, 0.0), (1.0, 2.0)):
        if pushes and not law.startswith("impedance"):
            continue
        name = "motors" if pushes else "clutches"
        name += "" if lag else ", no lag"
        name += "" if torque == 1.0 else ", twice the torque"
        found[name] = Actuators(pushes=pushes, time_constant=lag, torque=torque)
    return found


def gains(law: str, pace: str):
    """The law's tuned gains at a pace."""
    return find_tuned(law, "standard").at(PACES[pace])


def bounds() -> str:
    """Torque, lag and passivity, each alone and together."""
    note = (
        f"{DRAWS_NOTE} Path error in mm: own gains → gains adapted to the actuators on\n{SEARCH_DRAWS} other draws, "
        f"seeds {SEED - SEARCH_DRAWS} to {SEED - 1}. {BELOW}: arrivals or pace miss the leaderboard's limits.\n"
    )
    parts = [note]
    for law in BOUNDED:
        own = {(kind, pace): try_out(gains(law, pace), a, pace) for kind, a in kinds(law).items() for pace in PACES}
        new = {
            (kind, pace): try_out(adapted(gains(law, pace), a, pace), a, pace)
            for kind, a in kinds(law).items()
            for pace in PACES
        }
        rows = [[kind, *(f"{error(own[kind, p])} → {error(new[kind, p])}" for p in PACES)] for kind in kinds(law)]
        parts.append(table([f"`{law}` on", *PACES], rows))
        parts.append("".join(verdict(law, pace, new) for pace in PACES))
        if any(a.pushes for a in kinds(law).values()):
            parts.append(pace_of_motors(law, own, new))
    return "\n".join(parts)


def verdict(law: str, pace: str, found: dict[tuple[str, str], Outcome]) -> str:
    """Which change alone helps most, with adapted gains."""
    alone = [
        kind for kind, a in kinds(law).items() if (a.pushes, a.time_constant == 0.0, a.torque != 1.0).count(True) == 1
    ]
    best = min(alone, key=lambda kind: (found[kind, pace].shortfall > 0.0, found[kind, pace].path_error.value))
    lost = {kind: f"{error(found[kind, pace])} mm" for kind in kinds(law)}
    return f"- {pace}: {lost['clutches']} on clutches; of one change alone, *{best}* helps most: {lost[best]}.\n"


def pace_of_motors(law: str, own: dict[tuple[str, str], Outcome], new: dict[tuple[str, str], Outcome]) -> str:
    """How the pace comes out, and how often a motor drives the arm."""
    rows = [
        [
            kind,
            *(
                joined(
                    f"{own[kind, p].mean_pace:.3f} → {new[kind, p].mean_pace:.3f}; {100 * new[kind, p].pushing:.0f} %"
                )
                for p in PACES
            ),
        ]
        for kind in kinds(law)
    ]
    note = (
        "The same: mean pace in m/s with own → adapted gains, and with these the share of the control instants at\n"
        "which an actuator drives the arm."
    )
    return f"{note}\n\n{table([f'`{law}` on', *(f'{pace}, {v:g} m/s' for pace, v in PACES.items())], rows)}"


def sweep(actuators: dict[str, Actuators], title: str) -> str:
    """Own gains on a row of actuators."""
    rows = [
        [f"`{law}`, {pace}", *(error(try_out(gains(law, pace), each, pace)) for each in actuators.values())]
        for law in BOUNDED
        for pace in PACES
    ]
    return f"{DRAWS_NOTE}\n\n{table([title, *actuators], rows)}"


def lost() -> str:
    """Which training draws of `everything` do not end at the end of the path."""
    rows = []
    for pace in PACES:
        pairs = find_scenario("everything").randomisation(pace, contexts=LOST_DRAWS, seed=SEED).pairs()
        kinds_of = [(m.clutch.time_constant, t.sensing.delay, type(t.path), type(t.hand)) for m, t in pairs]
        tau, delay, path, hand = (np.array(column) for column in zip(*kinds_of, strict=True))
        bends = (path == Arc) | (path == Circle)
        groups = [tau > 0.0, tau < 0.12, tau >= 0.12, delay == 0, delay == 2, bends, ~bends]
        groups += [hand == HumanArm, hand != HumanArm]
        for name in TUNED:
            arrived = np.concatenate([arrivals(name, pairs[k : k + 64], SEED + k) for k in range(0, LOST_DRAWS, 64)])
            rows.append([f"`{name}`, {pace}", *(f"{100 * (1 - arrived[group].mean()):.0f}" for group in groups)])
    header = ["Lost [%]", "all", "τ < 0.12 s", "τ ≥ 0.12 s", "no delay", "20 ms", "arcs, circles", "other paths"]
    note = f"{LOST_DRAWS} training draws of `everything`, seed {SEED}: share that does not end at the end of the path."
    return f"{note}\n\n{table([*header, 'human arms', 'forces'], rows)}"


def arrivals(name: str, pairs: list, seed: int) -> np.ndarray:
    """Whether a policy arrives, for each pair of machine and task."""
    machines, tasks = (list(each) for each in zip(*pairs, strict=True))
    batch = Batch(machines, tasks)
    telemetry = simulate(
        batch, find_tuned(name, "everything"), range(seed, seed + len(pairs)), max(map(time_limit, tasks))
    )
    return (column(telemetry[1:], "is_success") == 1.0).any(axis=0)


def main(results: tyro.conf.Positional[Path]) -> None:
    """Write the tables of docs/classical-control.md."""
    begin = time.perf_counter()
    boards = read_boards(results)
    known = {name: None for board in boards for name in board["policies"] if name not in LEFT_OUT}
    classical = [name for name in known if name not in shipped_policies()]
    for scenario in ("standard", "everything"):
        details = scenario == "everything"
        content = board_table(boards, scenario, classical, details=details)
        write_block(PAGE, f"board: {scenario}", content if details else content + by_tuning(boards))
    write_block(PAGE, "lost", lost())
    write_block(PAGE, "separation", separation())
    lags = {f"{tau:g} s": Actuators(time_constant=tau) for tau in TIME_CONSTANTS}
    write_block(PAGE, "lag", sweep(lags, "Clutch time constant"))
    write_block(PAGE, "torque", sweep({f"{x:g}": Actuators(torque=x) for x in TORQUES}, "Clutch torques, relative"))
    write_block(PAGE, "bounds", bounds())
    print(PAGE, f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    tyro.cli(main)
