"""What 1.0 promises: names, parameters, defaults, ids, commands, columns, keys, protocol, C."""

import difflib
import inspect
import pkgutil
from collections.abc import Callable
from dataclasses import make_dataclass, replace
from pathlib import Path
from struct import Struct
from typing import Any, Literal

import interface  # in docs/make
import pytest

from pter_gym import params, scenarios
from pter_gym._commands import main
from pter_gym.envs import _mixin
from pter_gym.envs._single import PathFollowingEnv
from pter_gym.errors import PterError
from pter_gym.params import ACTUATORS, MACHINES
from pter_gym.scenarios import PACES, variations
from pter_gym.tasks.path_following import STARTS, PathFollowing

Patch = pytest.MonkeyPatch
Change = Callable[[Patch, Path], None]
CHANGES: list[Any] = []
"""Which part of the listing must show a change, and how to make it."""


def change(part: str) -> Callable[[Change], Change]:
    """Register a change of the public interface that a part of the listing must show."""

    def register(make: Change) -> Change:
        CHANGES.append(pytest.param(part, make, id=make.__name__))
        return make

    return register


def lines_of(part: str) -> list[str]:
    """Return the lines of a module, of a command's options or of a function of `formats`."""
    import formats

    kind, _, name = part.rpartition(" ")
    if kind == "module":
        return list(interface.lines_of_module(pkgutil.resolve_name(name)))
    found = formats.options(name) if kind == "command" else getattr(formats, name)()
    return (
        [f"{key}: {' '.join(found[key])}" for key in found] if isinstance(found, dict) else [*found]
    )


def with_signature(patch: Patch, command: str, **changed: inspect.Parameter) -> None:
    """Give a command other parameters in place of those named."""
    function = main.load_command(command)
    known = inspect.signature(function).parameters
    parameters = [changed.get(name, each) for name, each in known.items()]
    hints = {each.name: each.annotation for each in parameters}
    patch.setattr(function, "__annotations__", hints)
    patch.setattr(function, "__signature__", inspect.Signature(parameters), raising=False)


def parameter_of(command: str, name: str) -> inspect.Parameter:
    """Return a parameter of a command."""
    return inspect.signature(main.load_command(command)).parameters[name]


@change("command tune")
def an_option_renamed(patch: Patch, _: Path) -> None:
    with_signature(patch, "tune", trials=parameter_of("tune", "trials").replace(name="tries"))


@change("command tune")
def a_positional_turned_option(patch: Patch, _: Path) -> None:
    with_signature(patch, "tune", law=parameter_of("tune", "law").replace(annotation=str))


@change("command tune")
def another_default_of_an_option(patch: Patch, _: Path) -> None:
    with_signature(patch, "tune", trials=parameter_of("tune", "trials").replace(default=2000))


@change("command record")
def a_choice_less(patch: Patch, _: Path) -> None:
    fewer = parameter_of("record", "level").replace(annotation=tuple[Literal["expert"], ...])
    with_signature(patch, "record", level=fewer)


@change("command benchmark")
def an_alias_less(patch: Patch, _: Path) -> None:
    import formats

    patch.setattr(formats.made, "aliases", lambda _: [])


@change("exit_statuses")
def an_exit_status(patch: Patch, _: Path) -> None:
    patch.setattr(main, "FAILED", 1)


@change("module pter_gym.scenarios")
def the_value_of_a_pace(patch: Patch, _: Path) -> None:
    patch.setattr(scenarios, "PACES", {**PACES, "medium": 0.3})


@change("module pter_gym.params")
def a_machine_renamed(patch: Patch, _: Path) -> None:
    patch.setattr(params, "MACHINES", {f"{name}s": each for name, each in MACHINES.items()})


@change("module pter_gym.params")
def a_number_of_a_machine(patch: Patch, _: Path) -> None:
    patch.setattr(params, "BASELINE", replace(params.BASELINE, delay=0.01))


@change("module pter_gym.params")
def an_actuator_renamed(patch: Patch, _: Path) -> None:
    patch.setattr(params, "ACTUATORS", {f"{name}s": each for name, each in ACTUATORS.items()})


@change("module pter_gym.errors")
def a_base_of_an_error(patch: Patch, _: Path) -> None:
    other = type("DataError", (PterError, ValueError), {"__module__": "pter_gym.errors"})
    patch.setattr("pter_gym.errors.DataError", other)


@change("module pter_gym.params")
def a_literal(patch: Patch, _: Path) -> None:
    patch.setattr(params, "Lag", Literal["normal_force"])


@change("module pter_gym.params")
def the_default_of_a_field(patch: Patch, _: Path) -> None:
    patch.setitem(params.Machine.__init__.__kwdefaults__, "delay", 0.01)


@change("module pter_gym.params")
def a_default_that_is_an_object(patch: Patch, _: Path) -> None:
    patch.setitem(params.Machine.__init__.__kwdefaults__, "arm", params.Arm(length_a=0.5))


@change("module pter_gym.paths")
def a_method_less(patch: Patch, _: Path) -> None:
    patch.delattr("pter_gym.paths.Path.heading")


@change("module pter_gym.benchmark")
def a_threshold(patch: Patch, _: Path) -> None:
    patch.setattr("pter_gym.benchmark.COMPLETION", 0.95, raising=False)


@change("ids")
def how_long_an_action_is_held(patch: Patch, _: Path) -> None:
    patch.setattr(_mixin, "FRAME_SKIP", 4)


@change("ids")
def where_episodes_begin(patch: Patch, _: Path) -> None:
    patch.setattr(_mixin, "STARTS", {**STARTS, "path": STARTS["rest"]})


@change("ids")
def what_a_scenario_draws(patch: Patch, _: Path) -> None:
    others = {**variations.SUITE_DRAWS, "standard": variations.SUITE_DRAWS["hands"]}
    patch.setattr(variations, "SUITE_DRAWS", others)


@change("ids")
def the_reward(patch: Patch, _: Path) -> None:
    task = PathFollowing(reward=replace(PathFollowing().reward, effort=10.0))
    patch.setattr(_mixin, "_task_with", lambda fields: replace(task, **fields))


@change("ids")
def the_largest_number_of_steps(patch: Patch, _: Path) -> None:
    import gymnasium

    patch.setattr(gymnasium.spec("PTER/Standard-v0"), "max_episode_steps", 500)


@change("ids")
def a_test_episode(patch: Patch, folder: Path) -> None:
    import formats

    for file in formats.FOLDER.glob(f"*{formats.EPISODES_ENDING}"):
        (folder / file.name).write_bytes(file.read_bytes()[:-1])
    patch.setattr(formats, "FOLDER", folder)


@change("ids")
def a_keyword_of_environments(patch: Patch, _: Path) -> None:
    import formats

    patch.setattr(formats, "find_view", lambda *, _held=None: None)


@change("infos")
def a_key_of_infos(patch: Patch, _: Path) -> None:
    info = PathFollowingEnv._info

    def renamed(env: Any, telemetry: Any, *, success: bool) -> dict[str, Any]:
        told = info(env, telemetry, success=success)
        return {"success" if key == "is_success" else key: told[key] for key in told}

    patch.setattr(PathFollowingEnv, "_info", renamed)


@change("columns")
def the_time_column_of_logs(patch: Patch, _: Path) -> None:
    import formats

    patch.delitem(formats.LOG_COLUMNS, "t_s")


@change("columns")
def a_heading_of_a_figure(patch: Patch, _: Path) -> None:
    import formats

    patch.setitem(formats.tables.UNITS, "gain", "gain")


@change("columns")
def a_column_of_the_telemetry(patch: Patch, _: Path) -> None:
    from pter_gym.benchmark import results

    fewer = type("", (), {"fields": results.TELEMETRY.fields[:-1]})
    patch.setattr(results, "TELEMETRY", fewer)


@change("keys_of_files")
def a_key_of_a_device(patch: Patch, _: Path) -> None:
    import formats

    names = [each.name for each in formats.fields(formats.Rendering)]
    patch.setattr(formats, "Rendering", make_dataclass("Rendering", [*names, "largest_push_n"]))


@change("keys_of_files")
def an_entry_of_results(patch: Patch, _: Path) -> None:
    from pter_gym.benchmark import results

    patch.setattr(results, "ORIGIN", "made")


@change("keys_of_files")
def an_entry_of_a_machine_file(patch: Patch, _: Path) -> None:
    patch.setattr("pter_gym.params._files.UNCERTAINTY", "spread")


@change("protocol")
def an_answer_over_the_line(patch: Patch, _: Path) -> None:
    import formats

    patch.setattr(formats.session, "ANSWER", Struct("<I4d"))


@change("protocol")
def the_framing(patch: Patch, _: Path) -> None:
    import formats

    patch.setattr(formats.line, "RUN", 253)


@change("c_header")
def a_function_of_c(patch: Patch, folder: Path) -> None:
    import formats

    header = (formats.c_program.STATIC / "pter.h").read_text("utf-8")
    (folder / "pter.h").write_text(header.replace("float volts[4]);", "double volts[4]);"), "utf-8")
    patch.setattr(formats.c_program, "STATIC", folder)


@pytest.mark.agents
@pytest.mark.slow
def test_the_public_interface_is_the_listed_one() -> None:
    """Whoever changes it says so in CHANGELOG.md, and runs `python docs/make/interface.py`."""
    stored = interface.LISTING.read_text("utf-8").splitlines()
    changes = difflib.unified_diff(stored, interface.listing().splitlines(), lineterm="", n=0)
    assert not list(changes)


@pytest.mark.agents
@pytest.mark.parametrize(("part", "make"), CHANGES)
def test_the_listing_shows_a_change(
    part: str, make: Change, monkeypatch: Patch, tmp_path: Path
) -> None:
    before = lines_of(part)
    make(monkeypatch, tmp_path)
    assert lines_of(part) != before
