"""``pter train`` and ``pter export``."""

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from pter_gym._commands.arguments import (
    AnyPace,
    AnyScenario,
    EachPace,
    HandName,
    MachineName,
    ScenarioName,
    look_at,
    options,
)
from pter_gym._commands.terminal import conclude, progress_bar, say, waiting
from pter_gym.errors import ParameterError, needs_extra
from pter_gym.policies._files import RUN
from pter_gym.policies.find import kind_of

if TYPE_CHECKING:
    from pter_gym.controllers import AnyPolicy
    from pter_gym.tools.deploy import Source

SMOKE_ROLLOUTS = 3
SMOKE_EPISODES = 8


def train(
    algo: Annotated[Literal["ppo", "residual", "universal"], tyro.conf.Positional],
    scenario: AnyScenario = "standard",
    pace: EachPace = "all",
    steps: int = 20_000_000,
    seed: int = 0,
    out: Path = Path("pter-run"),
    resume: bool = False,
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    smoke: bool = False,
    machine: MachineName = None,
    adversary: bool = False,
    teacher: str = "",
    hand: HandName = None,
) -> None:
    """Train a policy on a scenario's training episodes by PPO.

    At intervals the policy is scored on held-out training episodes. The run's folder holds
    these scores as progress.csv, validation.json and events for TensorBoard, the two newest
    checkpoints and, after the training, curve.png and film.webp, which compare the policy with
    tuned control laws.

    Example: pter train residual --smoke --out residual-run

    Args:
        algo: What to train: the clutch voltages (ppo), or corrections to a law, for PTER
            (residual) or for devices of all kinds (universal).
        scenario: Scenario to train on, or all.
        pace: Commanded pace, or all of them.
        steps: Steps of the environment in all worlds, each of frame_skip control steps.
        seed: Seed of weights, worlds, episodes and actions, at least 0.
        out: Folder of the run, created if necessary; it must not hold another run.
        resume: Continue from the newest checkpoint in the folder; only --steps may differ.
        config: TOML file with hyper-parameters that replace the default ones.
        smoke: Train for a few seconds to check that everything works.
        machine: Name or file of a machine, instead of those that the scenario draws; of a file of
            `pter identify`, all machines that fit the log.
        adversary: Also train on hands that push the policy furthest off the path, which are
            searched again as it learns.
        teacher: Policy with the same inputs, by name or file, which a small network first imitates.
        hand: Name or file of a hand, instead of those that the scenario draws; of a file of `pter
            identify --hand`, all hands that fit the log. See docs/hands.md.
    """
    look_at(machine=machine, hand=hand)
    with waiting("loading"):
        from pter_agents.runs import RunFolder
        from pter_agents.settings import (
            ADVERSARY,
            MIXED_NAME,
            SMOKE,
            TrainingArguments,
            load_settings,
        )
        from pter_gym.hands import find_hands
        from pter_gym.params import find_machines
        from pter_gym.policies.tuned import FALLBACK
        from pter_gym.tools.figures import save

        changes = {**(SMOKE if smoke else {}), **({"adversary": ADVERSARY} if adversary else {})}
        settings = load_settings(algo, config, teacher, **changes)
        episodes = SMOKE_EPISODES if smoke else TrainingArguments.validation_episodes
        arguments = TrainingArguments(
            algorithm=algo,
            scenario=scenario,
            pace=pace,
            steps=SMOKE_ROLLOUTS * settings.worlds * settings.steps if smoke else steps,
            seed=seed,
            settings=settings,
            validation_episodes=episodes,
            machine=None if machine is None else find_machines(machine),
            hand=None if hand is None else find_hands(hand),
        )
        try:
            from pter_agents import exporting, ppo, report
        except ImportError as error:
            raise needs_extra("training", "agents") from error

    with progress_bar() as progress:
        task = progress.add_task(f"{algo}, {scenario}", total=arguments.steps)
        path = ppo.train(
            arguments,
            out,
            resume=resume,
            on_progress=lambda done: progress.update(task, completed=done),
            on_scores=lambda done, scores: say(f"{done:>11,}  {report.in_words(scores)}"),
        )
        progress.remove_task(task)
        progress.add_task("drawing", total=None)
        history, laws = RunFolder(out).scores(), report.law_scores(arguments)
        files = [path, save(report.learning_curve(history, laws), out / "curve.png")]
        if not smoke:
            files.append(report.film(exporting.read_newest(out), arguments, out / "film.webp"))
    say(report.table({str(out): history[max(history)], **laws}))
    scenario = FALLBACK if scenario == MIXED_NAME else scenario
    on = options(scenario=scenario, machine=machine, hand=hand)
    conclude(
        files,
        f"tensorboard --logdir {quote(str(out))}",
        f"pter export {quote(str(out))} --name mine && "
        f"pter benchmark{on} --policies mine {report.COMPARED_LAWS[0]}",
    )


def write_program(source: "Source", folder: Path, prefix: str, *, prove: bool) -> None:
    """Write a policy in C, prove it if wanted, and say how to compile it."""
    from pter_gym.tools.deploy import proof

    program = quote(str(folder / prefix))
    compiled = f"cc -std=c99 -O2 {program}.c {quote(str(folder / 'main.c'))} -o {program}"
    written = source.write(folder, driver=prove)
    if prove:
        with waiting("proving"):
            proven = proof.prove(written, f"{prefix}.c")
        say(str(proven))
    conclude([written], compiled)


def check_targets(given: Mapping[str, bool], **targets: Path | None) -> None:
    """Raise a ParameterError if an option is given without any of the files that it is about."""
    first = next(iter(targets))
    for option, is_given in given.items():
        if is_given and not any(targets.values()):
            shown = "FILE.fmu" if first == "fmu" else "FOLDER"
            raise ParameterError(
                f"{first} must be given with {option}, as in `--{first} {shown} --{option}`"
            )


def is_run(name: str) -> bool:
    """Return whether this is the folder of a training."""
    return (Path(name) / RUN).is_file()


def share(run: str, out: Path | None, name: str | None) -> None:
    """Write a policy with its card."""
    from pter_agents import exporting

    if not is_run(run) and kind_of(run) != "network":
        raise ParameterError(f"c must be given for a law, as in `--c FOLDER`, got {run!r}")
    written = exporting.export(run, out, name=name)
    compared = f"{quote(str(written.with_suffix('')))} single-dof-tuned"
    conclude([written], f"pter benchmark --policies {compared}")


def newest_or_named(run: str, scenario: str) -> "AnyPolicy":
    """Return the newest policy of a run's folder, or the policy of a name."""
    if is_run(run):
        from pter_agents import exporting

        return exporting.read_newest(Path(run))
    from pter_gym.benchmark import find_policy

    return find_policy(run, scenario)


def export(
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN|NAME")] = "",
    name: str | None = None,
    out: Path | None = None,
    c: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    onnx: Annotated[Path | None, tyro.conf.arg(metavar="FILE.onnx")] = None,
    numbers: Literal["double", "float"] = "double",
    weights: Literal["float", "int8"] = "float",
    prefix: str = "pter",
    scenario: ScenarioName = "standard",
    path: Annotated[str, tyro.conf.arg(metavar="NAME|FILE.csv")] = "line",
    machine: MachineName = None,
    prove: bool = False,
    fmu: Annotated[Path | None, tyro.conf.arg(metavar="FILE.fmu")] = None,
    controller: bool = False,
    hand: Annotated[str | None, tyro.conf.arg(metavar="open|NAME")] = None,
    pace: AnyPace = "medium",
    fmi: Literal["3.0", "2.0"] = "3.0",
    platforms: Literal["here", "all"] = "here",
) -> None:
    """Turn a run of `pter train` into a policy to share, or any policy into C, ONNX or an FMU.

    By default, writes a folder with NAME.safetensors, weights without code, and README.md, a model
    card, in the layout of the Hugging Face Hub; nothing is uploaded. With --c, --onnx or --fmu,
    writes only these. An FMU is the simulated arm for Simulink, Modelica and other tools: driven by
    the policy, or, without one, by voltages as inputs.

    Example: pter export residual --c residual-c

    Args:
        run: Folder of a run, or a policy by its name or path; for C also the name of a law, or any
            of these with +detector, which goes on without a clutch that fails.
        name: Name of the policy; by default the algorithm's or its own.
        out: Folder for the policy, created if necessary; by default NAME.
        c: Folder for pter.h, pter.c and main.c, in C99 without libraries, created if necessary.
        onnx: File for the network alone, as an ONNX model.
        numbers: Arithmetic of the C code or of ONNX; double gives the same bits as Python, or in
            ONNX nearly.
        weights: Weights in the C code; int8 takes a quarter of the memory, at some cost in score.
        prefix: Prefix of all names and files in C, so that two policies fit in one program.
        scenario: Scenario whose gains a law uses, and whose test episodes an FMU has.
        path: Path that the C code holds, or that of an FMU's episodes.
        machine: Name or file of the nominal machine, for C, ONNX or an FMU.
        prove: Also write prove.c beside the C code, and prove with Frama-C that no reading makes it
            do anything undefined or command a voltage out of range.
        fmu: File for the arm as a Functional Mock-up Unit (FMI, co-simulation).
        controller: Write the policy alone as an FMU, from sensors to voltages.
        hand: Hand in an FMU's episodes: a library arm or tremor; or open, for the force on the tip
            as an input.
        pace: Commanded pace in an FMU's episodes: slow, medium, brisk, or a speed in m/s.
        fmi: Version of FMI.
        platforms: Platforms of an FMU's binaries; all are Linux, Windows and macOS, and need Zig,
            by `pip install ziglang`.
    """
    trained = is_run(run)
    coded = c is not None or onnx is not None
    arm_alone = fmu is not None and not (run or coded or controller)
    look_at(policies=() if trained or arm_alone else (run,), paces=(pace,), machine=machine)
    check_targets({"weights": weights != "float", "prefix": prefix != "pter", "prove": prove}, c=c)
    check_targets({"path": path != "line"}, c=c, fmu=fmu)
    check_targets({"numbers": numbers != "double"}, c=c, onnx=onnx)
    check_targets({"machine": machine is not None}, c=c, onnx=onnx, fmu=fmu)
    for_fmu = {"controller": controller, "hand": hand is not None, "pace": pace != "medium"}
    for_fmu |= {"fmi": fmi != "3.0", "platforms": platforms != "here"}
    check_targets(for_fmu, fmu=fmu)
    if out is not None and (coded or fmu is not None):
        raise ParameterError("out must be left out with c, onnx or fmu, which say what is written")
    if not coded and fmu is None:
        share(run, out, name)
        return
    policy = newest_or_named(run, scenario) if run else None
    called = name or Path(run).stem
    if fmu is not None:
        from pter_gym.tools.deploy import find_unit

        unit = find_unit(
            policy,
            name=called,
            scenario=scenario,
            pace=pace,
            machine=machine,
            path=None if path == "line" else path,
            hand=hand,
            controller=controller,
            version=fmi,
        )
        with waiting("compiling"):
            made = unit.write(fmu, platforms)
        conclude([made], f"fmpy info {quote(str(made))}")
    if policy is None:
        return
    from pter_gym.tools.deploy import source_of, write_onnx

    source = None
    if c is not None:
        source = source_of(
            policy,
            name=called,
            machine=machine,
            path=path,
            prefix=prefix,
            numbers=numbers,
            weights=weights,
        )
    if onnx is not None:
        made = write_onnx(policy, onnx, name=called, machine=machine, numbers=numbers)
        say(f"wrote {made}")
    if source is not None and c is not None:
        write_program(source, c, prefix, prove=prove)
