"""The native vector environment: many worlds in one compiled call, with Gymnasium's semantics."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Unpack, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from pter_gym._engine import world
from pter_gym._engine.batch import Observations, Returns
from pter_gym._engine.storage import Array, Mask
from pter_gym._engine.world import WorldState
from pter_gym._internal.checks import whole_number
from pter_gym.envs._computer import available_cores, available_memory
from pter_gym.envs._mixin import Arguments, WorldsMixin
from pter_gym.errors import ParameterError
from pter_gym.plugins import load_artist
from pter_gym.policies._history import checked_history
from pter_gym.tasks.path_following._telemetry import COLUMNS

if TYPE_CHECKING:
    from pter_gym.envs._agent_batch import AgentBatch

_ENDED = {
    AutoresetMode.NEXT_STEP: world.NEXT_STEP,
    AutoresetMode.SAME_STEP: world.SAME_STEP,
    AutoresetMode.DISABLED: world.REFUSE,
}


class PathFollowingVectorEnv(  # pyright: ignore[reportIncompatibleVariableOverride]
    WorldsMixin, VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]
):
    """N worlds of ``PathFollowingEnv`` in one compiled call.

    A world with seed s goes through the same episodes, bit for bit, as a single environment that is
    reset with seed s, whatever the number of worlds and threads. ``infos`` holds ``telemetry`` (N,
    len(telemetry_layout)), on request ``privileged`` (N, len(privileged_layout)), and
    ``is_success`` (N,), with their masks, and with ``AutoresetMode.SAME_STEP`` the final entries
    that Gymnasium defines.

    Parameters
    ----------
    num_envs
        N.
    autoreset_mode
        When a world whose episode has ended is reset; an ``AutoresetMode`` or its value.
    max_episode_steps
        Steps of the environment, of ``frame_skip`` control steps each, after which an episode is
        truncated; None, or −1 as Gymnasium has it, for no limit.
    telemetry
        Whether ``infos`` holds telemetry.
    render_mode
        ``"rgb_array"``: ``render`` returns a picture of each world, for at most 64 worlds.
    width, height
        Size of the picture of one world [px].
    num_threads
        Threads for large batches; by default one per core that this process may use. Results do not
        depend on it.
    **arguments
        Those of ``PathFollowingEnv``; ``machine`` and ``task`` for all worlds, or a sequence with
        one for each.

    Raises
    ------
    ParameterError
        If an argument is out of range, or the worlds would not fit into the memory of this machine.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = 1000,
        telemetry: bool = True,
        num_threads: int | None = None,
        render_mode: Literal["rgb_array"] | None = None,
        width: int = 320,
        height: int = 240,
        **arguments: Unpack[Arguments],
    ) -> None:
        self.autoreset_mode = find_autoreset_mode(autoreset_mode)
        self.num_envs = whole_number("num_envs", num_envs)
        self.max_episode_steps = None if max_episode_steps == -1 else max_episode_steps
        check_memory(self.num_envs, telemetry, checked_history(arguments.get("history", ())))
        self.metadata = {"render_modes": ["rgb_array"], "autoreset_mode": self.autoreset_mode}
        self.single_observation_space, self.single_action_space = self._make_worlds(
            self.num_envs,
            render_mode,
            arguments,
            max_episode_steps=self.max_episode_steps,
            telemetry=telemetry or render_mode is not None,
            num_threads=available_cores() if num_threads is None else num_threads,
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.render_mode = render_mode
        self._records = telemetry
        self._ended = _ENDED[self.autoreset_mode]
        self._viewer = (
            load_artist("worlds")(self.batch.pairs, num_envs, width, height)
            if render_mode
            else None
        )

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Start new episodes.

        Parameters
        ----------
        seed
            None for the next episode of each world's seed, an int s for the seeds s, s + 1, …, or
            one for each world.
        options
            ``{"reset_mask": mask}`` with a bool array (N,) resets only the chosen worlds.

        Raises
        ------
        ParameterError
            If there is an unknown option, or the mask has a wrong shape or type or selects no
            world.
        """
        self._check_open()
        chosen = self._mask(options)
        obs, telemetry = self.batch.reset(self._seeds(seed), chosen)
        if self._viewer:
            self._viewer.update(telemetry, chosen)
        success = np.zeros(self.num_envs, np.bool_)
        return obs, self._infos(chosen, telemetry, success, self._truth())

    def step(self, actions: Any) -> tuple[Observations, Array, Mask, Mask, dict[str, Any]]:
        """Advance all worlds by ``frame_skip`` control periods.

        Raises
        ------
        ActionError
            If an action has a wrong shape or type, is not finite, or is out of bounds; no world has
            moved.
        ResetNeededError
            If a world was never reset, or its episode has ended with ``AutoresetMode.DISABLED``; no
            world has moved.
        """
        self._check_open()
        returns = self.batch.step(actions, self._ended)
        terminated, truncated, success = returns.flags
        telemetry = returns.telemetry[:1].reshape(-1, COLUMNS)
        if self._viewer:
            self._viewer.update(telemetry)
        infos = self._infos(np.ones(self.num_envs, np.bool_), telemetry, success, self._truth())
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            self._add_final(infos, returns, terminated | truncated)
        return returns.obs, returns.rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each world, uint8 (height, width, 3), if there is a render mode."""
        if self._viewer is None:
            gymnasium.logger.warn(
                "render_mode was not given to gymnasium.make_vec; nothing is rendered"
            )
            return None
        if not self._viewer.ready:
            raise gymnasium.error.ResetNeeded("render needs a reset of all worlds before it")
        return self._viewer.draw(self.batch.context)

    def close_extras(self) -> None:
        """Stop the threads."""
        if hasattr(self, "batch"):  # Gymnasium closes what could not be made, too
            self.batch.close()

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Return copies of all that changes; ``set_state`` restores them bit for bit."""
        return self.batch.get_state()

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore a state from ``get_state`` of an environment with as many worlds."""
        self.batch.set_state(state)

    def get_worlds(self) -> WorldState:
        """Return a copy of each world's state, named numbers (N,) in SI units."""
        return self.batch.get_worlds()

    def set_worlds(self, state: WorldState) -> None:
        """Set the states of all worlds, for instance to a measured one; see ``Batch.set_worlds``.

        The memory of a base or a history doesn't change.
        """
        self.batch.set_worlds(state)

    def _infos(
        self, mask: Mask, telemetry: Array, success: Mask, truth: Array | None
    ) -> dict[str, Any]:
        infos: dict[str, Any] = {"is_success": success, "_is_success": mask}
        if self._records:
            infos |= {"telemetry": telemetry, "_telemetry": mask.copy()}
        if truth is not None:
            infos |= {"privileged": truth, "_privileged": mask.copy()}
        return infos

    def _truth(self) -> Array | None:
        return self.batch.privileged() if self.worlds.privileged else None

    def _add_final(self, infos: dict[str, Any], returns: Returns, ended: Mask) -> None:
        """Add final observations and infos; the rest of ``infos`` belongs to the reset."""
        if not ended.any():
            return
        success = infos["is_success"]
        infos["is_success"] = success & ~ended
        final_obs = np.full(self.num_envs, None, object)
        final_obs[ended] = np.fromiter(returns.final_obs[ended], object, ended.sum())
        telemetry = returns.telemetry[1:].reshape(-1, COLUMNS)
        if len(telemetry):
            telemetry = np.where(ended[:, None], telemetry, 0.0)
        truth = None
        if self.worlds.privileged:
            last = cast("AgentBatch", self.batch).last_truth
            truth = np.where(ended[:, None], last, 0.0)
        infos |= {
            "final_obs": final_obs,
            "_final_obs": ended,
            "final_info": self._infos(ended.copy(), telemetry, success & ended, truth),
            "_final_info": ended.copy(),
        }

    def _check_open(self) -> None:
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("the vector environment was closed")

    def _seeds(self, seed: Any) -> list[int | None] | None:
        if seed is None:
            return None
        if np.ndim(seed) == 1:
            return [
                None if item is None else whole_number("seed", item, at_least=0) for item in seed
            ]
        first = whole_number("seed", seed, at_least=0)
        return list(range(first, first + self.num_envs))

    def _mask(self, options: dict[str, Any] | None) -> Mask:
        options = {} if options is None else options
        if not isinstance(cast("object", options), dict) or options.keys() - {"reset_mask"}:
            raise ParameterError(
                f"options must be a dict that may hold reset_mask only, got {options!r:.200}"
            )
        mask: Any = options.get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        if getattr(mask, "dtype", None) != np.bool_ or mask.shape != (self.num_envs,):
            raise ParameterError(
                f"options['reset_mask'] must be a bool array with the shape ({self.num_envs},)"
            )
        if not mask.any():
            raise ParameterError("options['reset_mask'] must choose at least one world")
        return np.array(mask, np.bool_)


def find_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return an autoreset mode by itself, its value or its name, or raise a ParameterError."""
    for known in AutoresetMode:
        if mode in (known, known.value, known.name):
            return known
    raise ParameterError(
        f"autoreset_mode must be one of {', '.join(m.name for m in AutoresetMode)}, got {mode!r}"
    )


BYTES_PER_WORLD, BYTES_OF_TELEMETRY, BYTES_PER_STEP = 1800, 2000, 400
"""Measured memory of a world and its share of the returns of two steps, of telemetry, and of each
control step of a history [B]."""


def check_memory(worlds: int, telemetry: bool, history: tuple[int, ...]) -> None:
    """Raise a ParameterError if this many worlds would not fit into memory."""
    remembered = BYTES_PER_STEP * max((0, *history))
    most = available_memory() // (BYTES_PER_WORLD + BYTES_OF_TELEMETRY * telemetry + remembered)
    if worlds > most:
        raise ParameterError(
            f"num_envs must be ≤ {most}, which fit into this machine's memory, got {worlds}"
        )
