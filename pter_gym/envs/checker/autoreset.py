"""Checks of what happens to worlds whose episodes have ended."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from pter_gym.envs.checker.bits import bits_of, info_of
from pter_gym.envs.checker.playing import (
    Check,
    Failed,
    Mask,
    Missing,
    Return,
    Subject,
    error_of,
    merged,
    play,
    require,
    reset,
    step,
    visits_of,
)
from pter_gym.envs.checker.starts import start_range


def _autoreset_result(subject: Subject) -> str:
    for end, after in visits_of(subject):
        for world in np.flatnonzero(end.ended):
            require(after.rewards[world] == 0.0, "the step that resets a world has a reward")
            require(not after.ended[world], "the step that resets a world ends it")
    return "the step that resets a world has reward 0 and no flag"


def _autoreset_action(subject: Subject) -> str:
    actions = subject.actions()
    ended = np.zeros(subject.worlds, np.bool_)
    visits_of(subject)
    with closing(subject.build()) as env, closing(subject.build()) as other:
        reset(env, subject.seed)
        reset(other, subject.seed)
        for action, another in zip(actions, reversed(actions), strict=True):
            one, two = step(env, action), step(other, merged(env, ended, another, action))
            for world in range(subject.worlds):
                require(one.world(world) == two.world(world), "the step that resets a world uses its action")
            ended = one.ended
    return "the step that resets a world ignores its action"


def _autoreset_start(subject: Subject) -> str:
    is_start = start_range(subject)
    for end, after in visits_of(subject):
        shown = end if subject.mode == AutoresetMode.SAME_STEP else after
        for world in np.flatnonzero(end.ended):
            require(is_start(shown.rows()[world]), "after an automatic reset an observation is none of a start")
    return "an automatic reset returns an observation of a start"


def _autoreset_final_masks(subject: Subject) -> str:
    with closing(subject.build()) as env:
        for returned in play(env, subject.actions(), subject.seed):
            for key in ("final_obs", "final_info"):
                _check_final(key, returned.infos, returned.ended)
    if all(visit.end.ended.all() for visit in visits_of(subject)):
        raise Missing("all worlds end together, so masks tell nothing: let make vary their episodes")
    return "final_obs and final_info are there for the worlds that ended, and for no other"


def _check_final(key: str, infos: Mapping[str, Any], ended: Mask) -> None:
    require(key in infos or not ended.any(), f"an episode ended without {key}")
    mask = infos.get(f"_{key}", np.zeros_like(ended))
    require(np.array_equal(mask, ended), f"the mask of {key} is not that of the worlds that ended")
    if key == "final_obs" and key in infos:
        none = [row is None for row in infos[key]]
        require(none == [not end for end in ended], "final_obs is not None exactly for the worlds that go on")


def _autoreset_final_obs(subject: Subject) -> str:
    """Compare the first end with that in a mode that returns the last observation as such."""
    end = visits_of(subject)[0].end
    other = None if subject.other is None else visits_of(replace(subject, build=subject.other))[0].end
    for world in map(int, np.flatnonzero(end.ended)):
        final = end.infos["final_obs"][world]
        require(bits_of(final) != bits_of(end.rows()[world]), "final_obs is the observation of the new start")
        if other is not None:
            told = info_of(end.infos["final_info"], world)
            fits = bits_of((final, told)) == bits_of((other.rows()[world], info_of(other.infos, world)))
            require(fits, "final_obs or final_info differ from what another mode returns at the end")
            fits = np.array_equal(end.rewards, other.rewards) and np.array_equal(end.terminated, other.terminated)
            require(fits, "rewards or flags differ from what another mode returns at the end")
    return "final_obs is " + ("not the new start" if other is None else "what another mode returns at the end")


def _autoreset_waits(subject: Subject) -> str:
    """Look at what happens to an ended world without and with ``reset_mask``."""
    is_start = start_range(subject)
    for end, after in visits_of(subject):
        require("final_obs" not in end.infos, "final_obs is there although nothing was reset")
        for world in np.flatnonzero(end.ended):
            require(not is_start(end.rows()[world]), "a world that ended shows a start at once")
            require(is_start(after.rows()[world]), "reset_mask does not bring back a world that ended")
    actions = subject.actions()
    with closing(subject.build()) as env:
        returns = play(env, actions, subject.seed)
        ended = next(returned.ended for returned in returns if returned.ended.any())
        error = error_of(lambda: _check_waiting(step(env, actions[0]), ended, is_start))
    if isinstance(error, Failed):
        raise error
    return "a world that ended waits for reset_mask"


def _check_waiting(returned: Return, ended: Mask, is_start: Callable[[Any], bool]) -> None:
    for world in np.flatnonzero(ended):
        require(returned.ended[world] or not is_start(returned.rows()[world]), "a world that ended restarts by itself")


AUTORESET: dict[AutoresetMode, tuple[Check, ...]] = {
    AutoresetMode.NEXT_STEP: (_autoreset_result, _autoreset_action, _autoreset_start),
    AutoresetMode.SAME_STEP: (_autoreset_start, _autoreset_final_masks, _autoreset_final_obs),
    AutoresetMode.DISABLED: (_autoreset_waits,),
}
"""The checks of each mode."""
