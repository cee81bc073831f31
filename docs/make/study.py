"""What stock algorithms learn, and what exploration does: docs/stock-algorithms.md. Needs the extra `agents`.

    python docs/make/study.py                trains what is missing, one run on each core, then makes the page
    python docs/make/study.py --minutes 60   stops beginning new runs after an hour; the next call goes on
    python docs/make/study.py --no-train     makes the page of what there is

A run is a line of docs/make/study.jsonl. Policies are scored on training-side draws; seconds are those of one core,
scoring left out.
"""

import json
import runpy
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import tyro
from cores import finished, perform

from pter_gym.envs.scenario import FRAME_SKIP

SCRIPT = Path(__file__).resolve()
STOCK_SCRIPTS = SCRIPT.parents[2] / "agents" / "stock"

DRAWS = 64
"""Training-side draws at each pace on which a policy is scored."""

LOOKS = {"standard": 12, "everything": 6}
"""Scores of a run, evenly over what it is given."""

PERIODS = (1, 2, 3, 5, 8)
EXPLORATIONS = ("white", "AR(1)", "repeated")
SEEDS = range(100, 110)
"""Only the period of the scenarios was chosen with them."""
UNTUNED = range(110, 115)
"""README's arguments were chosen with other seeds, 10 to 16."""

TRACE = 0.983
"""λ for a control step; that of libraries, 0.95, is its third power."""

PERSISTENCE = 0.85
"""Of AR(1) noise, from decision to decision."""
DEVIATIONS = (0.3, 0.06)
"""Standard deviation of the fresh part of AR(1) noise, at the beginning and at the end."""

FAST_DECISIONS = 3_000_000
SECONDS = {"ends": 150.0, "readme": 250.0, "standard": 60.0, "everything": 30.0}
"""Processor time of a run with a library, by the part of the study or the scenario."""

PPO_SETTINGS = {"n_steps": 64, "batch_size": 1024}
FEW, MANY = 8, 64
"""Worlds of algorithms that learn off and on their policy."""


class Run(NamedTuple):
    """A training.

    Attributes
    ----------
    part
        Of the study: ``"noise"`` with λ per control step, ``"sight"`` with λ per decision, ``"ends"`` with
        Stable-Baselines3, ``"readme"`` with README's arguments, ``"stock"``, or ``"long"`` with a script given longer.
    algorithm
        Its name.
    noise
        What it explores with: white, AR(1), repeated or gSDE; empty as its library has it.
    period
        Control steps for which an action is held.
    scenario, seed
        What it learns.
    """

    part: str
    algorithm: str
    noise: str
    period: int
    scenario: str
    seed: int

    @property
    def trace(self) -> float:
        """Return λ for a decision: by control steps, or the usual one of libraries."""
        return TRACE**self.period if self.part == "noise" else 0.95

    @property
    def budget(self) -> float:
        """Processor time of a run with a library [s]."""
        return SECONDS[self.part if self.part in SECONDS else self.scenario]


def planned(period: int) -> Iterator[Run]:
    """Return all runs, what matters most first; the algorithms of libraries hold actions for a period."""
    for seed in SEEDS[:5]:
        yield Run("ends", "PPO", "white", period, "standard", seed)
    for seed in UNTUNED:
        yield Run("readme", "PPO", "white", period, "standard", seed)
    for scenario, seed in product(("standard", "everything"), SEEDS[:5]):
        yield from (Run("stock", name, "", period, scenario, seed) for name in STOCK)
        if scenario == "standard":
            yield from (Run("stock", name, "", period, scenario, seed) for name in SCRIPTS["stock"])
            yield from (Run("long", name, "", period, scenario, seed) for name in SCRIPTS["long"])
        else:
            yield Run("stock", "PPO", "", period, scenario, seed)
    for seed, each, noise in product(SEEDS[:3], PERIODS, EXPLORATIONS):
        yield Run("sight", "fast PPO", noise, each, "standard", seed)
    for seeds in (SEEDS[:5], SEEDS[5:]):
        for seed, each, noise in product(seeds, PERIODS, EXPLORATIONS):
            yield Run("noise", "fast PPO", noise, each, "standard", seed)
    for seed in SEEDS[:5]:
        yield from (Run("ends", "PPO", noise, 1, "standard", seed) for noise in ("white", "gSDE"))
        yield Run("ends", "PPO", "gSDE", period, "standard", seed)


class Curve:
    """Scores of a policy while it learns, and how long it has learnt."""

    def __init__(self, run: Run) -> None:
        from pter_agents.validation import Validation
        from pter_gym.scenarios import PACES

        self.rows: list[dict[str, Any]] = []
        sensors = "encoders" if run.algorithm == "jax_shac.py" else "torque"
        self._validation = Validation(run.scenario, tuple(PACES), DRAWS, sensors)
        self._begun = process_time()

    @property
    def seconds(self) -> float:
        """Processor time so far, without that of scoring."""
        return process_time() - self._begun

    def look(self, decisions: int, policy: Any) -> None:
        """Score a policy."""
        before = process_time()
        scores = self._validation.scores(policy)
        rounded = {pace: {name: float(f"{value:.4g}") for name, value in row.items()} for pace, row in scores.items()}
        self.rows.append({"decisions": decisions, "seconds": round(before - self._begun, 2), **rounded})
        self._begun += process_time() - before


def held(values: Any, rng: Any) -> Any:
    """Return noise (T, N, 4) of which each world holds a value for 1 to 16 steps, n with a probability ∝ n⁻²."""
    import numpy as np

    shares = 1.0 / np.arange(1, 17) ** 2.0
    for world in range(values.shape[1]):
        begin = 0
        while begin < len(values):
            end = begin + rng.choice(16, p=shares / shares.sum()) + 1
            values[begin:end, world] = values[begin, world]
            begin = end
    return values


def train_fast(run: Run, curve: Curve) -> None:
    """Train with `pter train ppo`'s loop, the value network not privileged."""
    import jax
    import numpy as np

    from pter_agents import training
    from pter_agents.algorithms import load_settings
    from pter_agents.ppo import PPO
    from pter_agents.prepare import make_interface
    from pter_gym.policies import NeuralPolicy

    class Repeated(PPO):
        def _draw(self) -> Any:
            drawn, orders = super()._draw()
            return jax.device_put(np.array([*map(held, np.array(drawn), self._rngs)]), self._split), orders

    changes: dict[str, Any] = {"privileged": False, "frame_skip": run.period, "episode": -(-1000 // run.period)}
    changes |= {"discount": 0.995**run.period, "trace": run.trace, "exploring": 0.3}
    lasts = run.noise == "AR(1)"
    factor = 1.0 if lasts else (1.0 - PERSISTENCE**2) ** -0.5  # the same stationary deviation
    changes |= {"deviation": factor * DEVIATIONS[0], "deviation_end": factor * DEVIATIONS[1]}
    changes["persistence"] = PERSISTENCE if lasts else 0.0
    settings = replace(load_settings("ppo"), **changes)
    given = training.Arguments(
        algorithm="ppo", scenario=run.scenario, pace="all", steps=FAST_DECISIONS, seed=run.seed, settings=settings
    )
    draws = training.make_draws(given)
    worlds = training.make_training_worlds(given, draws, make_interface(settings, run.scenario, draws, run.seed))
    model = (Repeated if run.noise == "repeated" else PPO)(settings, worlds, FAST_DECISIONS, run.seed)
    while model.steps < FAST_DECISIONS:
        model.advance()
        if model.steps >= FAST_DECISIONS * (len(curve.rows) + 1) / LOOKS[run.scenario]:
            curve.look(model.steps, NeuralPolicy(worlds.interface, model.actor()))


def _library(module: str, name: str, worlds: int = FEW, **keywords: Any) -> Callable[[Any, int], Any]:
    """Return what makes a model of a library with its defaults, but for some keywords."""

    def make(environment: Callable[[int], Any], seed: int) -> Any:
        from importlib import import_module

        kind = getattr(import_module(module), name)
        policy = "MlpLstmPolicy" if name == "RecurrentPPO" else "MlpPolicy"
        return kind(policy, environment(worlds), seed=seed, device="cpu", **keywords)

    return make


STOCK = {
    "A2C": _library("stable_baselines3", "A2C", MANY),
    "TRPO": _library("sb3_contrib", "TRPO", MANY, n_steps=64),
    "RecurrentPPO": _library("sb3_contrib", "RecurrentPPO", MANY, **PPO_SETTINGS),
    "SAC": _library("stable_baselines3", "SAC"),
    "TD3": _library("stable_baselines3", "TD3"),
    "TQC": _library("sb3_contrib", "TQC"),
    "CrossQ": _library("sb3_contrib", "CrossQ"),
    "ARS": _library("sb3_contrib", "ARS", 1),
}
"""Algorithms of libraries beside Stable-Baselines3's PPO, each with its defaults; worlds and rollouts are chosen."""


class Spent(Exception):
    """The run has used up its budget. An exception, as ARS ignores a callback that wants to stop."""


def train_library(run: Run, curve: Curve) -> None:
    """Train with a library for the run's budget."""
    import torch
    from stable_baselines3.common.callbacks import BaseCallback

    from pter_gym.benchmark import from_sb3
    from pter_gym.envs.sb3 import make_sb3_vec_env

    torch.set_num_threads(1)

    class Look(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            if curve.seconds >= run.budget * (len(curve.rows) + 1) / LOOKS[run.scenario]:
                curve.look(self.num_timesteps, from_sb3(self.model, frame_skip=run.period))
            if len(curve.rows) == LOOKS[run.scenario]:
                raise Spent

    changes: dict[str, Any] = {"gamma": 0.995} if run.period == 1 else {}
    if run.part == "readme":
        changes["gae_lambda"] = 0.98
    if run.noise == "gSDE":
        changes |= {"use_sde": True, "sde_sample_freq": 8, "policy_kwargs": {"log_std_init": -1.0}}
    makers = {"PPO": _library("stable_baselines3", "PPO", MANY, **PPO_SETTINGS, **changes), **STOCK}

    def environment(worlds: int) -> Any:
        given = {"context_seed": run.seed, "frame_skip": run.period, "num_threads": 1}
        return make_sb3_vec_env(worlds, scenario=run.scenario, **given)

    with suppress(Spent):
        makers[run.algorithm](environment, run.seed).learn(10**9, callback=Look())


SCRIPTS = {
    "stock": {"cleanrl_ppo.py": 1_000_000, "jax_ppo.py": 2_000_000, "jax_shac.py": 1_500_000},
    "long": {"jax_ppo.py": 3_000_000, "jax_shac.py": 4_000_000},
}
"""Scripts of agents/stock and their decisions, by part: in about the time of the libraries, and longer."""


def train_script(run: Run, curve: Curve) -> None:
    """Run a script of agents/stock, and score the policy that it would take to the leaderboard."""
    train: Any = runpy.run_path(str(STOCK_SCRIPTS / run.algorithm))["train"]
    steps = SCRIPTS[run.part][run.algorithm]

    def look(_: str, policies: dict[str, Any], **__: Any) -> None:
        curve.look(steps, next(iter(policies.values())))

    def print_boards(_: object) -> None:
        """Print nothing: the study scores the policy itself."""

    train.__globals__.update(run_scenario=look, print_boards=print_boards)
    train(seed=run.seed, steps=steps)


def one(run: Run) -> list[dict[str, Any]]:
    """Train, and return the scores on the way."""
    curve = Curve(run)
    scripted = run.algorithm.endswith(".py")
    train = train_script if scripted else train_fast if run.algorithm == "fast PPO" else train_library
    train(run, curve)
    return curve.rows


def known() -> dict[Run, list[dict[str, Any]]]:
    """Return the runs that are finished."""
    return {Run(*run): curve for run, curve in finished(SCRIPT)}


def tell(run: Run, curve: list[dict[str, Any]]) -> str:
    """Return a line about a run: its cost and its path errors [mm]."""
    end = curve[-1]
    errors = ", ".join(f"{1000 * end[pace]['path_error_m']:.1f}" for pace in ("slow", "medium", "brisk"))
    return f"{' '.join(map(str, run))} {end['decisions']} decisions, {end['seconds']} s: {errors}"


def main(period: int = FRAME_SKIP, minutes: float = 600.0, only: str = "", no_train: bool = False) -> None:
    """Train what is missing, and make the page; ``only`` is for the processes that train."""
    if only:
        print(json.dumps(one(Run(*json.loads(only)))))
        return
    if not no_train:
        perform(SCRIPT, known(), planned(period), minutes, tell)
    from study_page import make

    make(known())


if __name__ == "__main__":
    tyro.cli(main)
