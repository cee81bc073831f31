"""Training: what it is told, that it goes on where it stopped, and that nothing breaks what it has."""

import io
import json
import sys
import tomllib
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import MISSING, asdict, fields, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import pter_gym
from pter_gym.benchmark import episodes, run_scenario
from pter_gym.errors import DataError, DependencyError, ParameterError, StorageError
from pter_gym.params import BASELINE

pytestmark = pytest.mark.agents

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from pter_agents import checkpoints as stored  # noqa: E402
from pter_agents import command, exporting, ppo, prepare, retraining, training, worlds  # noqa: E402
from pter_agents.algorithms import ALGORITHMS, FOLDER, load_settings, settings_from  # noqa: E402
from pter_agents.errors import TrainingDivergedError  # noqa: E402
from pter_gym.params._preset import PRESET, format_preset  # noqa: E402
from pter_gym.policies import Neural, read_policy  # noqa: E402
from pter_gym.scenarios._own_machine import find_own  # noqa: E402

SMALL = {"worlds": 16, "steps": 8, "contexts": 4, "hidden": [8], "value_hidden": [8]}
ROLLOUT = 16 * 8
OF_PPO = {"minibatch": 64, "epochs": 2}
OF_SAC = {"minibatch": 32, "updates": 4, "buffer": 300}
SMALL_OF = {"ppo": OF_PPO, "sac": OF_SAC, "tqc": OF_SAC, "recurrent": {**OF_PPO, "lstm": 6}}
"""Hyper-parameters by module, besides those in ``SMALL``; a buffer of 300 is full after two rollouts."""


def small(algorithm: str, **changes: Any) -> Any:
    own = SMALL_OF[ALGORITHMS[algorithm].module.rpartition(".")[2]]
    return settings_from(algorithm, {**asdict(load_settings(algorithm)), **SMALL, **own, "episode": 20, **changes})


def arguments(algorithm: str = "residual", rollouts: int = 4, **changes: Any) -> training.Arguments:
    return training.Arguments(
        algorithm=algorithm,
        scenario="standard",
        pace="all",
        steps=rollouts * ROLLOUT,
        seed=3,
        settings=small(algorithm, **changes),
        checkpoint_every=1,
        validate_every=100,
        validation_episodes=2,
    )


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, (dict, list, tuple)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from leaves(part)
    else:
        yield value


def everything(path: Path) -> list[bytes]:
    """The bytes of all that a checkpoint holds."""
    found = leaves(stored.read_checkpoint(path))
    return [each.numpy().tobytes() if isinstance(each, torch.Tensor) else repr(each).encode() for each in found]


def weights(path: Path) -> list[Any]:
    """The tensors of the networks in a checkpoint."""
    return [each for each in leaves(stored.read_checkpoint(path)["networks"]) if isinstance(each, torch.Tensor)]


def same(one: Path, two: Path) -> bool:
    """Whether the networks in two checkpoints are the same."""
    return all(map(torch.equal, weights(one), weights(two)))


# what it is told


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_each_algorithm_has_one_whole_file(algorithm: str) -> None:
    content = tomllib.loads((FOLDER / f"{algorithm}.toml").read_text(encoding="utf-8"))
    assert content.pop("algorithm") == ALGORITHMS[algorithm]._asdict()
    settings = fields(ALGORITHMS[algorithm].learner.settings)
    asked = {item.name for item in settings if item.default is MISSING}
    assert asked <= set(content) <= {item.name for item in settings}, "weights of the reward have defaults"
    assert asdict(load_settings(algorithm))["worlds"] == content["worlds"]
    assert (load_settings(algorithm).base == "none") == (ALGORITHMS[algorithm].action == "the clutch voltages")


def test_unknown_names_tell_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"algo.*did you mean 'residual'"):
        load_settings("residul")
    file = tmp_path / "some.toml"
    file.write_text("learnig_rate = 1e-3\n")
    with pytest.raises(ParameterError, match=r"config.*did you mean 'learning_rate'"):
        load_settings("ppo", file)
    file.write_text('sensors = "torqe"\n')
    with pytest.raises(ParameterError, match=r"sensors.*did you mean 'torque'"):
        load_settings("ppo", file)
    file.write_text('base = "impedence"\n')
    with pytest.raises(ParameterError, match=r"base.*did you mean 'impedance'"):
        load_settings("ppo", file)
    for name, value in (("scenario", "standrd"), ("pace", "brsk"), ("algorithm", "ppoo")):
        with pytest.raises(ParameterError, match=rf"{name}.*did you mean"):
            replace(arguments(), **{name: value})


@pytest.mark.parametrize(
    ("algorithm", "name", "value", "accepted"),
    [
        ("ppo", "reach", "far", "a finite number and > 0"),
        ("ppo", "start", 1.5, "≤ 1"),
        ("ppo", "worlds", 2.0, "a whole number ≥ 1"),
        ("ppo", "minibatch", 63, "an even divisor of worlds × steps = 128"),
        ("ppo", "hidden", [], "whole numbers from 1 to 1024"),
        ("ppo", "hidden", [1.5], "whole numbers from 1 to 1024"),
        ("ppo", "tracking", -1.0, "≥ 0"),
        ("ppo", "learning_rate", float("nan"), "> 0"),
        ("ppo", "base", 3, "a string"),
        ("ppo", "blind", "torque", "a list of names"),
        ("sac", "privileged", True, "False: all networks see the same here, got True"),
        ("sac", "buffer", 127, "at least worlds × steps = 128, got 127"),
        ("tqc", "dropped", 25, "a whole number from 0 to 24, got 25"),
        ("recurrent", "lstm", 513, "a whole number from 1 to 512"),
        ("recurrent", "minibatch", 1, "a divisor of worlds × steps = 128, above 1, got 1"),
    ],
)
def test_hyperparameters_out_of_range_are_named(algorithm: str, name: str, value: Any, accepted: str) -> None:
    with pytest.raises(ParameterError, match=rf"\.{name} must be .*{accepted}"):
        small(algorithm, **{name: value})


def test_a_file_changes_what_it_names_alone(tmp_path: Path) -> None:
    file = tmp_path / "some.toml"
    file.write_text("tracking = 2.5\n")
    assert load_settings("ppo", file) == replace(load_settings("ppo"), tracking=2.5)
    with pytest.raises(ParameterError, match="cannot be read"):
        load_settings("ppo", tmp_path / "none.toml")
    file.write_text("tracking = ")
    with pytest.raises(ParameterError, match="cannot be read"):
        load_settings("ppo", file)


@pytest.mark.parametrize("changes", [{"steps": 0}, {"seed": 1.0}])
def test_arguments_out_of_range_are_named(changes: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=next(iter(changes))):
        replace(arguments(), **changes)


# the worlds


def test_only_the_value_network_sees_what_is_true() -> None:
    given = replace(arguments(privileged=True), scenario="everything")
    draws = training.make_draws(given, 8)
    interface = prepare.make_interface(given.settings, "everything", draws, 3)
    seen = training.make_training_worlds(given, draws, interface)
    model: Any = training.make_model(given, seen)
    first = torch.as_tensor(seen.reset(1))
    truth = seen.env.batch.truth()
    assert interface.size + 20 < first.shape[1] < interface.size + truth.shape[1], "what never varies is left out"
    assert (first.numpy()[:, interface.size :].std(axis=0) > 0.1).sum() > 20, "machines, tasks and states differ"
    other = first.clone()
    other[:, interface.size :] = 0.0
    with torch.no_grad():
        actions = [model.networks.act(each) for each in (first, other)]
        values = [model.networks.worth(each) for each in (first, other)]
    assert torch.equal(*actions)
    assert not torch.isclose(*values).any()


def test_half_of_the_draws_of_all_scenarios_are_of_everything() -> None:
    drawn = worlds.draws_for("all", "brisk", contexts=15, seed=3).pairs()
    counts = {each: 8 if each == "everything" else 2 for each in worlds.MIXED}
    own = [worlds.draws_for(each, "brisk", contexts=n, seed=3).pairs() for each, n in counts.items()]
    assert drawn == [pair for pairs in own for pair in pairs]


def test_worlds_show_the_interface_and_their_last_observation() -> None:
    settings = arguments(history=[1, 3], averages=[9]).settings
    draws = worlds.draws_for("standard", "all", contexts=4, seed=0, **settings.stated)
    interface = prepare.make_interface(settings, "standard", draws, 0)
    seen = worlds.TrainingWorlds(worlds.make_worlds(draws, 16, 20), interface)
    plain = worlds.make_worlds(draws, 16, 20)
    bound = interface.bind(BASELINE, plain.observation_layout)
    past = bound.begin(16)
    inputs, base = bound.see(plain.reset(seed=1)[0], past)
    assert seen.reset(1).tobytes() == inputs.astype(np.float32).tobytes()
    rng = np.random.default_rng(0)
    returns = np.zeros(16)
    finished: list[float] = []
    ended = 0
    for _ in range(45):
        actions = rng.uniform(-1.0, 1.0, (16, 4)).astype(np.float32)
        step = seen.step(actions)
        obs, rewards, terminated, truncated, infos = plain.step(bound.volts(base, actions))
        done = terminated | truncated
        shown = {
            world: bound.see(np.repeat(infos["final_obs"][world][None], 16, axis=0), deepcopy(past))[0][world]
            for world in np.flatnonzero(done).tolist()
        }
        past.forget(done)
        inputs, base = bound.see(obs, past)
        assert step.inputs.tobytes() == inputs.astype(np.float32).tobytes()
        assert step.rewards.tobytes() == rewards.tobytes()
        assert step.terminated.tobytes() == terminated.tobytes()
        assert step.truncated.tobytes() == truncated.tobytes()
        assert step.ended.tolist() == list(shown)
        returns += rewards
        for row, world in enumerate(shown):
            ended += 1
            assert step.last[row].tobytes() == shown[world].astype(np.float32).tobytes()
            finished.append(returns[world])
            returns[world] = 0.0
    assert ended == 32
    assert seen.finished == pytest.approx(finished)


@pytest.mark.parametrize(
    ("algorithm", "sensors", "blind", "missing"),
    [
        ("ppo", "force", ["force", "pace"], {"force_along", "force_across", "pace"}),
        ("residual", "torque", ["base", "speed_along"], {"base_1", "base_2", "base_3", "base_4", "speed_along"}),
    ],
)
def test_networks_do_not_see_what_they_are_blind_to(
    algorithm: str, sensors: str, blind: list[str], missing: set[str], tmp_path: Path
) -> None:
    given = arguments(algorithm, rollouts=1, sensors=sensors, blind=blind, history=[1])
    training.train(given, tmp_path / "run")
    known, interface = training.RunFolder(tmp_path / "run").read()
    assert known == given
    seeing = arguments(algorithm, rollouts=1, sensors=sensors).settings
    draws = worlds.draws_for("standard", "all", contexts=4, seed=3, **seeing.stated)
    everything = prepare.make_interface(seeing, "standard", draws, 3).inputs
    assert {each.name for each in everything} - {each.name for each in interface.inputs} == missing
    assert set(interface.inputs) < set(everything)
    exporting.export_run(tmp_path / "run", tmp_path / "out", name="mine")
    card = read_policy("mine", tmp_path / "out").card
    assert card.interface.inputs == interface.inputs
    assert {name for name, _, _ in card.observation} >= missing - {f"base_{x}" for x in range(1, 5)}


def test_what_there_is_not_cannot_be_blinded(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"blind.*'forse'.*did you mean 'force'"):
        training.train(arguments("ppo", sensors="force", blind=["forse"]), tmp_path / "run")
    with pytest.raises(ParameterError, match="blind must be among"):
        training.train(arguments("ppo", sensors="torque", blind=["force"]), tmp_path / "run")
    with pytest.raises(ParameterError, match="blind must be among"):
        training.train(arguments("ppo", blind=["base"]), tmp_path / "run")
    with pytest.raises(ParameterError, match="torque feedback needs torque sensors"):
        training.train(arguments("residual", sensors="encoders"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_validation_draws_are_no_training_draws() -> None:
    from pter_agents import validation

    with pytest.raises(ParameterError, match="seed"):
        replace(arguments(), seed=validation.SEED)
    trained = worlds.draws_for("everything", "slow", contexts=3, seed=0).pairs()
    held_out = worlds.draws_for("everything", "slow", contexts=3, seed=validation.SEED).pairs()
    assert not {repr(pair) for pair in trained} & {repr(pair) for pair in held_out}


OPENED: list[str] | None = None
"""Files that were opened, if they are noted."""


def note(event: str, given: Any) -> None:
    if event == "open" and OPENED is not None:
        OPENED.append(str(given[0]))


def test_training_never_reads_the_evaluation_episodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    episodes._decode.cache_clear()
    sys.addaudithook(note)
    opened: list[str] = []
    monkeypatch.setattr(sys.modules[__name__], "OPENED", opened)
    training.train(arguments(rollouts=1), tmp_path / "run")
    exporting.export_run(tmp_path / "run", tmp_path / "out")
    assert any(name.endswith(training.RUN) for name in opened)
    assert not [name for name in opened if name.startswith(str(episodes.FOLDER))]
    episodes.load_episodes("standard", "brisk")
    assert [name for name in opened if name.startswith(str(episodes.FOLDER))]


# it goes on where it stopped


@pytest.mark.parametrize(
    ("algorithm", "changes"),
    [
        ("residual", {"history": [1, 4], "averages": [1, 4], "base": "single-dof-tuned"}),
        ("sac", {}),
        ("recurrent", {}),
    ],
)
def test_a_resumed_run_ends_where_an_uninterrupted_one_does(
    algorithm: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    given = arguments(algorithm, **changes)
    whole = training.train(given, tmp_path / "whole")
    calls: list[int] = []

    def stop(steps: int) -> None:
        calls.append(steps)
        if len(calls) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        training.train(given, tmp_path / "parts", on_progress=stop)
    assert stored.checkpoints(tmp_path / "parts")[-1].name == "checkpoint-128.ckpt"
    (tmp_path / "parts" / ".0123456789abcdef.tmp").write_bytes(b"left by a killed process")
    resumed = training.train(given, tmp_path / "parts", resume=True)
    assert not list((tmp_path / "parts").glob(".*.tmp"))
    assert [path.name for path in stored.checkpoints(tmp_path / "parts")] == [
        "checkpoint-384.ckpt",
        "checkpoint-512.ckpt",
    ]
    scores = json.loads((tmp_path / "parts" / training.PROGRESS).read_text())
    assert {steps: set(row) for steps, row in scores.items()} == {"512": {"slow", "medium", "brisk"}}
    assert (tmp_path / "whole" / "progress.csv").read_text().count("\n") > 3
    assert list((tmp_path / "whole").glob("events.out.tfevents*"))
    assert everything(resumed) == everything(whole)
    assert not same(resumed, stored.checkpoints(tmp_path / "parts")[0])


def test_a_finished_run_that_is_resumed_is_not_touched_and_goes_on_with_more_steps(tmp_path: Path) -> None:
    given = replace(arguments(rollouts=2), validate_every=1)
    last = training.train(given, tmp_path)
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.iterdir()}
    scores = json.loads((tmp_path / training.PROGRESS).read_text())
    done: list[int] = []
    assert training.train(given, tmp_path, resume=True, on_progress=done.append) == last
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in tmp_path.iterdir()} == before
    assert done == [256]
    (tmp_path / training.PROGRESS).write_text(json.dumps({"128": scores["128"]}))
    training.train(given, tmp_path, resume=True)
    assert json.loads((tmp_path / training.PROGRESS).read_text()) == scores, "the last scores were missing"
    training.train(replace(given, steps=3 * ROLLOUT), tmp_path, resume=True)
    after = json.loads((tmp_path / training.PROGRESS).read_text())
    assert list(after) == ["128", "256", "384"]
    assert {steps: after[steps] for steps in scores} == scores


def test_broken_scores_are_refused_before_the_training(tmp_path: Path) -> None:
    training.train(arguments(rollouts=1), tmp_path)
    (tmp_path / training.PROGRESS).write_text('{"128": {"brisk": {"path_error_m": 1.0}}}')
    before = {each: each.read_bytes() for each in tmp_path.iterdir()}
    with pytest.raises(DataError, match=r"validation\.json cannot be read"):
        training.train(arguments(rollouts=2), tmp_path, resume=True)
    with pytest.raises(DataError, match=r"validation\.json cannot be read"):
        exporting.export_run(tmp_path, tmp_path / "policies")
    assert {each: each.read_bytes() for each in tmp_path.iterdir() if each.is_file()} == before


def test_a_folder_that_another_training_holds_is_refused(tmp_path: Path) -> None:
    training.train(arguments(rollouts=1), tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with training.RunFolder(tmp_path).reserve():
        for resume in (True, False):
            with pytest.raises(ParameterError, match=r"^out: another process trains in"):
                training.train(arguments(rollouts=3), tmp_path, resume=resume)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_same_seed_gives_the_same_policy_and_another_another(tmp_path: Path) -> None:
    runs = [
        training.train(replace(arguments(rollouts=2), seed=seed), tmp_path / name)
        for name, seed in (("a", 3), ("b", 3), ("c", 4))
    ]
    assert same(runs[0], runs[1])
    assert not same(runs[0], runs[2])


def test_another_run_in_the_folder_is_refused(tmp_path: Path) -> None:
    training.train(arguments(rollouts=1), tmp_path)
    before = stored.checkpoints(tmp_path)[-1].read_bytes()
    with pytest.raises(ParameterError, match="holds a run already"):
        training.train(arguments(rollouts=1), tmp_path)
    with pytest.raises(ParameterError, match=r"tracking is 500\.0 in the run .* got 2\.0"):
        training.train(arguments(rollouts=2, tracking=2.0), tmp_path, resume=True)
    with pytest.raises(ParameterError, match="seed is 3"):
        training.train(replace(arguments(), seed=5), tmp_path, resume=True)
    with pytest.raises(ParameterError, match="there is no run"):
        training.train(arguments(), tmp_path / "none", resume=True)
    assert stored.checkpoints(tmp_path)[-1].read_bytes() == before


@pytest.mark.parametrize("content", ["[]", '{"algorithm": "ppo"}', "not JSON"])
def test_a_broken_description_of_a_run_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / training.RUN).write_text(content)
    with pytest.raises(DataError, match=r"run\.json"):
        training.train(arguments(), tmp_path, resume=True)


# nothing breaks what it has


def test_a_full_disk_leaves_the_earlier_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    training.train(arguments(rollouts=2), tmp_path)
    before = {path: path.read_bytes() for path in stored.checkpoints(tmp_path)}
    monkeypatch.setattr("os.fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    newest = f"the newest checkpoint is .*checkpoint-{2 * ROLLOUT}.ckpt, from which --resume goes on"
    with pytest.raises(StorageError, match=f"after {2 * ROLLOUT} steps: .* cannot be written: No space left.*{newest}"):
        training.train(arguments(rollouts=4), tmp_path, resume=True)
    monkeypatch.undo()
    assert {path: path.read_bytes() for path in stored.checkpoints(tmp_path)} == before
    assert not list(tmp_path.glob(".*.tmp"))


class Payload:
    """What a pickle would do when it is loaded."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("executed"),)


def flip(data: bytes) -> bytes:
    return data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :]


def written(state: Any) -> bytes:
    content = io.BytesIO()
    torch.save(state, content)
    return sha256(content.getvalue()).digest() + content.getvalue()


DAMAGES: dict[str, Callable[[bytes, Any], bytes]] = {
    "flipped": lambda data, _: flip(data),
    "a pickle": lambda _, state: written({**state, "networks": Payload()}),
    "incomplete": lambda _, state: written({name: part for name, part in state.items() if name != "adam"}),
    "of another network": lambda _, state: written(
        {**state, "networks": {name: tensor[:1] for name, tensor in state["networks"].items()}}
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_checkpoint_is_refused(damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = training.train(arguments(rollouts=1), tmp_path / "run")
    path.write_bytes(DAMAGES[damage](path.read_bytes(), stored.read_checkpoint(path)))
    with pytest.raises(DataError, match=r"checkpoint .* cannot be read"):
        training.train(arguments(rollouts=2), tmp_path / "run", resume=True)
    assert not Path("executed").exists()


@pytest.mark.parametrize(
    ("algorithm", "where", "call"),
    [
        ("residual", "loss", 2),
        ("residual", "gradient", 2),
        ("sac", "loss", 18),
    ],
)
def test_a_number_that_is_not_finite_stops_the_training(
    algorithm: str, where: str, call: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []

    def spoiled(found: Any) -> Any:
        calls.append(1)
        return found * (np.nan if len(calls) == call else 1.0)

    if algorithm == "sac":
        step = worlds.TrainingWorlds.step

        def broken(self: Any, outputs: Any) -> Any:
            found = step(self, outputs)
            return found._replace(rewards=spoiled(found.rewards))

        monkeypatch.setattr(worlds.TrainingWorlds, "step", broken)
    elif where == "loss":
        draw = ppo.PPO._draw

        def drawn(self: Any) -> Any:
            noise, orders = draw(self)
            return spoiled(noise), orders

        monkeypatch.setattr(ppo.PPO, "_draw", drawn)
    else:
        rate = ppo.PPOSettings.learning_rate_at
        monkeypatch.setattr(ppo.PPOSettings, "learning_rate_at", lambda self, done: spoiled(rate(self, done)))
    with pytest.raises(TrainingDivergedError, match=r"last good checkpoint is .*checkpoint-(256|128)\.ckpt"):
        training.train(arguments(algorithm), tmp_path)
    for path in stored.checkpoints(tmp_path):
        assert all(each.isfinite().all() for each in weights(path))


# what comes out


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_an_exported_policy_acts_like_the_run(algorithm: str, tmp_path: Path) -> None:
    training.train(arguments(algorithm, rollouts=2, history=[2], averages=[20]), tmp_path / "run")
    path, difference = exporting.export_run(tmp_path / "run", tmp_path / "out", name="mine")
    assert path.name == "mine.json"
    assert difference <= exporting.SAME
    policy = read_policy("mine", tmp_path / "out")
    assert isinstance(policy, Neural)
    assert policy.card.about["steps"] == 2 * ROLLOUT
    assert (policy.card.interface.base is None) == (ALGORITHMS[algorithm].action == "the clutch voltages")
    text = (tmp_path / "out" / "mine.md").read_text(encoding="utf-8")
    assert policy.card.about["command"] in text


@pytest.mark.parametrize("algorithm", ["ppo", "residual"])
def test_a_policy_is_trained_and_acts_with_decisions_that_are_held(algorithm: str, tmp_path: Path) -> None:
    given = arguments(algorithm, rollouts=2, frame_skip=3)
    training.train(given, tmp_path / "run")
    _, difference = exporting.export_run(tmp_path / "run", tmp_path / "out", name="mine")
    assert difference <= exporting.SAME
    env: Any = gymnasium.make("PTER/Standard-v0")
    policy = pter_gym.load_policy(tmp_path / "out" / "mine.json", env)
    obs, _ = env.reset(seed=0)
    env.step(policy(obs))
    with pytest.raises(ParameterError, match="env must have the frame_skip of the policy, 3, got 1"):
        pter_gym.load_policy(tmp_path / "out" / "mine.json", gymnasium.make("PTER/Standard-v0", frame_skip=1))


def test_a_policy_that_acts_otherwise_is_not_exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    training.train(arguments(rollouts=1), tmp_path / "run")
    exporting.export_run(tmp_path / "run", tmp_path / "out")
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    real = exporting.tensors_of

    def wrong(model: Any) -> Any:
        found = real(model)
        found["layer_1.bias"][0] += 1e-4
        return found

    monkeypatch.setattr(exporting, "tensors_of", wrong)
    with pytest.raises(DataError, match="differs"):
        exporting.export_run(tmp_path / "run", tmp_path / "out")
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_a_run_without_a_checkpoint_cannot_be_exported(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="there is no run"):
        exporting.export_run(tmp_path, tmp_path)
    for path in [training.train(arguments(rollouts=1), tmp_path), *stored.checkpoints(tmp_path)]:
        path.unlink(missing_ok=True)
    with pytest.raises(DataError, match="no checkpoint"):
        exporting.export_run(tmp_path, tmp_path)


def test_a_command_asks_for_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "pter_agents.training")
    monkeypatch.delattr("pter_agents.training")
    for name in ("stable_baselines3", "stable_baselines3.common.logger"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(DependencyError, match=r"pip install -e '\.\[agents\]'"):
        command.train("ppo", smoke=True, out=tmp_path)


def test_a_policy_for_a_machine_of_ones_own_is_whole(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    preset = tmp_path / "own.toml"
    clutch = replace(PRESET.clutch, time_constant=0.05, voltage_max=20.0)
    preset.write_text(
        format_preset(replace(PRESET, clutch=clutch, sensing=replace(PRESET.sensing, delay=0.01)), "own"), "utf-8"
    )
    own = find_own(str(preset))
    given = replace(arguments("residual", rollouts=1), scenario="everything", machine=own, settings=small("residual"))
    for pair in training.make_draws(given, contexts=5).pairs():
        assert (pair[0], pair[1].sensing.delay) == (own.machine, 1)
    training.train(given, tmp_path / "run")
    assert training.RunFolder(tmp_path / "run").read()[0] == given
    preset.unlink()
    with pytest.raises(ParameterError, match=r"machine is .* in the run that is in the folder, got None"):
        training.train(replace(given, machine=None), tmp_path / "run", resume=True)
    exporting.export_run(tmp_path / "run", tmp_path, name="mine")
    policy = read_policy("mine", tmp_path)
    assert policy.card.voltage_max == 20.0
    assert policy.card.about["command"].endswith("--machine FILE")
    with pytest.raises(ParameterError, match="voltage_max must be 20 V"):
        run_scenario("standard", {"mine": policy}, ["brisk"], episodes=1)
    assert retraining.arguments_of(policy.card.about) == given
    monkeypatch.setattr(retraining, "examine", partial(retraining.examine, episodes=2))
    command.retrain(str(tmp_path / "mine.json"), tmp_path / "again")
    shown = capsys.readouterr().out
    assert shown.count("everything, ") == 6
    assert shown.count("mine-again: ") == 3
    again = read_policy("mine-again", tmp_path / "again").card
    assert again.weights_sha256 == policy.card.weights_sha256
