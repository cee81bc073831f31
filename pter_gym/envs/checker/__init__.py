"""A checker for any ``gymnasium.vector.VectorEnv``: what of Gymnasium's contract it keeps, breaks and leaves out.

For example::

    report = check_vector_env(lambda **keywords: gymnasium.make_vec("CartPole-v1", **keywords))
    print(report)

Everything is found out from outside: by playing episodes in several copies of the environment and comparing bits.
"""

from collections.abc import Callable, Collection
from contextlib import closing, suppress
from functools import partial

import gymnasium
from gymnasium.vector import AutoresetMode

from pter_gym.envs.checker.autoreset import AUTORESET
from pter_gym.envs.checker.playing import AnyVectorEnv, Check, Failed, Missing, Subject, mode_of
from pter_gym.envs.checker.report import Finding, Outcome, Report
from pter_gym.envs.checker.resets import RESETS
from pter_gym.envs.checker.returns import RETURNS
from pter_gym.envs.checker.seeds import SEEDS

__all__ = ["Finding", "Outcome", "Report", "check_vector_env"]


def check_vector_env(
    make: Callable[..., AnyVectorEnv],
    *,
    num_envs: int = 4,
    steps: int = 300,
    seed: int = 0,
    modes: Collection[AutoresetMode] = tuple(AutoresetMode),
) -> Report:
    """Check a vector environment in the autoreset modes in which it can be made.

    Parameters
    ----------
    make
        Builds the environment: called with ``num_envs=`` and, where it takes it, ``autoreset_mode=``. Its worlds are
        alike, and some episodes end within ``steps`` steps of random actions.
    num_envs
        Number of worlds, at least 2.
    steps
        Steps that a check plays.
    seed
        Of the first world, and of the actions.
    modes
        The modes to look at; all by default.

    Returns
    -------
    Report
        One finding for each check and mode: ok, failed, or missing where the environment lacks the feature.
    """
    builds = _builds(make, num_envs)
    findings: list[Finding] = []
    for mode in [mode for mode in builds if mode in modes]:
        others = [builds[other] for other in builds if other not in (mode, AutoresetMode.SAME_STEP)]
        subject = Subject(builds[mode], others[0] if others else None, mode, num_envs, steps, seed)
        findings += [_finding(check, subject) for check in (*RETURNS, *SEEDS, *RESETS, *AUTORESET[mode])]
    return Report(tuple(findings))


def _builds(make: Callable[..., AnyVectorEnv], num_envs: int) -> dict[AutoresetMode, Callable[[], AnyVectorEnv]]:
    """Return builders for the modes that the environment can be asked for, or for the one that it declares."""
    builds: dict[AutoresetMode, Callable[[], AnyVectorEnv]] = {}
    for mode in AutoresetMode:
        build = partial(make, num_envs=num_envs, autoreset_mode=mode)
        with suppress(TypeError, ValueError, gymnasium.error.Error):
            build().close()
            builds[mode] = build
    if not builds:
        build = partial(make, num_envs=num_envs)
        with closing(build()) as env:
            builds[mode_of(env)] = build
    return builds


def _finding(check: Check, subject: Subject) -> Finding:
    try:
        outcome, sentence = Outcome.OK, check(subject)
    except Failed as failure:
        outcome, sentence = Outcome.FAILED, str(failure)
    except Missing as lack:
        outcome, sentence = Outcome.MISSING, str(lack)
    except Exception as error:  # noqa: BLE001  (an environment under test may raise anything)
        outcome, sentence = Outcome.FAILED, f"raised {type(error).__name__}: {error}"
    return Finding(check.__name__.lstrip("_"), subject.mode.name, outcome, sentence)
