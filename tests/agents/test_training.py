"""PPO: a resumed training is the uninterrupted one, and what is exported acts."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pter_agents.draws import DEVICES, training_draws, validation_episodes
from pter_agents.exporting import export
from pter_agents.runs import RunFolder
from pter_agents.settings import PARTS, SMOKE, TrainingArguments, arguments_from, load_settings
from pter_gym import load_policy
from pter_gym._commands.main import main
from pter_gym._engine.storage import CONTEXT_WIDTH
from pter_gym.benchmark import Episodes, find_policy
from pter_gym.envs import PathFollowingVectorEnv
from pter_gym.errors import DataError, ParameterError
from pter_gym.hands import HandSpread, HumanArm
from pter_gym.params import BASELINE, Hand
from pter_gym.paths import Circle
from pter_gym.policies import _files, read_policy
from pter_gym.policies._files import encode_policy
from pter_gym.scenarios import PACES

pytestmark = pytest.mark.agents


def arguments(steps: int, algorithm: str = "residual", **changes: object) -> TrainingArguments:
    settings = load_settings(algorithm, **{**SMOKE, **changes})
    return TrainingArguments(
        algorithm=algorithm,
        scenario="standard",
        pace="medium",
        steps=steps * settings.worlds * settings.steps,
        seed=1,
        settings=settings,
        checkpoint_every=1,
        validation_episodes=2,
    )


def test_hands_that_fit_a_log_are_stored_and_drawn() -> None:
    variance = 20.0**2
    hands = HandSpread(hand=HumanArm(), places=("impedance.stiffness",), covariance=((variance,),))
    given = replace(arguments(1), hand=hands)
    assert arguments_from(json.loads(json.dumps(given.as_json()))) == given
    tasks = [task for _, task in training_draws(given).pairs(8)]
    assert len({task.hand.impedance.stiffness for task in tasks}) == 8
    assert all(task.hand.random_phases for task in tasks)


@pytest.mark.long
@pytest.mark.parametrize(
    ("algorithm", "adversary"), [("residual", 0.0), ("residual", 0.5), ("universal", 0.0)]
)
def test_resumed_training_has_the_same_bits(
    algorithm: str, adversary: float, tmp_path: Path
) -> None:
    from pter_agents.ppo import train

    constant = {"learning_rate_end": 1e-3, "deviation_end": 0.3, "adversary": adversary}
    train(arguments(2, algorithm, **constant), tmp_path / "whole")
    train(arguments(1, algorithm, **constant), tmp_path / "parts")
    train(arguments(2, algorithm, **constant), tmp_path / "parts", resume=True)
    (steps, one), (others, two) = (RunFolder(tmp_path / name).load() for name in ("whole", "parts"))
    assert steps == others
    assert one.keys() == two.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, two[name], err_msg=name)
    with pytest.raises(ParameterError, match="reach"):
        train(arguments(2, algorithm, reach=3.0, **constant), tmp_path / "parts", resume=True)
    with (tmp_path / "parts" / "progress.csv").open() as text:
        table = list(csv.DictReader(text))
    assert [int(row["steps"]) for row in table] == sorted(RunFolder(tmp_path / "parts").scores())
    seconds = [float(row["seconds"]) for row in table]
    assert seconds == sorted(seconds)
    assert set(table[0]) == {"seconds", "steps", "pace", "path_error_m", "completed", "ranked"}
    file = export(tmp_path / "whole", tmp_path / "mine", name="mine")
    assert {path.name for path in file.parent.iterdir()} == {"README.md", "mine.safetensors"}
    policy = read_policy(tmp_path / "mine")
    assert policy.about["steps"] == steps
    np.testing.assert_array_equal(policy.layers[0][0].T, one[".weights.policy[0][0]"])


def test_an_adversary_finds_ever_worse_hands_which_become_training_episodes() -> None:
    from pter_agents.adversary import Adversary
    from pter_agents.worlds import JaxWorlds
    from pter_gym.benchmark.worst_hand import path_errors

    given = arguments(1, contexts=64, adversary=0.25)
    adversary, law = Adversary(given), find_policy("single-dof-tuned")
    hands, errors = adversary.begin(), list[float]()
    for steps in range(3):
        pairs = adversary.pairs(hands)
        episodes = Episodes.from_pairs("hands", training_draws(given), pairs, [0] * len(pairs))
        errors.append(float(path_errors(law, episodes).mean()))
        hands = adversary.search(law, hands, steps)
    assert errors == sorted(set(errors))
    assert len(pairs) == 16
    worlds = JaxWorlds(given)
    mixed, plain = (np.asarray(worlds.shared(each).constants) for each in (pairs, ()))
    rows = (each[: 64 * CONTEXT_WIDTH].reshape(64, -1) for each in (mixed, plain))
    mine, own = rows
    assert (mine[48:] != own[48:]).any(axis=1).all()
    np.testing.assert_array_equal(mine[:48], own[[k * 64 // 48 for k in range(48)]])


def test_every_pair_has_another_device_within_what_is_declared() -> None:
    with pytest.raises(ParameterError, match="machine must be left out"):
        replace(arguments(1, "universal"), machine=BASELINE)
    draws = training_draws(arguments(1, "universal"))
    machines = [machine for machine, _ in draws.pairs(64, 5)]
    assert machines == [machine for machine, _ in draws.pairs(64, 5)]
    top = BASELINE.clutch.voltage_max
    torques = np.array([each.clutch.largest.dynamic for each in machines])
    breakaway = np.array([each.clutch.largest.breakaway for each in machines]) / torques
    off_state = np.array([each.clutch.dynamic.off_state for each in machines]) / torques
    lags = np.array([each.clutch.time_constant for each in machines])
    lengths = np.array([each.arm.length_a for each in machines]) / BASELINE.arm.length_a
    scales = np.array([each.clutch_scale for each in machines])
    ratios = (torques[:, None] * scales)[scales > 0.0] / BASELINE.clutch.dynamic.torque(top)
    assert len({*torques}) == len({*lags}) == len({*lengths}) == len(machines)
    assert 0.3 * 0.9 <= ratios.min() < 0.6 < 1.5 < ratios.max() <= 3.0 * 1.11
    assert {*(scales > 0.0).sum(axis=1)} == {2, 3, 4}
    assert 1.0 <= breakaway.min() < 1.1 < 1.4 < breakaway.max() <= 1.5
    assert 0.005 <= lags.min() < 0.02 < 0.15 < lags.max() <= 0.3
    assert 0.0 == off_state.min() < off_state.max() <= 0.1
    hysteresis = np.array([each.clutch.hysteresis for each in machines]) / top
    assert 0.3 < np.mean(hysteresis == 0.0) < 0.7
    assert 0.06 < hysteresis.max() <= 0.08
    assert 0.6 * 0.9 <= lengths.min() < lengths.max() <= 1.5 * 1.11
    interface = read_policy("universal").interface
    assert interface.trained == DEVICES.trained
    assert not any(interface.beyond_training(each) for each in machines)


def test_worlds_with_drawn_devices_act_as_the_policy_bound_to_each_device() -> None:
    import jax
    from jax import numpy as jnp

    from pter_agents.ppo import PPO
    from pter_gym.envs.jax import pair_of

    given = arguments(1, "universal", contexts=16)
    ppo = PPO(replace(given, scenario="all"))
    others = [0.1 * jnp.sin(jnp.arange(x.size)) for x in jax.tree.leaves(ppo.state.weights)]
    changed = jax.tree.map(lambda x: x + others.pop(0).reshape(x.shape), ppo.state.weights)
    ppo.state = ppo.state._replace(weights=changed)
    worlds, policy = ppo.worlds, ppo.policy()
    state = ppo.state.carry.worlds
    means = changed.act(worlds.inputs(state))
    corrected = np.asarray(worlds.env.batch.view.base.corrected(means, state.env.memory.base))
    machines = [machine for machine, _ in worlds.env.batch.pairs]
    pairs = np.asarray(pair_of(state.env.world)).astype(int)
    assert len({*pairs}) > 5
    layout = worlds.env.batch.view.base.policy.layout
    for world, pair in enumerate(pairs):
        bound = policy.bind(machines[pair], layout)
        obs = np.asarray(state.env.memory.latest)[world, :1, : len(layout)]
        volts = bound.act(np.ascontiguousarray(obs), bound.start(1))
        np.testing.assert_allclose(volts[0], corrected[world], atol=1e-3)


@pytest.mark.slow
def test_a_run_ends_with_scores_a_curve_and_the_next_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    from tensorboard.util.tensor_util import make_ndarray

    assert main(["train", "ppo", "--smoke", "--pace", "medium", "--out", str(tmp_path)]) == 0
    *_, scores, law, other, _, _, _, export = capsys.readouterr().out.splitlines()
    assert scores.startswith(str(tmp_path))
    assert [line.split()[0] for line in (law, other)] == [
        "single-dof-tuned",
        "torque-feedback-tuned",
    ]
    assert export.split()[:2] == ["pter", "export"]
    with Image.open(tmp_path / "curve.png") as picture:
        assert picture.width > 500
    ((steps, found),) = RunFolder(tmp_path).scores().items()
    (event,) = EventAccumulator(str(tmp_path)).Reload().Tensors("path_error_m/medium")
    assert (event.step, make_ndarray(event.tensor_proto)) == (
        steps,
        pytest.approx(found["medium"]["path_error_m"]),
    )


def test_a_learning_curve_has_a_column_for_each_pace_and_lines_for_the_laws() -> None:
    from pter_agents.report import learning_curve

    scores = {
        "path_error_m": 0.02,
        "completed": 1.0,
        "mean_pace_error": 0.1,
        "segment_pace_error": 0.2,
    }
    both = {"slow": scores, "brisk": {**scores, "path_error_m": 0.05}}
    figure = learning_curve(
        {1_000_000: both, 2_000_000: both},
        {"law": {pace: {"path_error_m": 0.004} for pace in both}},
    )
    for axes, error in zip(figure.axes[:2], (20.0, 50.0), strict=True):
        reference, mine = (np.asarray(line.get_ydata()).tolist() for line in axes.lines)
        assert reference == pytest.approx([4.0, 4.0])
        assert mine == pytest.approx([error, error])
        assert axes.get_yscale() == "log"


@pytest.mark.long
def test_a_film_shows_the_policy_beside_a_law(tmp_path: Path) -> None:
    from pter_agents.report import film

    with Image.open(
        film(read_policy("ppo-standard"), arguments(1, "ppo"), tmp_path / "film.webp")
    ) as moving:
        assert moving.n_frames > 30


def test_settings_are_checked() -> None:
    with pytest.raises(ParameterError, match="worlds"):
        load_settings("ppo", worlds=3)
    with pytest.raises(ParameterError, match="config"):
        load_settings("ppo", wolds=3)
    with pytest.raises(ParameterError, match=r"hidden.*got \(8.5,\)"):
        load_settings("ppo", hidden=[8.5])
    with pytest.raises(ParameterError, match="imitation must be above 0 with a teacher"):
        load_settings("residual", None, "residual", imitation=0.0)
    with pytest.raises(ParameterError, match="seed"):
        replace(arguments(1), seed=-1)


@pytest.mark.parametrize(("hidden", "most"), [([8] * 8, 1 << 24), ([8], 1000)])
def test_unexportable_trainings_are_refused_at_once(
    hidden: list[int], most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pter_agents.ppo import PPO, train

    monkeypatch.setattr(PPO, "advance", lambda _: pytest.fail("it trains"))
    monkeypatch.setattr(_files, "MAX_FILE", most)
    with pytest.raises(ParameterError, match=r"hidden|layers"):
        train(arguments(1, "ppo", hidden=hidden), tmp_path / "run")
    assert not (tmp_path / "run" / "run.json").exists()


def test_a_diverging_loss_stops_and_names_the_last_good_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pter_agents.ppo import PPO, TrainingDivergedError, train

    advance = PPO.advance

    def diverge(self: PPO) -> None:
        if self.steps:
            raise FloatingPointError("a loss or a weight is not finite")
        advance(self)

    monkeypatch.setattr(PPO, "advance", diverge)
    given = arguments(2, "ppo")
    with pytest.raises(TrainingDivergedError) as stopped:
        train(given, tmp_path / "run")
    steps, path = RunFolder(tmp_path / "run").checkpoints()[-1]
    assert str(path) in str(stopped.value)
    assert steps == given.steps // 2


def test_a_step_is_as_long_as_the_learning_rate_and_a_loss_that_is_not_finite_raises() -> None:
    from pter_agents.ppo import PPO

    model = PPO(arguments(1, "ppo", learning_rate=1e-7, learning_rate_end=1e-7))
    before = model.get_state()
    model.advance()
    state = model.get_state()
    moved = [np.abs(state[name] - old).max() for name, old in before.items() if "weights" in name]
    assert 0.0 < max(moved) < 1e-5
    next(array for name, array in state.items() if ".value" in name)[:] = np.nan
    model.set_state(state, 0)
    with pytest.raises(FloatingPointError):
        model.advance()


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", pytest.param("residual", marks=pytest.mark.long)])
def test_an_exported_policy_acts_as_in_training(algorithm: str) -> None:
    import jax

    from pter_agents.ppo import PPO

    given = arguments(1, algorithm, worlds=4, minibatch=64)
    model = PPO(given)
    state = model.get_state()
    rng = np.random.default_rng(0)
    for name in state:
        if name.startswith(".weights.policy"):
            state[name] = rng.normal(0.0, 0.3, state[name].shape).astype(np.float32)
    model.set_state(state, 0)
    weights, worlds = model.state.weights, model.worlds
    shared = worlds.shared()

    @jax.jit
    def act(state: Any, _: None) -> Any:
        state, step = worlds.step(shared, state, weights.act(worlds.inputs(state)))
        return state, step

    seeds = np.arange(4, dtype=np.uint64)
    begun = worlds.reset(shared, seeds.view(np.uint32).reshape(-1, 2))
    # 32-bit rounding grows where a clutch sticks or is released; in 25 steps it stays below 1e-5
    _, steps = jax.lax.scan(act, begun, length=25)
    env = PathFollowingVectorEnv(
        4,
        scenario=training_draws(given),
        contexts=given.settings.contexts,
        context_seed=given.seed,
        frame_skip=1,
        autoreset_mode="SAME_STEP",
    )
    policy = load_policy(model.policy(), env)
    obs, _ = env.reset(seed=0)
    policy.reset()
    ended = np.zeros(4, np.bool_)
    for t in range(25):
        obs, rewards, terminated, truncated, _ = env.step(policy(obs))
        ended |= terminated | truncated
        np.testing.assert_allclose(steps.rewards[t][~ended], rewards[~ended], atol=1e-4)
    assert not ended.all()


def test_one_process_trains_in_a_folder(tmp_path: Path) -> None:
    from pter_agents.ppo import train

    with RunFolder(tmp_path).lock(), pytest.raises(ParameterError, match="out"):
        train(arguments(1, "ppo"), tmp_path)


@pytest.mark.parametrize("data", [b"", b"\x08" + bytes(7) + b"nonsense"])
def test_a_damaged_checkpoint_is_refused(data: bytes, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with pytest.raises(DataError, match="checkpoint"):
        folder.load()
    path = folder.save(3, {"a": np.ones(4)})
    assert folder.load()[0] == 3
    path.write_bytes(data or path.read_bytes()[:-1])
    with pytest.raises(DataError, match="checkpoint"):
        folder.load()


def test_a_locked_arm_costs_the_same_at_each_commanded_pace() -> None:
    import jax

    from pter_agents.ppo import PPO

    changes = {**SMOKE, "starts": "rest", "persistence": 0.0}
    given = replace(arguments(1, "ppo"), pace="all", settings=load_settings("ppo", **changes))
    s, model = given.settings, PPO(given)
    weights, _, carry = model.state
    weight, bias = weights.policy[-1]
    weights.policy[-1] = weight, bias + 100.0  # 24 V for all clutches
    drawn = np.zeros((150, s.worlds, 4), np.float32)
    _, rows = jax.jit(model.collect)(model.worlds.shared(), weights, carry, drawn, 0.0)
    task = model.worlds.env.batch.task
    each = 5.0 * s.pace + s.effort  # in a path time, at rest with 24 V
    cost = each * PACES["medium"] * task.control_period / task.path.length
    np.testing.assert_allclose(rows.rewards[-1], -s.reward_scale * cost, rtol=2e-5)


def test_voltage_costs_something_for_a_share_of_the_training() -> None:
    from pter_agents.ppo import PPO

    def learned(**changes: float) -> dict[str, np.ndarray]:
        settings = load_settings("ppo", **{**SMOKE, "effort": 20.0, **changes})
        model = PPO(replace(arguments(4, "ppo"), settings=settings))
        model.advance()
        model.advance()
        return model.get_state()

    half, always, never = learned(effort_share=0.25), learned(effort_share=1.0), learned(effort=0.0)
    assert any((half[name] != other).any() for name, other in always.items())
    assert any((half[name] != other).any() for name, other in never.items())
    same = learned(effort_share=0.0)
    assert all((same[name] == other).all() for name, other in never.items())


def test_circles_are_frequent_in_training_and_as_the_scenario_has_them_elsewhere() -> None:
    from pter_agents.draws import draws_for, training_draws
    from pter_gym.scenarios.distributions import Draws

    def share(draws: Draws) -> float:
        return float(np.mean([isinstance(task.path, Circle) for _, task in draws.pairs(150)]))

    for scenario in ("paths", "all"):
        given = replace(arguments(1), scenario=scenario)
        as_drawn, trained = draws_for(scenario, given.pace), training_draws(given)
        if scenario == "all":  # its part that is `paths`; tight bends are circles anyway
            as_drawn, trained = as_drawn.also[0], trained.also[0]
        assert 2.0 * share(as_drawn) < share(trained)


def test_a_hand_replaces_all_that_a_training_would_draw() -> None:
    hand = HumanArm(impedance=Hand(mass=1.5, damping=12.0, stiffness=222.0), random_phases=True)
    given = replace(arguments(1), scenario="all", hand=hand)
    assert arguments_from(json.loads(json.dumps(given.as_json()))) == given
    assert {task.hand.impedance for _, task in training_draws(given).pairs(60)} == {hand.impedance}
    for episodes in validation_episodes(given).values():
        assert {task.hand.impedance for task in episodes.tasks} == {hand.impedance}


def test_training_on_all_scenarios_knows_each_heading_and_wider_machines() -> None:
    from pter_agents.draws import draws_for

    machines, tasks = zip(*draws_for("all", "all").pairs(1200), strict=True)
    headings = [
        task.path.heading(share * task.path.length) for task in tasks for share in (0.1, 0.5, 0.9)
    ]
    turned = np.mod(np.array(headings) + np.pi / 8, 2.0 * np.pi)
    counts, _ = np.histogram(turned, 8, (0.0, 2.0 * np.pi))
    assert (counts >= 0.03 * len(headings)).all(), counts
    assert max(machine.clutch.time_constant for machine in machines) > 0.3
    assert min(min(machine.clutch_scale) for machine in machines) < 0.6
    assert max(getattr(task.hand, "push", 0.0) for task in tasks) > 95.0


def test_no_training_has_the_hands_of_the_validation() -> None:
    own = replace(arguments(1), scenario="hands", validation_episodes=8)
    (episodes,) = validation_episodes(own).values()
    assert len({task.hand for task in episodes.tasks}) == 8
    for seed in (0, 1, 2**31 - 1):  # the largest that a training accepts
        trained = {task.hand for _, task in training_draws(own).pairs(8, seed)}
        assert trained.isdisjoint(task.hand for task in episodes.tasks)


def test_advantages_are_those_of_a_plain_loop() -> None:
    from pter_agents.ppo import RolloutBuffer, estimate

    rng, (steps, worlds) = np.random.default_rng(0), (20, 5)
    rewards, finals = rng.standard_normal((2, steps, worlds)).astype(np.float32)
    values = rng.standard_normal((steps + 1, worlds)).astype(np.float32)
    ends = rng.random((steps, worlds)) < 0.2
    expected = np.zeros((steps, worlds))
    for world in range(worlds):
        later = 0.0
        for t in reversed(range(steps)):
            after = finals[t, world] if ends[t, world] else values[t + 1, world]
            missed = rewards[t, world] + 0.9 * after - values[t, world]
            later = missed + (0.0 if ends[t, world] else 0.9 * 0.8 * later)
            expected[t, world] = later
    none: Any = None
    rows = RolloutBuffer(none, none, none, *map(np.asarray, (rewards, ends, finals)))
    np.testing.assert_allclose(estimate(rows, values, 0.9, 0.8), expected, atol=1e-5)


def test_the_loss_is_that_of_a_plain_loop() -> None:
    from pter_agents.ppo import PPO, Samples

    model = PPO(arguments(1, "ppo"))
    s, weights, rng, deviation = model._settings, model.state.weights, np.random.default_rng(0), 0.3
    inputs = rng.standard_normal((64, len(weights.value[0][0]))).astype(np.float32)
    drawn = rng.standard_normal((64, 4)).astype(np.float32)
    means, values = np.asarray(weights.act(inputs)), np.asarray(weights.value_of(inputs))
    targets = means + deviation * (drawn + 0.3 * rng.standard_normal((64, 4))).astype(np.float32)
    advantages, returns = rng.standard_normal((2, 64)).astype(np.float32)
    gains, missed = list[float](), list[float]()
    for k in range(64):
        now, then = -0.5 * ((targets[k] - means[k]) / deviation) ** 2, -0.5 * drawn[k] ** 2
        ratio = float(np.exp((now - then).sum()))
        bounded = min(max(ratio, 1.0 - s.clip), 1.0 + s.clip)
        gains.append(min(ratio * advantages[k], bounded * advantages[k]))
        missed.append((values[k] - returns[k]) ** 2)
    samples: Any = Samples(inputs, targets, drawn, advantages, returns)
    expected = s.value_weight * np.mean(missed) - np.mean(gains)
    assert model._loss(weights, samples, deviation, 0.0) == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_a_student_first_imitates_a_teacher_whose_inputs_are_in_any_order(tmp_path: Path) -> None:
    from pter_agents.ppo import PPO, Samples

    given = arguments(1, adversary=0.0)
    untaught = PPO(given)
    rng = np.random.default_rng(0)
    big = untaught.policy()
    layers = tuple(
        (rng.normal(0.0, 0.2, weight.shape).astype(np.float32), bias) for weight, bias in big.layers
    )
    big = replace(big, layers=layers)
    (weight, bias), *others = layers
    count = len(big.interface.inputs)
    backwards = weight.reshape(len(weight), -1, count)[:, :, ::-1].reshape(weight.shape)
    interface = replace(big.interface, inputs=big.interface.inputs[::-1])
    turned = replace(big, interface=interface, layers=((backwards, bias), *others))
    file = tmp_path / "teacher.safetensors"
    file.write_bytes(encode_policy(turned))
    model = PPO(arguments(20, teacher=str(file), imitation=1.0, worlds=16, minibatch=64))
    assert model.worlds.interface == big.interface

    def missed(inputs: Any) -> float:
        values = inputs[:, : big.interface.size].T
        for weight, bias in big.layers[:-1]:
            values = np.tanh(weight @ values + bias[:, None])
        weight, bias = big.layers[-1]
        shown = np.clip(weight @ values + bias[:, None], -1.0, 1.0).T
        return float(np.square(model.state.weights.act(inputs) - shown).mean())

    def now() -> Any:
        return np.asarray(model.worlds.inputs(model.state.carry.worlds))

    inputs = rng.standard_normal((256, model.worlds.size)).astype(np.float32)
    none = np.zeros((256, 4), np.float32)
    samples: Any = Samples(inputs, none, none, np.zeros(256), model.state.weights.value_of(inputs))
    loss = model._loss(model.state.weights, samples, 0.5, 1.0)
    assert loss == pytest.approx(0.5 * 4 * missed(inputs) / 0.5**2, rel=1e-3)
    before = missed(now())
    for _ in range(20):
        model.advance()
    assert missed(now()) < 0.5 * before


def test_a_teacher_has_the_inputs_of_its_student() -> None:
    from pter_agents.ppo import PPO

    with pytest.raises(ParameterError, match="teacher must have the inputs"):
        PPO(arguments(1, teacher="ppo-standard"))
    with pytest.raises(ParameterError, match="teacher must be a trained policy"):
        PPO(arguments(1, teacher="single-dof-tuned"))


def test_noise_lasts_until_an_episode_ends_and_advantages_are_even_over_all_parts() -> None:
    import jax
    from jax.sharding import PartitionSpec as Spec

    from pter_agents.ppo import PART, PPO, RolloutBuffer, estimate

    model = PPO(arguments(1, "ppo", episode=20))
    s, (weights, _, carry) = model._settings, model.state
    drawn = np.random.default_rng(0).standard_normal((50, s.worlds, 4)).astype(np.float32)
    after, rows = jax.jit(model.collect)(model.worlds.shared(), weights, carry, drawn, 0.3)
    noise, ends = np.zeros((s.worlds, 4), np.float32), np.asarray(rows.ends)
    for each, ended in zip(drawn, ends, strict=True):
        noise = np.where(ended[:, None], 0.0, s.persistence * noise + 0.3 * each)
    np.testing.assert_allclose(after.noise, noise, atol=1e-5)
    fresh = np.asarray(rows.targets) - np.asarray(weights.act(rows.inputs))
    np.testing.assert_allclose(fresh, 0.3 * drawn, atol=1e-5)
    assert ends.any(axis=0).all()
    finals = np.asarray(rows.finals)
    assert (finals[~ends] == 0.0).all()
    assert (finals[ends] != 0.0).mean() > 0.5  # the others arrive

    worlds, own = Spec(PART), Spec(None, PART)
    samples = jax.shard_map(
        model._samples_of,
        mesh=model._split.mesh,
        in_specs=(Spec(), worlds, RolloutBuffer(own, own, own, own, own, own)),  # pyright: ignore[reportArgumentType]
        out_specs=worlds,
        check_vma=False,
    )(weights, after, rows)
    values = np.asarray(weights.value_of(rows.inputs))
    last = np.asarray(weights.value_of(model.worlds.inputs(after.worlds)))
    seen = np.concatenate([values, last[None]])
    advantages = np.asarray(estimate(rows, seen, s.discount, s.trace))
    even = (advantages - advantages.mean()) / advantages.std(ddof=1)
    halves = [each.reshape(-1) for each in np.split(even, PARTS, axis=1)]
    np.testing.assert_allclose(samples.advantages, np.concatenate(halves), atol=1e-4)
    halves = [each.reshape(-1) for each in np.split(advantages + values, PARTS, axis=1)]
    np.testing.assert_allclose(samples.returns, np.concatenate(halves), atol=1e-4)


def test_nothing_is_expected_after_a_termination() -> None:
    import jax

    from pter_agents.ppo import PPO

    model = PPO(arguments(1, "ppo", starts="rest", persistence=0.0))
    weights, _, carry = model.state
    weight, bias = weights.policy[-1]
    weights.policy[-1] = weight, bias - 100.0  # 0 V: the arm misses the end of the path
    drawn = np.zeros((150, model._settings.worlds, 4), np.float32)
    _, rows = jax.jit(model.collect)(model.worlds.shared(), weights, carry, drawn, 0.0)
    assert np.asarray(rows.ends).any(axis=0).all()
    assert (np.asarray(rows.finals) == 0.0).all()
