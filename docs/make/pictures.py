"""Make the pictures of README and the pages: `python docs/make/pictures.py [NAME …]`, all by default.

    python docs/make/pictures.py error-against-pace.png --results FOLDER

needs the folder of `fill.py --results`; all others need the extra `render`. A name below `moving` is a film, `policies`
a still picture of each policy at the end of one episode, `paper` the paper's figures and claims.
"""

import io
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import gymnasium
import numpy as np
import tyro
from pages import IMAGES

from pter_gym._internal.files import write_bytes_atomic, write_files_atomic
from pter_gym._physics.friction import ClutchMode
from pter_gym.benchmark import find_policy
from pter_gym.benchmark._measures import column, four
from pter_gym.benchmark.simulation import record_episode, simulate, time_limit
from pter_gym.controllers import CONTROLLERS, TorqueFeedback
from pter_gym.params import BASELINE, Machine
from pter_gym.policies import shipped_policies
from pter_gym.scenarios import SCENARIOS, find_scenario
from pter_gym.tasks.path_following import PathFollowing

FALLING = ("free", "locked", "random")
COMPARED = ("torque-feedback", "ppo-standard")
CLASSICAL = ("impedance", "impedance-tuned", "velocity-ratio-tuned", "single-dof-tuned")
SIDE_BY_SIDE = ("single-dof-tuned", "residual")
SIDE_BY_SIDE_SCENARIOS = ("paths", "hands", "tremor")
SHOWN = "residual"
PACE = "medium"
DRAWS = 16
SEED, FILM_SEED = 2**31 + 3, 2**31 + 15  # of no training
SETTLED = 0.5  # s: the start is over
EPISODE = {"standard": 0, "paths": 5, "hands": 3, "materials": 8, "everything": 15, "tremor": 1}
"""The draw of each scenario that is shown: those of paths and everything have different paths."""

RATE = 12.5  # frames in a second, in real time


def policy_names() -> list[str]:
    """Return the policies of the leaderboards: trained ones, tuned laws, those of the paper, ends of the scale."""
    tuned = [f"{name}-tuned" for name in CONTROLLERS if name not in FALLING]
    return [*sorted(shipped_policies()), *tuned, "impedance", "torque-feedback", *FALLING]


# --- figures ---


def error_against_pace(results: Path) -> None:
    """Draw path error against commanded pace on `standard`."""
    import boards
    import figures

    from pter_gym.tools.pictures.plots import save

    found = boards.boards(results, "standard")
    names = [name for name in policy_names() if name not in FALLING and name in found["slow"]["policies"]]
    scores = {name: [board["policies"][name] for board in found.values()] for name in names}
    note = f"standard, {boards.episodes_text(found['slow']).partition(',')[0]}; bars: 95 % intervals"
    save(figures.error_against_pace(scores, note), IMAGES / "error-against-pace.png")


def pter() -> None:
    """Draw the paper's torque feedback two thirds of the way along the path."""
    from PIL import Image

    env = gymnasium.make("pter_gym:PTER/PathFollowing-v0", render_mode="rgb_array")
    world = env.unwrapped
    policy = TorqueFeedback().bind(world.machine, world.observation_layout)
    observation, info = env.reset(seed=0)
    while info["telemetry"][world.telemetry_layout.index("time")] < 0.65 - 1e-9:
        observation, _, _, _, info = env.step(policy(observation))
    Image.fromarray(env.render()).save(IMAGES / "pter.png")
    env.close()


def clutches() -> None:
    """Draw the first of some episodes under the paper's torque feedback and under a trained policy."""
    import figures

    from pter_gym._engine.batch import Batch
    from pter_gym.tools.pictures.plots import save

    machines, tasks = zip(
        *find_scenario("standard").randomisation(PACE, contexts=DRAWS, seed=SEED).pairs(), strict=True
    )
    batch, episodes = Batch(machines, tasks), dict[str, np.ndarray]()
    for name in COMPARED:
        policy = find_policy(name, scenario="standard")
        telemetry = simulate(batch, policy, range(SEED, SEED + DRAWS), max(map(time_limit, tasks)))
        first = telemetry[:, 0]
        episodes[name] = first[np.isfinite(column(first, "time"))]
        describe(name, telemetry)
    save(figures.clutches(episodes, machines[0].clutch.voltage_max), IMAGES / "clutches.png")


def describe(name: str, telemetry: np.ndarray) -> None:
    """Print the numbers that the page says about the picture: errors and voltages of the start, shares of the modes."""
    for when in (0.2, SETTLED):
        row = round(when / 0.01)
        errors = np.percentile(1000.0 * np.abs(column(telemetry[row], "normal_error")), (0, 25, 50, 75, 100))
        volts = four(telemetry[1 : row + 1], "volts").mean(axis=(0, 1))
        print(f"{name}, after {when:g} s: quartiles {errors.round()} mm; voltages so far {volts.round(1)}")
    time, mode = column(telemetry, "time"), column(telemetry, "mode")
    for when, counted in (("until", (time > 0.0) & (time <= SETTLED)), ("after", time > SETTLED)):
        shares = (f"{each.name} {100 * (mode[counted] == each).mean():.0f} %" for each in ClutchMode)
        print(f"{name}, {when} {SETTLED:g} s: {', '.join(shares)}")


@cache
def classical_episodes() -> dict[str, np.ndarray]:
    """Return the telemetry of one drawn episode under each of four laws."""
    from classical import episodes

    drawn = {name: episodes(name, PACE, draws=1)[:, 0] for name in CLASSICAL}
    return {name: rows[np.isfinite(rows[:, 0])] for name, rows in drawn.items()}


def classical_trajectories() -> None:
    """Draw where four laws take the tip in one drawn episode."""
    import figures
    from classical import drawn_task

    from pter_gym.tools.pictures.plots import save

    shown = figures.arm_and_deviation(classical_episodes(), BASELINE.arm, drawn_task(PACE).path)
    save(shown, IMAGES / "classical-trajectories.png")


def classical_clutches() -> None:
    """Draw what four laws do with the clutches in that episode."""
    import figures

    from pter_gym.tools.pictures.plots import save

    save(figures.clutches(classical_episodes(), BASELINE.clutch.voltage_max), IMAGES / "classical-clutches.png")


def tremors() -> None:
    """Draw force and spectrum of the library's tremors."""
    import figures

    from pter_gym.hands import LIBRARY_TREMORS, find_hand
    from pter_gym.tools.pictures.plots import save

    hands = {name: find_hand(name) for name in LIBRARY_TREMORS}
    save(figures.force_and_spectrum(hands, LIBRARY_TREMORS), IMAGES / "tremors.png")


def identified() -> None:
    """Draw torque curves that are identified from the log of the machine in docs/identify.md."""
    from pter_gym.tools.identification import Recorder, identify, record_log
    from pter_gym.tools.identification.picture import picture
    from pter_gym.tools.pictures.plots import save

    arm = replace(BASELINE.arm, inertia_a=0.7, inertia_b=0.6, coupling=0.1)
    machine = replace(BASELINE, arm=arm, clutch_scale=(0.9, 1.1, 1.05, 0.95))
    save(picture(identify(record_log(machine, recorder=Recorder(delay=0.012)))), IMAGES / "identified.png")


def paper() -> None:
    """Draw the paper's figures and check its claims, as `pter reproduce` does."""
    from pter_gym.tools.paper.experiments import Study
    from pter_gym.tools.paper.reproduce.chapters import PRODUCTS
    from pter_gym.tools.paper.reproduce.results import results

    files, _ = results(Study(), PRODUCTS, print)
    kept = {name: content for name, content in files.items() if name.endswith((".png", "claims.json"))}
    write_files_atomic(IMAGES / "paper", kept)


# --- films ---


def frames(names: tuple[str, ...], scenario: str, size: tuple[int, int], *, last: bool = False) -> list[np.ndarray]:
    """Return the pictures of the same episode under some policies, side by side: all of them, or the last."""
    from pter_gym.tools.pictures.render.film import Film, Shot
    from pter_gym.tools.pictures.render.picture import Subject

    draws = find_scenario(scenario).randomisation(PACE, contexts=DRAWS, seed=FILM_SEED)
    machine, task = list(draws.pairs())[EPISODE[scenario]]
    drawn = what_is_drawn(scenario, machine, task)
    film = Film(
        [Shot(Subject(machine, task, f"{name}{drawn}"), telemetry(name, scenario, machine, task)) for name in names],
        RATE,
        size=size,
    )
    return [film.pixels(frame) for frame in range(len(film))[-1 if last else 0 :]]


def what_is_drawn(scenario: str, machine: Machine, task: PathFollowing) -> str:
    """Return in words what the picture itself does not show of a scenario's draw."""
    hand = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(task.hand).__name__).lower()
    lag = f"clutches of {1000 * machine.clutch.time_constant:.0f} ms"
    told = {"hands": (hand,), "tremor": (hand,), "materials": (lag,), "everything": (hand, lag)}
    return "".join(f", {each}" for each in told.get(scenario, ()))


def telemetry(name: str, scenario: str, machine: Machine, task: PathFollowing) -> np.ndarray:
    """Return the telemetry of the episode that is shown."""
    policy = find_policy(name, scenario=scenario)
    return record_episode(policy, machine, task, FILM_SEED, time_limit(task)).telemetry


def write_webp(shown: list[np.ndarray], path: Path, quality: int) -> None:
    """Write pictures as a WebP, which moves and repeats if they are several."""
    from PIL import Image

    first, *others = map(Image.fromarray, shown)
    content = io.BytesIO()
    moving = {"save_all": True, "append_images": others, "duration": round(1000 / RATE), "loop": 0} if others else {}
    first.save(content, "WEBP", quality=quality, method=4, **moving)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, content.getvalue())


def side_by_side() -> None:
    """Film the best tuned law and a trained policy on the same episodes, one scenario after another."""
    shown = [each for name in SIDE_BY_SIDE_SCENARIOS for each in frames(SIDE_BY_SIDE, name, (720, 405))]
    write_webp(shown, IMAGES / "moving" / "side-by-side.webp", 40)


def alone(scenario: str) -> None:
    """Film an episode of a scenario under one trained policy."""
    write_webp(frames((SHOWN,), scenario, (600, 428)), IMAGES / "moving" / f"{scenario}.webp", 40)


def policies() -> None:
    """Draw each policy at the end of the same episode of the paper's setting."""
    for name in policy_names():
        write_webp(frames((name,), "standard", (600, 428), last=True), IMAGES / "policies" / f"{name}.webp", 80)


PICTURES: dict[str, Callable[[], None]] = {
    "pter.png": pter,
    "clutches.png": clutches,
    "classical-trajectories.png": classical_trajectories,
    "classical-clutches.png": classical_clutches,
    "tremors.png": tremors,
    "identified.png": identified,
    "paper": paper,
    "moving/side-by-side.webp": side_by_side,
    **{f"moving/{name}.webp": partial(alone, name) for name in SCENARIOS},
    "policies": policies,
}


def main(names: tyro.conf.Positional[tuple[str, ...]] = (), results: Path | None = None) -> None:
    """Make pictures, all by default but that of the results, which needs their folder."""
    every = PICTURES | ({} if results is None else {"error-against-pace.png": partial(error_against_pace, results)})
    for name in names or every:
        every[name]()
        print(f"wrote {IMAGES / name}")


if __name__ == "__main__":
    tyro.cli(main)
