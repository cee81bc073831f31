"""Checks of resets of chosen worlds, and of steps before the first reset and after the end."""

from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from pter_gym.envs.checker.bits import bits_of
from pter_gym.envs.checker.playing import (
    AnyVectorEnv,
    Check,
    Missing,
    Subject,
    error_of,
    require,
    reset,
    step,
)
from pter_gym.envs.checker.seeds import need_seed_lists
from pter_gym.envs.checker.starts import start_range


def need_masks(subject: Subject) -> None:
    """Raise Missing if ``reset_mask`` is refused, or ignored: every world restarts, even when none is chosen."""
    nobody = np.zeros(subject.worlds, np.bool_)
    with closing(subject.build()) as env:
        reset(env, subject.seed)
        error = error_of(lambda: reset(env, mask=subject.first_alone()))
        if error is not None:
            raise Missing(f"reset refuses options['reset_mask'] ({type(error).__name__}: {error})")
        before = step(env, subject.actions()[0]).rows()
        if error_of(lambda: reset(env, mask=nobody)) is not None:
            return
        after = reset(env, mask=subject.first_alone()).rows()
    if not any(bits_of(one) == bits_of(two) for one, two in zip(before, after, strict=True)):
        raise Missing("reset ignores options['reset_mask']: all worlds restart")


def _partial_reset(subject: Subject) -> str:
    need_masks(subject)
    actions, is_start = subject.actions(), start_range(subject)
    with closing(subject.build()) as env, closing(subject.build()) as undisturbed:
        reset(undisturbed, subject.seed)
        reset(env, subject.seed)
        plain = step(undisturbed, actions[0]).rows()
        step(env, actions[0])
        after = reset(env, mask=subject.first_alone())
        require(is_start(after.rows()[0]), "a chosen world does not show a start")
        kept = [bits_of(row) for row in plain[1:]] == [bits_of(row) for row in after.rows()[1:]]
        require(kept, "a world that was not chosen shows another observation")
        _same_others(subject, env, undisturbed, actions[1:])
    return "chosen worlds restart, the others stay untouched"


def _same_others(subject: Subject, env: AnyVectorEnv, undisturbed: AnyVectorEnv, actions: Sequence[Any]) -> None:
    """Step both environments, and require that all worlds but the first go on alike."""
    for action in actions:
        one, two = step(env, action), step(undisturbed, action)
        for world in range(1, subject.worlds):
            require(one.world(world) == two.world(world), "a world that was not chosen goes on differently")
        if subject.mode == AutoresetMode.DISABLED and (one.ended.any() or two.ended.any()):
            return


def _partial_reset_seeds(subject: Subject) -> str:
    need_masks(subject)
    need_seed_lists(subject)
    seeds = [seed + 1000 for seed in subject.seeds()]
    with closing(subject.build()) as env, closing(subject.build()) as undisturbed:
        start = reset(undisturbed, seeds).rows()[0]
        reset(undisturbed, subject.seed)
        reset(env, subject.seed)
        chosen = reset(env, seeds, subject.first_alone()).rows()[0]
        require(bits_of(chosen) == bits_of(start), "the seed of a chosen world does not decide its start")
        rows, plain = reset(env).rows(), reset(undisturbed).rows()
        kept = [bits_of(row) for row in rows[1:]] == [bits_of(row) for row in plain[1:]]
        require(kept, "a world that was not chosen took a seed")
    return "seeds reach the chosen worlds alone"


def _partial_reset_options(subject: Subject) -> str:
    need_masks(subject)
    mask = subject.first_alone()
    options = {"reset_mask": mask}
    with closing(subject.build()) as env:
        reset(env, subject.seed)
        env.reset(options=options)
    kept = options.get("reset_mask") is mask and len(options) == 1 and bits_of(mask) == bits_of(subject.first_alone())
    require(kept, "reset changed the caller's options")
    return "the caller's options stay as they were"


def _partial_reset_empty(subject: Subject) -> str:
    need_masks(subject)
    with closing(subject.build()) as env:
        reset(env, subject.seed)
        error = error_of(lambda: reset(env, mask=np.zeros(subject.worlds, np.bool_)))
    require(error is not None, "a reset_mask that chooses no world is accepted")
    return f"a reset_mask that chooses no world raises {type(error).__name__}"


def _begun(subject: Subject) -> str:
    action = subject.actions()[0]
    with closing(subject.build()) as env:
        error = error_of(lambda: step(env, action))
    require(error is not None, "step works before the first reset")
    return f"step before the first reset raises {type(error).__name__}"


def _closed(subject: Subject) -> str:
    with closing(subject.build()) as env:
        reset(env, subject.seed)
        action = subject.actions()[0]
        env.close()
        env.close()
        error = error_of(lambda: step(env, action))
    require(error is not None, "step works after close")
    return f"step after close raises {type(error).__name__}"


RESETS: tuple[Check, ...] = (
    _partial_reset,
    _partial_reset_seeds,
    _partial_reset_options,
    _partial_reset_empty,
    _begun,
    _closed,
)
