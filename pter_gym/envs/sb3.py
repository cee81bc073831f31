"""For Stable-Baselines3: a ``VecEnv`` over many worlds, and a callback that assesses a policy."""

import pickle
import time
from collections.abc import Iterable, Mapping
from io import BytesIO
from statistics import fmean
from typing import Any, NamedTuple, cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, expand_path, make_folder, write_files_atomic
from pter_gym.benchmark import Assessment, Episodes, assess, from_sb3, training_episodes
from pter_gym.benchmark.rollout import UNSEEN, check_acting
from pter_gym.errors import ParameterError, needs_extra
from pter_gym.scenarios.paces import find_pace, names_of_paces

try:
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError(str(needs_extra("pter_gym.envs.sb3", "agents"))) from error

from pter_gym.envs._vector import PathFollowingVectorEnv
from pter_gym.policies._acting import attributes

__all__ = ["ModelAssessment", "PathErrorCallback", "PterVecEnv", "make_sb3_vec_env"]

Indices = int | Iterable[int] | None


class PterVecEnv(VecEnv):
    """A ``VecEnv`` of Stable-Baselines3; make one with ``make_sb3_vec_env``.

    A world that ends is reset at once; ``infos[i]`` then holds ``terminal_observation``,
    ``TimeLimit.truncated``, ``is_success``, and ``episode`` with return, length and time as from
    ``VecMonitor``, which isn't needed. With ``privileged=True``, ``infos[i]["privileged"]`` is from
    before such a reset, like ``terminal_observation``, and that of the new episode is in
    ``reset_infos[i]``.
    """

    def __init__(self, env: PathFollowingVectorEnv) -> None:
        self.env = env
        self._actions: Any = None
        self._began = time.time()
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Start new episodes, with the seeds of ``seed`` if it was called since the last reset.

        Seeds and options apply to one reset only, even if it raises an error.
        """
        seeds, options = self._seeds, cast("object", self._options)
        self._reset_seeds()
        self._reset_options()
        if not isinstance(options, list) or any(cast("list[Any]", options)):
            raise ParameterError(f"options must be empty, got {options!r:.200}")
        obs, infos = self.env.reset(seed=seeds)
        self._returns[:] = self._lengths[:] = 0
        self.reset_infos = [_truth_in(infos, world) for world in range(self.num_envs)]
        return obs

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep the actions (N, clutches) for ``step_wait``."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all worlds by ``frame_skip`` control periods."""
        obs, rewards, terminated, truncated, infos = self.env.step(self._actions)
        done = terminated | truncated
        listed: list[dict[str, Any]] = [
            {"TimeLimit.truncated": False, **_truth_in(infos, world)}
            for world in range(self.num_envs)
        ]
        self._returns += rewards
        self._lengths += 1
        if done.any():
            elapsed = round(time.time() - self._began, 6)
            success = infos["final_info"]["is_success"]
            for world in map(int, np.flatnonzero(done)):
                listed[world] = {
                    "terminal_observation": infos["final_obs"][world],
                    "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
                    "is_success": bool(success[world]),
                    "episode": {
                        "r": round(float(self._returns[world]), 6),
                        "l": int(self._lengths[world]),
                        "t": elapsed,
                    },
                    **_truth_in(infos["final_info"], world),
                }
                self.reset_infos[world] = _truth_in(infos, world)
            self._returns[done] = self._lengths[done] = 0
        return obs, rewards.astype(np.float32), done, listed

    def close(self) -> None:
        """Stop the threads."""
        self.env.close()

    def get_images(self) -> list[NDArray[np.uint8] | None]:
        """Return a picture of each world in the mode ``rgb_array``, which ``render`` tiles."""
        return list(self.env.render() or ())

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each chosen world."""
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:  # noqa: ARG002
        """Raise an error: the worlds of a batch share their attributes."""
        raise ParameterError(
            f"{attr_name!r} cannot be set: the worlds of a batch share their attributes"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once; return its result for each chosen world."""
        result = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """Return whether it is ``Monitor``, whose records ``infos`` hold, for each world."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def _truth_in(infos: dict[str, Any], world: int) -> dict[str, Any]:
    """Return a world's share of what infos hold that no sensor shows."""
    return {"privileged": infos["privileged"][world]} if "privileged" in infos else {}


def make_sb3_vec_env(num_envs: int, **arguments: Any) -> PterVecEnv:
    """Return N worlds as a ``VecEnv`` of Stable-Baselines3.

    Parameters
    ----------
    num_envs
        N.
    **arguments
        Those of ``PathFollowingVectorEnv``, such as ``scenario="standard"`` for the worlds of
        ``PTER/Standard-v0``; by default the worlds are those of ``PTER/PathFollowing-v0``.
    """
    fixed: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP, "telemetry": False}
    for name in fixed.keys() & arguments:
        raise ParameterError(f"{name} must not be given: Stable-Baselines3 has its own way")
    return PterVecEnv(PathFollowingVectorEnv(num_envs, **fixed, **arguments))


class ModelAssessment(NamedTuple):
    """A model's assessments by pace, after a number of steps."""

    steps: int
    paces: Mapping[str, Assessment]

    @property
    def path_error_m(self) -> float:
        """Mean path error over the paces [m], by which leaderboards order policies."""
        return fmean(each.path_error_m for each in self.paces.values())

    @property
    def merit(self) -> tuple[int, float]:
        """Sort key of models, the best first: paces without a rank, then the path error [m]."""
        return sum(not each.ranked for each in self.paces.values()), self.path_error_m

    def __str__(self) -> str:
        """Return steps and path errors as text."""
        errors = (
            f"{pace} {1e3 * each.path_error_m:5.1f} mm{'' if each.ranked else ' (unranked)'}"
            for pace, each in self.paces.items()
        )
        return "   ".join((f"{self.steps:>10,} steps", *errors))


class PathErrorCallback(BaseCallback):
    """Assesses the model as the benchmark scores policies, and keeps the best one.

    It does so before training, every ``eval_freq`` steps and after training, on held-out training
    episodes of the environment's scenario and machine, as ``benchmark.examine`` draws them: they
    begin at rest, whatever ``starts``, ``reward`` and workspace are in training. Test episodes are
    not read. The model acts as in ``from_sb3(model)``, with the statistics of a ``VecNormalize``
    and with the law that its actions correct. The callback does not affect training.

    For each pace the model's logger gets ``path_error_mm/PACE``, ``completed/PACE``, the fraction
    of completed episodes, and ``ranked/PACE``, 1 if the means are within the leaderboard's limits;
    ``path_error_mm/mean`` is the mean over the paces. TensorBoard and CSV show them.

    The best model is ranked at the most paces, and among those has the smallest mean path error.

    Parameters
    ----------
    eval_freq
        Steps between two assessments, of all worlds together, as ``total_timesteps`` counts them.
    best_model_save_path
        Folder for the best model, ``best_model.zip``, and the statistics of a ``VecNormalize``,
        ``vecnormalize.pkl``, created if necessary; files are written atomically. By default none is
        kept.
    paces
        Paces to assess it at, names or speeds [m/s]; by default the one of all training episodes,
        otherwise the benchmark's three.
    episodes
        Episodes at each pace.
    verbose
        Whether to print each assessment.

    Attributes
    ----------
    assessments : list of ModelAssessment
        All assessments, in order: ``steps``, and ``paces`` with the ``Assessment`` at each.
    held_out : dict of str to Episodes
        The episodes by pace, from the beginning of training.

    Raises
    ------
    ParameterError
        If an argument is out of range; and before the training, if the folder cannot be written
        to, or the environment isn't one that ``from_sb3`` knows, or has worlds of several scenarios
        or with tasks of their own.
    """

    def __init__(
        self,
        eval_freq: int = 100_000,
        best_model_save_path: FilePath | None = None,
        *,
        paces: Iterable[str | float] | str | float | None = None,
        episodes: int = 64,
        verbose: int = 1,
    ) -> None:
        super().__init__(verbose)
        self.eval_freq = whole_number("eval_freq", eval_freq)
        self.best_model_save_path = best_model_save_path
        if best_model_save_path is not None:
            self.best_model_save_path = expand_path("best_model_save_path", best_model_save_path)
        self.assessments: list[ModelAssessment] = []
        self.held_out: dict[str, Episodes] = {}
        self._paces = None if paces is None else names_of_paces(paces)
        self._count = whole_number("episodes", episodes)

    @property
    def best(self) -> ModelAssessment:
        """The assessment of the best model so far."""
        return min(self.assessments, key=lambda each: each.merit)

    def _init_callback(self) -> None:
        env, policy = self.training_env, from_sb3(self.model)
        scenario, *others = attributes(env, "scenario")
        if others:
            raise ParameterError("env must have one scenario in all worlds to be assessed")
        known = {pace for paces in attributes(env, "paces") for pace in paces}
        self.held_out = {
            pace: training_episodes(scenario, pace, self._count, UNSEEN)
            for pace in self._paces or sorted(known, key=find_pace)
        }
        for drawn in self.held_out.values():
            check_acting(policy, drawn)
        if self.best_model_save_path is not None:
            make_folder(self.best_model_save_path, "best_model_save_path")

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps // self.eval_freq != self._assessed // self.eval_freq:
            self._assess()

    def _on_training_end(self) -> None:
        if self.num_timesteps != self._assessed:
            self._assess()

    @property
    def _assessed(self) -> int:
        """Steps before the latest assessment, −1 without one."""
        return self.assessments[-1].steps if self.assessments else -1

    def _assess(self) -> None:
        """Assess the model, log and print it, and store it if it is the best so far."""
        policy = from_sb3(self.model)
        paces = {pace: assess([policy], drawn) for pace, drawn in self.held_out.items()}
        latest = ModelAssessment(self.num_timesteps, paces)
        self.assessments.append(latest)
        for pace, each in paces.items():
            self.logger.record(f"path_error_mm/{pace}", 1e3 * each.path_error_m)
            self.logger.record(f"completed/{pace}", each.completed)
            self.logger.record(f"ranked/{pace}", int(each.ranked))
        self.logger.record("path_error_mm/mean", 1e3 * latest.path_error_m)
        self.logger.record("time/total_timesteps", latest.steps, exclude="tensorboard")
        self.logger.dump(latest.steps)
        if self.verbose:
            print(latest)  # noqa: T201  (as Stable-Baselines3 does)
        if self.best_model_save_path is not None and self.best is latest:
            self._save(self.best_model_save_path)

    def _save(self, folder: FilePath) -> None:
        """Write the model, and the statistics that normalise its observations."""
        stored = BytesIO()
        self.model.save(stored)
        files = {"best_model.zip": stored.getvalue()}
        if statistics := self.model.get_vec_normalize_env():
            files["vecnormalize.pkl"] = pickle.dumps(statistics)
        write_files_atomic(folder, files)
