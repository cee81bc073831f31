"""The vector checker: nothing wrong with ours, what is known of Gymnasium's, and each rule that a mutant breaks."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from pter_gym.engine import world as kernel
from pter_gym.envs.checker import Outcome, Report, check_vector_env
from pter_gym.envs.vector import PathFollowingVectorEnv
from pter_gym.hands import MultiSineHand
from pter_gym.params import Arm, Clutch, Machine, TorqueCurve
from pter_gym.paths import Line
from pter_gym.tasks.path_following import PathFollowing

NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED

# weak clutches and a short path: episodes end at different times, some at the end of the path, some by the limit
DYNAMIC = TorqueCurve(slope=0.104, knee=12.0, curvature=0.0174)
MACHINE = Machine(
    arm=Arm(length_a=0.47, length_b=0.43, inertia_a=1.2, inertia_b=0.4, coupling=-0.2),
    clutch=Clutch(dynamic=DYNAMIC, breakaway=DYNAMIC.scaled(1.15)),
)
TASK = PathFollowing(
    path=Line(x=-0.1, y=0.54, length=0.2),
    start_offset=0.02,
    hand=MultiSineHand(push=50.0, amplitudes=(12.8,) * 5, random_phases=True),
)
LIMIT = 25


def check(kind: type[PathFollowingVectorEnv], *modes: AutoresetMode, **keywords: Any) -> Report:
    """Check a class in some modes."""

    def make(num_envs: int, autoreset_mode: AutoresetMode) -> PathFollowingVectorEnv:
        return kind(num_envs, MACHINE, TASK, autoreset_mode=autoreset_mode, max_episode_steps=LIMIT)

    return check_vector_env(make, modes=modes or tuple(AutoresetMode), **keywords)


def test_ours_passes_in_all_modes() -> None:
    report = check(PathFollowingVectorEnv)
    assert {finding.mode for finding in report.findings} == {"NEXT_STEP", "SAME_STEP", "DISABLED"}
    assert {finding.outcome for finding in report.findings} == {Outcome.OK}, str(report)


def test_episodes_under_check_end_in_both_ways_and_at_different_times() -> None:
    env = PathFollowingVectorEnv(4, MACHINE, TASK, max_episode_steps=LIMIT)
    env.reset(seed=0)
    env.action_space.seed(0)
    flags = np.array([env.step(env.action_space.sample())[2:4] for _ in range(80)])
    terminated, truncated = flags[:, 0], flags[:, 1]
    assert terminated.any()
    assert truncated.any()
    assert set((terminated | truncated).sum(axis=1)) >= {0, 1}


@pytest.fixture(scope="module")
def cartpole() -> Report:
    """What the checker says of Gymnasium's native CartPole vector environment."""
    return check_vector_env(
        lambda **keywords: gymnasium.make_vec("CartPole-v1", vectorization_mode="vector_entry_point", **keywords)
    )


def test_native_cartpole_resets_and_keeps_memory_apart(cartpole: Report) -> None:
    assert {finding.mode for finding in cartpole.findings} == {"NEXT_STEP"}
    assert cartpole.checks(Outcome.OK) >= {
        "autoreset_result",
        "autoreset_action",
        "autoreset_start",
        "aliasing_returns",
        "aliasing_inputs",
        "observations",
        "results",
    }


def test_native_cartpole_lacks_seeds_for_each_world_and_partial_reset(cartpole: Report) -> None:
    assert cartpole.checks(Outcome.MISSING) == {
        "seeds_list",
        "seeds_order",
        "seeds_company",
        "partial_reset",
        "partial_reset_seeds",
        "partial_reset_options",
        "partial_reset_empty",
    }


def test_a_report_says_what_was_checked(cartpole: Report) -> None:
    lines = str(cartpole).splitlines()
    assert len(lines) == len(cartpole.findings)
    missing = next(line for line in lines if "seeds_list" in line)
    assert " ".join(missing.split()) == "missing NEXT_STEP seeds_list reset refuses a list of seeds (Error)"
    assert cartpole.ok == (not cartpole.checks(Outcome.FAILED))


def test_sync_vector_env_of_cartpole_autoresets_in_all_modes() -> None:
    report = check_vector_env(
        lambda num_envs, **keywords: gymnasium.make_vec(
            "CartPole-v1", num_envs, vectorization_mode="sync", vector_kwargs=keywords
        ),
        steps=80,
    )
    assert {finding.mode for finding in report.findings} == {"NEXT_STEP", "SAME_STEP", "DISABLED"}
    wrong = report.checks(Outcome.FAILED) | report.checks(Outcome.MISSING)
    # Gymnasium takes the mask out of the caller's options, and steps after close
    assert wrong <= {"partial_reset_options", "closed"}, str(report)


def test_an_episode_that_never_ends_is_reported_as_missing() -> None:
    report = check(PathFollowingVectorEnv, steps=10)
    assert {"autoreset_result", "autoreset_final_obs", "autoreset_waits"} <= report.checks(Outcome.MISSING)
    assert report.ok


def test_starts_that_are_all_alike_are_reported_as_missing() -> None:
    report = check_vector_env(lambda num_envs: PathFollowingVectorEnv(num_envs, max_episode_steps=9), steps=20)
    assert report.checks(Outcome.MISSING) == {"seeds_streams"}


class Ours(PathFollowingVectorEnv):
    """Ours, with places where a mutant may reach in."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> Any:
        return self.spoil(*super().step(actions))

    def spoil(self, obs: Any, rewards: Any, terminated: Any, truncated: Any, infos: Any) -> Any:
        return obs, rewards, terminated, truncated, infos


class StringMode(Ours):
    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.metadata["autoreset_mode"] = "NextStep"


class OtherMode(Ours):
    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.metadata["autoreset_mode"] = SAME_STEP


class UnbatchedSpace(Ours):
    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.observation_space = gymnasium.spaces.Box(-2.0, 2.0, self.observation_space.shape, np.float32)


class WideObservations(Ours):
    def spoil(self, obs: Any, *rest: Any) -> Any:
        return obs * 3.0, *rest


class DoubleObservations(Ours):
    def spoil(self, obs: Any, *rest: Any) -> Any:
        return obs.astype(np.float64), *rest


class WideFinalObservations(Ours):
    def spoil(self, *returned: Any) -> Any:
        infos = returned[-1]
        for world in np.flatnonzero(infos.get("_final_obs", ())):
            infos["final_obs"][world] *= 3.0
        return returned


class ColumnRewards(Ours):
    def spoil(self, obs: Any, rewards: Any, *rest: Any) -> Any:
        return obs, rewards[:, None], *rest


class IntegerFlags(Ours):
    def spoil(self, obs: Any, rewards: Any, terminated: Any, *rest: Any) -> Any:
        return obs, rewards, terminated.astype(int), *rest


class NoMask(Ours):
    def spoil(self, *returned: Any) -> Any:
        del returned[-1]["_telemetry"]
        return returned


class ShortMask(Ours):
    def spoil(self, *returned: Any) -> Any:
        returned[-1]["_is_success"] = returned[-1]["_is_success"][:-1]
        return returned


class IntegerMask(Ours):
    def spoil(self, *returned: Any) -> Any:
        returned[-1]["_is_success"] = returned[-1]["_is_success"].astype(int)
        return returned


class ClockedRewards(Ours):
    clock = 0.0

    def spoil(self, obs: Any, rewards: Any, *rest: Any) -> Any:
        ClockedRewards.clock -= 1.0
        ended = rest[0] | rest[1]
        return obs, np.where(ended, ClockedRewards.clock, rewards), *rest


class OneBuffer(Ours):
    def spoil(self, obs: Any, *rest: Any) -> Any:
        self.buffer = getattr(self, "buffer", obs)
        self.buffer[:] = obs
        return self.buffer, *rest


class TwoBuffers(Ours):
    """Successive returns are apart, every other one is not."""

    def spoil(self, obs: Any, *rest: Any) -> Any:
        self.buffers = [*getattr(self, "buffers", []), obs][:2]
        self.buffers.reverse()
        self.buffers[0][:] = obs
        return self.buffers[0], *rest


class KeptActions(Ours):
    """The voltage is that of this step and the last one, which still belongs to the caller."""

    def step(self, actions: Any) -> Any:
        last, self.last = getattr(self, "last", actions), actions
        return super().step(0.5 * (actions + last))


class ReturnedActions(Ours):
    def step(self, actions: Any) -> Any:
        *returned, infos = super().step(actions)
        return *returned, {**infos, "action": actions, "_action": np.ones(self.num_envs, np.bool_)}


class ChangedActions(Ours):
    def step(self, actions: Any) -> Any:
        actions *= 0.5
        return super().step(actions)


class SeedFromOne(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        return super().reset(seed=seed + 1 if isinstance(seed, int) else seed, options=options)


class Reseeding(Ours):
    """Mutants that give the worlds other seeds."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if seed is not None:
            given = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else list(seed)
            seed = self.turn(given)
        return super().reset(seed=seed, options=options)

    def turn(self, seeds: list[int]) -> list[int]:
        raise NotImplementedError


class SeedByPlace(Reseeding):
    def turn(self, seeds: list[int]) -> list[int]:
        return [10 * seed + place for place, seed in enumerate(seeds)]


class SeedBySum(Reseeding):
    def turn(self, seeds: list[int]) -> list[int]:
        return [1000 * sum(seeds) + seed for seed in seeds]


class SharedSeeds(Reseeding):
    def turn(self, seeds: list[int]) -> list[int]:
        return [seed // 2 for seed in seeds]


class NextSeedNextEpisode(Ours):
    """An unseeded reset takes the next seed, which is the first episode of the neighbour."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.first = self.first + 1 if seed is None else seed
        return super().reset(seed=self.first, options=options)


class ResetsAll(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if options and not options["reset_mask"].any():
            raise ValueError("no world chosen")
        return super().reset(seed=seed)


class ResetsOneMore(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if options and options["reset_mask"].any():
            options = {"reset_mask": options["reset_mask"] | np.roll(options["reset_mask"], 1)}
        return super().reset(seed=seed, options=options)


class MovesOthers(Ours):
    """A partial reset shows the others as they are and moves them all the same."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        shown = super().reset(seed=seed, options=options)
        if options is not None:
            super().reset(options={"reset_mask": ~options["reset_mask"]})
        return shown


class SeedsNotWithMask(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        return super().reset(seed=None if options else seed, options=options)


class SeedsReachAll(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        returned = super().reset(seed=seed, options=options)
        if seed is not None and not isinstance(seed, int):
            words = self.batch.get_state()
            words["words"][:, 0] = seed
            self.batch.set_state(words)
        return returned


class TakesMask(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        returned = super().reset(seed=seed, options=options)
        if options:
            options.pop("reset_mask")
        return returned


class ClearsMask(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        returned = super().reset(seed=seed, options=options)
        if options:
            options["reset_mask"][:] = False
        return returned


class EmptyMask(Ours):
    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if options and not options["reset_mask"].any():
            return self.observation_space.sample(), {}
        return super().reset(seed=seed, options=options)


class NoBegin(Ours):
    def step(self, actions: Any) -> Any:
        if not self.batch.get_state()["seeded"].any():
            self.reset(seed=0)
        return super().step(actions)


class NeverClosed(Ours):
    def close(self, **keywords: Any) -> None:
        """Leave everything as it is."""


class LastEnd(Ours):
    """Mutants of the step after an end."""

    def step(self, actions: Any) -> Any:
        before = getattr(self, "ended", np.zeros(self.num_envs, np.bool_))
        self.given = actions
        returned = super().step(actions)
        self.ended = returned[2] | returned[3]
        return self.after(before, *returned)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.ended = np.zeros(self.num_envs, np.bool_)
        return super().reset(seed=seed, options=options)

    def after(self, before: Any, *returned: Any) -> Any:
        raise NotImplementedError


class RewardAtReset(LastEnd):
    def after(self, before: Any, *returned: Any) -> Any:
        returned[1][before] = -1.0
        return returned


class FlagAtReset(LastEnd):
    def after(self, before: Any, *returned: Any) -> Any:
        returned[3][before] = True
        return returned


class ActionAtReset(LastEnd):
    """The step that resets a world already goes a step with its action, and shows the start."""

    def after(self, before: Any, *returned: Any) -> Any:
        if before.any():
            state = self.batch.get_state()
            self.batch.step(self.given, kernel.NEXT_STEP)
            moved = self.batch.get_state()
            for world in np.flatnonzero(before):
                state["worlds"][0, :, world] = moved["worlds"][0, :, world]
            self.batch.set_state(state)
        return returned


class OldAtReset(LastEnd):
    """The step that resets a world still shows the end."""

    def after(self, before: Any, *returned: Any) -> Any:
        shown = returned[0].copy()
        if before.any():
            shown[before] = self.shown[before]
        self.shown = returned[0]
        return shown, *returned[1:]


class NoFinalObs(Ours):
    def spoil(self, *returned: Any) -> Any:
        return *returned[:-1], {key: part for key, part in returned[-1].items() if "final_obs" not in key}


class NoFinalInfo(Ours):
    def spoil(self, *returned: Any) -> Any:
        return *returned[:-1], {key: part for key, part in returned[-1].items() if "final_info" not in key}


class FullFinalMask(Ours):
    def spoil(self, *returned: Any) -> Any:
        if "_final_obs" in returned[-1]:
            returned[-1]["_final_obs"][:] = True
        return returned


class FullFinalInfoMask(Ours):
    def spoil(self, *returned: Any) -> Any:
        if "_final_info" in returned[-1]:
            returned[-1]["_final_info"][:] = True
        return returned


class FilledFinalObs(Ours):
    def spoil(self, obs: Any, *rest: Any) -> Any:
        infos = rest[-1]
        if "final_obs" in infos:
            for world in np.flatnonzero(~infos["_final_obs"]):
                infos["final_obs"][world] = obs[world].copy()
        return obs, *rest


class NewFinalObs(Ours):
    def spoil(self, obs: Any, *rest: Any) -> Any:
        infos = rest[-1]
        for world in np.flatnonzero(infos.get("_final_obs", ())):
            infos["final_obs"][world] = obs[world].copy()
        return obs, *rest


class NewFinalInfo(Ours):
    def spoil(self, *returned: Any) -> Any:
        infos = returned[-1]
        if "final_info" in infos:
            infos["final_info"]["telemetry"] = infos["telemetry"].copy()
        return returned


class OldSameStep(Ours):
    """The observation of an end is still that of the last step."""

    def spoil(self, obs: Any, *rest: Any) -> Any:
        infos = rest[-1]
        for world in np.flatnonzero(infos.get("_final_obs", ())):
            obs[world] = infos["final_obs"][world]
        return obs, *rest


class NotDisabled(Ours):
    """Worlds that ended restart at the next step, whatever was asked for."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._ended = kernel.NEXT_STEP


class DisabledAtOnce(Ours):
    """Worlds that ended restart in the same step, whatever was asked for."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._ended = kernel.SAME_STEP


MUTANTS: dict[type[Ours], tuple[AutoresetMode, set[str]]] = {
    StringMode: (NEXT_STEP, {"metadata"}),
    OtherMode: (DISABLED, {"metadata"}),
    UnbatchedSpace: (NEXT_STEP, {"spaces"}),
    WideObservations: (NEXT_STEP, {"observations"}),
    DoubleObservations: (NEXT_STEP, {"observations"}),
    WideFinalObservations: (SAME_STEP, {"observations", "autoreset_final_obs"}),
    ColumnRewards: (NEXT_STEP, {"results"}),
    IntegerFlags: (NEXT_STEP, {"results"}),
    NoMask: (NEXT_STEP, {"info_masks"}),
    ShortMask: (NEXT_STEP, {"info_masks"}),
    IntegerMask: (NEXT_STEP, {"info_masks"}),
    ClockedRewards: (NEXT_STEP, {"determinism"}),
    OneBuffer: (NEXT_STEP, {"aliasing_returns"}),
    TwoBuffers: (NEXT_STEP, {"aliasing_returns"}),
    KeptActions: (NEXT_STEP, {"aliasing_inputs"}),
    ReturnedActions: (NEXT_STEP, {"aliasing_inputs"}),
    ChangedActions: (NEXT_STEP, {"aliasing_inputs"}),
    SeedFromOne: (NEXT_STEP, {"seeds_list"}),
    SeedByPlace: (NEXT_STEP, {"seeds_order"}),
    SeedBySum: (NEXT_STEP, {"seeds_company"}),
    SharedSeeds: (NEXT_STEP, {"seeds_streams"}),
    NextSeedNextEpisode: (NEXT_STEP, {"seeds_streams"}),
    ResetsAll: (NEXT_STEP, {"partial_reset"}),
    ResetsOneMore: (NEXT_STEP, {"partial_reset"}),
    MovesOthers: (NEXT_STEP, {"partial_reset"}),
    SeedsNotWithMask: (NEXT_STEP, {"partial_reset_seeds"}),
    SeedsReachAll: (NEXT_STEP, {"partial_reset_seeds"}),
    TakesMask: (NEXT_STEP, {"partial_reset_options"}),
    ClearsMask: (NEXT_STEP, {"partial_reset_options"}),
    EmptyMask: (NEXT_STEP, {"partial_reset_empty"}),
    NoBegin: (NEXT_STEP, {"begun"}),
    NeverClosed: (NEXT_STEP, {"closed"}),
    RewardAtReset: (NEXT_STEP, {"autoreset_result"}),
    FlagAtReset: (NEXT_STEP, {"autoreset_result"}),
    ActionAtReset: (NEXT_STEP, {"autoreset_action"}),
    OldAtReset: (NEXT_STEP, {"autoreset_start"}),
    NoFinalObs: (SAME_STEP, {"autoreset_final_masks"}),
    NoFinalInfo: (SAME_STEP, {"autoreset_final_masks"}),
    FullFinalMask: (SAME_STEP, {"autoreset_final_masks"}),
    FullFinalInfoMask: (SAME_STEP, {"autoreset_final_masks"}),
    FilledFinalObs: (SAME_STEP, {"autoreset_final_masks"}),
    NewFinalObs: (SAME_STEP, {"autoreset_final_obs"}),
    NewFinalInfo: (SAME_STEP, {"autoreset_final_obs"}),
    OldSameStep: (SAME_STEP, {"autoreset_start"}),
    NotDisabled: (DISABLED, {"autoreset_waits"}),
    DisabledAtOnce: (DISABLED, {"autoreset_waits"}),
}


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.__name__)
def test_a_mutant_is_caught_by_the_check_that_it_breaks(mutant: type[Ours]) -> None:
    mode, broken = MUTANTS[mutant]
    report = check(mutant, mode, steps=80)
    assert broken <= report.checks(Outcome.FAILED), str(report)


def test_every_check_has_a_mutant() -> None:
    checked = {finding.check for finding in check(PathFollowingVectorEnv, steps=40).findings}
    assert checked == set().union(*(broken for _, broken in MUTANTS.values()))
