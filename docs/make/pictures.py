"""Make the pictures of README and the pages.

    python docs/make/pictures.py [NAME …]
    python docs/make/pictures.py error-against-pace.png --results FOLDER

The first makes all by default and needs the extra `render`; the second needs a folder of `pter
benchmark`. A name below `moving` is a film, `policies` a picture of each policy at the end of one
episode, `paper` the paper's figures and claims.
"""

import itertools
import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import boards
import gymnasium
import numpy as np
import tyro
from markup import IMAGES, RECORD, digests
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter1d

import pter_gym
from pter_gym._internal.files import write_bytes_atomic, write_text_atomic
from pter_gym.benchmark import Episodes, evaluate, find_policy, find_worst
from pter_gym.benchmark.boards import in_order
from pter_gym.benchmark.rollout import record_episode
from pter_gym.controllers import CONTROLLERS, TorqueFeedback
from pter_gym.params import Machine
from pter_gym.policies import shipped_policies
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import PACES, SCENARIOS, find_scenario
from pter_gym.tasks.path_following import COLUMN, PathFollowing
from pter_gym.tools.figures import WIDTH, label, png, styled
from pter_gym.tools.pictures.drawing import POLICY_COLOURS
from pter_gym.tools.pictures.plots import label_ends, plain_ticks, titled

FALLING = ("free", "locked", "random")
SIDE_BY_SIDE = ("torque-feedback", "residual")
SIDE_BY_SIDE_DRAWS = {"paths": 0, "standard": 0}
SHOWN, BESIDE = "residual", "single-dof-tuned"
BEST = {"standard": "ppo-standard"}
"""The best ranked policy of a scenario, where it is not the one that is shown elsewhere."""

PACE = "medium"
DRAWS = 64
FILM_SIZE, SIDE_BY_SIDE_SIZE = (600, 540), (720, 537)  # [px]
FILM_SEED = 2**31 + 15  # of no training
EPISODE = {"paths": 5, "hands": 3, "materials": 8, "everything": 15, "tremor": 1}
"""Which draw of a scenario is shown, where it is not the first."""

RATE = 12.5  # frames in a second, in real time
MARKERS = "os^DvPX<>p*dh"

SEEN = set[str]()
"""Names of the policies that the present picture shows."""


def policy_names() -> list[str]:
    """Return the policies of the leaderboards: trained, tuned, the paper's, and the simplest."""
    tuned = [f"{name}-tuned" for name in CONTROLLERS if name not in FALLING]
    return [*sorted(shipped_policies()), *tuned, "impedance", "torque-feedback", *FALLING]


# --- figures ---


@styled
def error_against_pace(results: Path) -> Figure:
    """Return path errors over commanded paces on `standard`, hollow where a policy has no rank."""
    found = boards.boards_of(results, "standard")
    rows = in_order(list(found.values()))
    names = [name for name in policy_names() if name not in FALLING and name in rows]
    SEEN.update(names)
    figure = Figure(figsize=(WIDTH, 4.0))
    axes, ends, colours = figure.add_subplot(), dict[str, tuple[float, float]](), dict[str, str]()
    paces = np.array(list(PACES.values()))
    for place, (name, marker) in enumerate(zip(names, MARKERS, strict=False)):
        standings = [each for each in rows[name] if each]
        # apart, so that intervals do not cover each other
        at = paces * 1.022 ** (place - 0.5 * (len(names) - 1))
        value, low, high = 1000 * np.array([each.error for each in standings]).T
        (line,) = axes.plot(
            at,
            value,
            color=POLICY_COLOURS[name],
            marker=marker,
            linestyle="--" if name in {*CONTROLLERS, *tuned_policies()} else "-",
        )
        title, colour = titled(name, standings), str(line.get_color())
        ends[title], colours[title] = (float(at[-1]), float(value[-1])), colour
        axes.errorbar(
            at, value, (value - low, high - value), fmt="none", ecolor=colour, elinewidth=1.2
        )
        faces = [colour if each.rank else "white" for each in standings]
        axes.scatter(at, value, 40.0, faces, marker=marker, edgecolors=colour, zorder=4)
    axes.set(xscale="log", yscale="log", xlim=(min(paces) / 1.25, max(paces) * 1.25))
    axes.set_xticks(paces, [f"{pace:g}\n{name}" for name, pace in PACES.items()])
    axes.set_xticks([], minor=True)
    plain_ticks(axes, "y")
    label(axes, "commanded pace [m/s]", "path error [mm]")
    label_ends(axes, ends, colours)
    note = f"{found['slow'].title}; bars: 95 % intervals"
    figure.supxlabel(f"{note}; dashed: control laws; hollow: not ranked", fontsize=8.5)
    return figure


@styled
def worst_hand() -> None:
    """Draw what the worst hands do on `standard` across the path, and what two policies do."""
    names = (BESIDE, SHOWN)
    laws = {name: find_policy(name) for name in names}
    figure = Figure(figsize=(WIDTH, 4.2))
    rows = figure.subplots(2, 2, sharex=True, sharey="row")
    usual = [
        record_episode(laws[SHOWN], machine, task, draw).telemetry
        for draw, (machine, task) in enumerate(find_scenario("standard").draws.pairs(16, 0, PACE))
    ]
    for (force, error), name in zip(rows.T, names, strict=True):
        worst = find_worst(laws[name], "standard", PACE)
        for episode in usual:
            force.plot(
                episode[1:, COLUMN.time], episode[1:, COLUMN.force.y], color="0.85", linewidth=0.6
            )
        for each, law in laws.items():
            found = record_episode(law, worst.machine, worst.task, 0).telemetry
            time, distance = found[:, COLUMN.time], 1e3 * np.abs(found[:, COLUMN.normal_error])
            error.plot(
                time, np.maximum(envelope(distance), 0.1), color=POLICY_COLOURS[each], label=each
            )
            if each == name:
                force.plot(time[1:], found[1:, COLUMN.force.y], color=POLICY_COLOURS[each])
        force.set_title(f"worst hand for {name}")
        error.set(yscale="log")
        plain_ticks(error, "y")
        first = name == names[0]
        label(force, "", "force across the path [N]" if first else "")
        label(error, "time [s]", "largest distance in 0.1 s [mm]" if first else "")
    rows[1, 1].legend(loc="upper right")
    SEEN.update(names)
    write_bytes_atomic(IMAGES / "worst-hand.png", png(figure))


def envelope(distance: np.ndarray) -> np.ndarray:
    """Return the largest distance within 0.1 s about each control step: no dips where it is 0."""
    return np.maximum(maximum_filter1d(distance, 1 + 2 * 5), 0.1)


def pter() -> None:
    """Draw the paper's torque feedback two thirds of the way along the path."""
    from PIL import Image

    env = gymnasium.make("pter_gym:PTER/PathFollowing-v0", render_mode="rgb_array")
    world = env.unwrapped
    policy = pter_gym.load_policy(TorqueFeedback(), env)
    observation, info = env.reset(seed=0)
    while info["telemetry"][world.telemetry_layout.index("time")] < 0.65 - 1e-9:
        observation, _, _, _, info = env.step(policy(observation))
    Image.fromarray(env.render()).save(IMAGES / "pter.png")
    env.close()


def force_region() -> None:
    """Draw the forces that the paper's arm can display."""
    from pter_gym.tools.pictures.regions import draw_force_region

    draw_force_region("baseline", IMAGES / "force-region.png")


def paper() -> None:
    """Draw the paper's figures and check its claims, as `pter reproduce` does."""
    from pter_gym._commands.main import main as run

    with TemporaryDirectory() as folder:
        run(["reproduce", "--out", folder])
        for path in (*Path(folder).glob("*.png"), Path(folder) / "claims.json"):
            shutil.copy(path, IMAGES / "paper")


# --- films ---


def frames(
    names: tuple[str, ...],
    scenario: str,
    draw: int,
    size: tuple[int, int] = FILM_SIZE,
    *,
    pace: str = PACE,
    last: bool = False,
) -> list[np.ndarray]:
    """Return the frames of a scenario's draw under some policies side by side, or the last one."""
    from pter_gym.tools.pictures.film import PAUSE, Film

    machine, task = find_scenario(scenario).draws.pairs(DRAWS, FILM_SEED, pace)[draw]
    drawn = what_is_drawn(scenario, machine, task) if len(names) == 1 else ""
    episodes = {f"{name}{drawn}": telemetry(name, scenario, machine, task) for name in names}
    film = Film(machine, task, episodes, RATE, size=size)
    return [
        film.pixels(frame) for frame in range(len(film) + round(PAUSE * RATE))[-1 if last else 0 :]
    ]


def what_is_drawn(scenario: str, machine: Machine, task: PathFollowing) -> str:
    """Return in words what the picture itself does not show of a scenario's draw."""
    hand = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(task.hand).__name__).lower()
    lag = f"clutches of {1000 * machine.clutch.time_constant:.0f} ms"
    told = {"hands": (hand,), "tremor": (hand,), "materials": (lag,), "everything": (hand, lag)}
    return "".join(f", {each}" for each in told.get(scenario, ()))


def telemetry(name: str, scenario: str, machine: Machine, task: PathFollowing) -> np.ndarray:
    """Return the telemetry of the episode that is shown."""
    SEEN.add(name)
    policy = find_policy(name, scenario=scenario)
    return record_episode(policy, machine, task, FILM_SEED).telemetry


def write_webp(pictures: list[np.ndarray], path: Path, quality: int) -> None:
    """Write pictures as a WebP, which moves and repeats if they are several."""
    from pter_gym.tools.pictures.film import encode_webp

    durations = [round(1000 / RATE)] * len(pictures)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, encode_webp(pictures, durations, quality=quality, method=4))


def side_by_side() -> None:
    """Film the paper's law and a trained policy: the law leaves the first of two episodes."""
    films = [
        frames(SIDE_BY_SIDE, scenario, draw, SIDE_BY_SIDE_SIZE)
        for scenario, draw in SIDE_BY_SIDE_DRAWS.items()
    ]
    write_webp([*itertools.chain(*films)], IMAGES / "moving" / "side-by-side.webp", 40)


def alone(scenario: str) -> None:
    """Film an episode of a scenario under one policy."""
    film = frames((BEST.get(scenario, SHOWN),), scenario, EPISODE.get(scenario, 0))
    write_webp(film, IMAGES / "moving" / f"{scenario}.webp", 40)


def worst() -> None:
    """Film the draws of the scenarios that a trained policy follows worst, beside a tuned law."""
    errors: list[tuple[float, str, str, int]] = []
    for scenario, pace in itertools.product(SCENARIOS, PACES):
        pairs = find_scenario(scenario).draws.pairs(DRAWS, FILM_SEED, pace)
        machines, tasks = zip(*pairs, strict=True)
        drawn = Episodes(scenario, machines, tasks, (FILM_SEED,) * DRAWS, ("",) * DRAWS)
        found = evaluate(find_policy(SHOWN, scenario=scenario), drawn)["path_error_m"].tolist()
        errors += [(error, scenario, pace, draw) for draw, error in enumerate(found)]
    films = [
        frames((SHOWN, BESIDE), scenario, draw, SIDE_BY_SIDE_SIZE, pace=pace)
        for _, scenario, pace, draw in sorted(errors)[-3:]
    ]
    write_webp([*itertools.chain(*films)], IMAGES / "moving" / "worst.webp", 40)


def policies() -> None:
    """Draw each policy at the end of the same episode of the paper's setting."""
    for name in policy_names():
        write_webp(
            frames((name,), "standard", 0, last=True), IMAGES / "policies" / f"{name}.webp", 80
        )


PICTURES: dict[str, Callable[[], None]] = {
    "pter.png": pter,
    "force-region.png": force_region,
    "worst-hand.png": worst_hand,
    "paper": paper,
    "moving/side-by-side.webp": side_by_side,
    **{f"moving/{name}.webp": partial(alone, name) for name in SCENARIOS},
    "moving/worst.webp": worst,
    "policies": policies,
}


def main(names: tyro.conf.Positional[tuple[str, ...]] = (), results: Path | None = None) -> None:
    """Make pictures, all by default but that of the results, which needs their folder."""
    drawn = dict(PICTURES)
    if results is not None:
        path = IMAGES / "error-against-pace.png"
        drawn[path.name] = lambda: write_bytes_atomic(path, png(error_against_pace(results)))
    for name in names or drawn:
        SEEN.clear()
        drawn[name]()
        record = json.loads(RECORD.read_text("utf-8")) | {name: digests(" ".join(SEEN))}
        record = {each: shown for each, shown in sorted(record.items()) if shown}
        write_text_atomic(RECORD, json.dumps(record, indent=2) + "\n")
        print(f"wrote {IMAGES / name}")


if __name__ == "__main__":
    tyro.cli(main)
