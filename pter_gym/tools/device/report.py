"""The examination of a device, as data and as a page."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

from pter_gym._internal.checks import whole_number
from pter_gym._internal.files import FilePath, expand_path, make_folder, write_text_atomic
from pter_gym._internal.locks import LOCK, locked
from pter_gym._version import __version__
from pter_gym.benchmark import find_policy
from pter_gym.benchmark.boards import Leaderboard, leaderboards
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.benchmark.faults import fault_table, faults
from pter_gym.benchmark.rollout import evaluate, record_episode
from pter_gym.benchmark.scores import ScenarioRun
from pter_gym.benchmark.worst_hand import find_worst
from pter_gym.controllers import AnyPolicy, bind
from pter_gym.errors import ParameterError, unknown_name
from pter_gym.hands import HandSpread, Operator, find_hands
from pter_gym.params import BASELINE, Machine, MachineSpread
from pter_gym.plugins import PICTURES, registered
from pter_gym.policies.tuned import with_gains
from pter_gym.scenarios import PACES, find_scenario
from pter_gym.tasks.path_following import observation_layout
from pter_gym.tools.device.data_sheet import find_device
from pter_gym.tools.device.measures import FREQUENCY, Rendering, measure_rendering
from pter_gym.tools.device.promise import Promise, make_promise
from pter_gym.tools.tuning.search import tune

SCENARIOS = {"standard": "single-dof", "corridor": "impedance", "wall": "impedance"}
"""The scenarios of an examination, and the law that is tuned for each."""

FREE = "free"
"""The policy without voltage: what the device does by itself."""

UNIVERSAL = "universal"
"""The policy for any device."""

GUIDED = "standard"
"""The scenario that decides whether a device guides a hand."""

SEED = 1
"""Seed of the test episodes; the search has other draws."""


@dataclass(frozen=True)
class DeviceReport:
    """Results of an examination.

    Attributes
    ----------
    device, pace
        Name of the device and of the commanded pace.
    rendering, usual
        What it can render, and what PTER can.
    gains
        Tuned gains by scenario.
    boards
        A leaderboard for each scenario: the tuned law, the policy without voltage, a policy trained
        for the device if there is one, and on ``standard`` the one for any device.
    promises
        If the device or the hand is known from a log: for each policy, the error on ``standard``
        promised for the machines and hands that fit the log.
    failing
        On ``standard``, a leaderboard of those but the policy without voltage for each way in which
        a clutch may fail.
    hand
        Name or file of the hand in all episodes, empty for those of the scenarios.
    """

    device: str
    pace: str
    rendering: Rendering
    usual: Rendering
    gains: dict[str, dict[str, float | bool]]
    boards: tuple[Leaderboard, ...]
    promises: tuple[Promise, ...] = ()
    failing: tuple[Leaderboard, ...] = ()
    hand: str = ""

    @property
    def whole_and_failing(self) -> list[Leaderboard]:
        """The leaderboards on ``standard``: of the whole device, and where a clutch fails."""
        return [board for board in self.boards if board.scenario == GUIDED] + [*self.failing]

    @property
    def verdict(self) -> str:
        """What the device is good for, in a sentence."""
        ranked = [
            board.scenario
            for board in self.boards
            if any(standing.rank for standing in board.standings)
        ]
        own, usual = self.rendering.least_steering_n, self.usual.least_steering_n
        pushes = self.boards[0].standings[0].scores["mean_force_n"]
        forces = (
            f"it steers with {own:.3g} N in the worst direction, PTER's clutches with "
            f"{usual:.3g} N; the hand pushes with {pushes:.0f} N"
        )
        if GUIDED in ranked:
            return f"Yes: it keeps the pace on {', '.join(ranked)}; {forces}."
        if own <= 0.0:
            return f"No: {forces}."
        more = f" It would need about {usual / own:.2g} times the torque." if own < usual else ""
        return f"No: {forces}.{more}"

    def as_json(self) -> dict[str, Any]:
        """Return the report as plain data, None for a number that is not finite."""
        content: dict[str, Any] = {
            "version": __version__,
            "device": self.device,
            "pace": self.pace,
            "hand": self.hand,
            "verdict": self.verdict,
            "rendering": asdict(self.rendering),
            "pter": asdict(self.usual),
            "promises": [asdict(promise) for promise in self.promises],
            "gains": self.gains,
            "boards": [board.as_json() for board in self.boards],
            "failing": [board.as_json() for board in self.failing],
        }
        return json.loads(json.dumps(content), parse_constant=lambda _: None)


def examine_device(
    machine: Machine | MachineSpread | str,
    out: FilePath,
    *,
    name: str = "device",
    pace: str = "medium",
    trials: int = 200,
    episodes: int = 100,
    policies: dict[str, AnyPolicy] | None = None,
    hand: Operator | HandSpread | str | None = None,
    on_progress: Callable[[str], None] = lambda _: None,
) -> DeviceReport:
    """Examine a device, and write ``index.html``, ``device.json`` and pictures into a folder.

    Parameters
    ----------
    machine
        The machine, its name, or its file; or a ``MachineSpread``, for which errors are promised.
    out
        The folder, created if necessary.
    name
        What the page calls it.
    pace
        Name of the commanded pace.
    trials
        Gains to try for each law.
    episodes
        Test episodes of each scenario.
    policies
        Further policies to score, by name.
    hand
        A hand for all episodes, instead of those of the scenarios; or a ``HandSpread`` or a file
        that describes one, for which errors are promised.
    on_progress
        Called with what is being done.

    Raises
    ------
    ParameterError
        If there is no such machine, hand or pace, or a number is out of range.
    DependencyError
        If Optuna, which searches for gains, is not installed.
    """
    device = find_device(machine) if isinstance(machine, str) else machine
    own = device.machine if isinstance(device, MachineSpread) else device
    if pace not in PACES:
        raise unknown_name("pace", pace, PACES)
    trials, count = whole_number("trials", trials), whole_number("episodes", episodes)
    make_folder(out)
    folder = expand_path("out", out)
    guiding = {**_for_any(own), **(policies or {})}
    gains: dict[str, dict[str, float | bool]] = {}
    runs: list[ScenarioRun] = []
    failing: list[ScenarioRun] = []
    tuned: dict[str, AnyPolicy] = {}
    for scenario, law in SCENARIOS.items():
        on_progress(f"tuning {law} for {scenario}")
        storage = folder / "gains.journal"
        found = tune(law, scenario, pace, trials=trials, storage=storage, machine=own, hand=hand)
        gains[scenario] = found.gains
        tuned[scenario] = with_gains(law, found.gains)
        named = {f"{law}-tuned": tuned[scenario], FREE: find_policy(FREE)}
        named |= guiding if scenario == GUIDED else (policies or {})
        some = find_episodes(scenario, pace, SEED, own, hand).first(count)
        for title, policy in named.items():
            run = ScenarioRun(scenario, pace, title, 0, SEED, some.strata, evaluate(policy, some))
            if scenario == GUIDED and title != FREE:
                on_progress(f"searching for the worst hand for {title}")
                worst = find_worst(policy, find_scenario(scenario, device, hand=hand), pace)
                run = replace(run, worst=worst)
                on_progress(f"letting clutches fail under {title}")
                for fault, failure in faults(own).items():
                    scores = evaluate(policy, some.with_task(failures=(failure,)))
                    failed = replace(run, scenario=GUIDED + fault, failures=(failure,))
                    failing.append(replace(failed, scores=scores, worst=None))
            runs.append(run)
    on_progress("measuring forces")
    rendering = measure_rendering(own, tuned["wall"], pace)
    usual = measure_rendering(BASELINE, find_policy("impedance-tuned", "wall"), pace)
    promises: list[Promise] = []
    measured = hand is not None and isinstance(find_hands(hand), HandSpread)
    if measured or isinstance(device, MachineSpread):
        on_progress("drawing what fits the log")
        guiding = {f"{SCENARIOS[GUIDED]}-tuned": tuned[GUIDED], **guiding}
        promises = [
            make_promise(policy, title, device, GUIDED, pace, hand=hand)
            for title, policy in guiding.items()
        ]
    boards = leaderboards(runs), tuple(promises), leaderboards(failing)
    guided = "" if hand is None else hand if isinstance(hand, str) else type(hand).__name__
    report = DeviceReport(name, pace, rendering, usual, gains, *boards, hand=guided)
    on_progress("drawing")
    content = json.dumps(report.as_json(), indent=2, allow_nan=False) + "\n"
    with locked(folder / LOCK):
        pictures = _draw(report, own, tuned, hand, folder)
        write_text_atomic(folder / "device.json", content)
        write_text_atomic(folder / "index.html", page(report, pictures))
    return report


def _for_any(machine: Machine) -> dict[str, AnyPolicy]:
    """Return the policy for any device by its name, if it accepts the machine's clutches."""
    policy = find_policy(UNIVERSAL)
    try:
        bind(policy, machine, observation_layout(machine, "torque"))
    except ParameterError:
        return {}
    return {UNIVERSAL: policy}


def _draw(
    report: DeviceReport,
    own: Machine,
    tuned: dict[str, AnyPolicy],
    hand: Operator | HandSpread | str | None,
    folder: Path,
) -> dict[str, str]:
    """Draw what the installed tools can draw into a folder; return captions by file name."""
    pictures, captions = registered(PICTURES), dict[str, str]()
    if "region" in pictures:
        pictures["region"].load()(own, folder / "forces.png")
        captions["forces.png"] = "Forces that the device can display; its smallest steering force."
    if "film" in pictures:
        for scenario, law in tuned.items():
            draws = find_scenario(scenario, own, hand=hand).draws
            ((machine, task),) = draws.pairs(1, 0, report.pace)
            rows = record_episode(law, machine, task, 0, nominal=own).telemetry
            label = f"{SCENARIOS[scenario]}-tuned"
            pictures["film"].load().write_film(
                machine, task, {label: rows}, folder / f"{scenario}.webp"
            )
            captions[f"{scenario}.webp"] = f"The tuned law on a training episode of {scenario}."
    return captions


ROWS = {
    "least_steering_n": ("Steering force, worst direction of motion", "N"),
    "largest_steering_n": ("Steering force, best direction of motion", "N"),
    "least_resisting_n": ("Force against the motion, worst direction", "N"),
    "largest_resisting_n": ("Force against the motion, best direction", "N"),
    "free_impedance": (f"Impedance without voltage, {FREQUENCY:g} Hz", "N·s/m"),
    "apparent_stiffness": ("Apparent stiffness of a wall", "N/m"),
    "z_width_db": (f"Z-width, {FREQUENCY:g} Hz", "dB"),
}
"""What the page says of each number of ``Rendering``."""

STYLE = (
    ":root{color-scheme:light dark}"
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse;display:block;overflow-x:auto}"
    "td,th{padding:.2rem .8rem;text-align:right;white-space:nowrap}"
    ".text{text-align:left;white-space:normal;min-width:9rem}"
    "img{max-width:100%;background:#fff}figure{margin:1.5rem 0}"
)


def page(report: DeviceReport, pictures: dict[str, str]) -> str:
    """Return the page of a report, with pictures by file name and caption."""
    numbers, usual = asdict(report.rendering), asdict(report.usual)
    rendering = _table(
        ("", report.device, "PTER"),
        [
            (text, _number(numbers[key], unit), _number(usual[key], unit))
            for key, (text, unit) in ROWS.items()
        ],
    )
    hand = f"<p>All episodes have the hand {escape(report.hand)}.</p>" if report.hand else ""
    promises = "".join(f"<p>{escape(promise.sentence)}</p>" for promise in report.promises)
    boards = "".join(map(_board, report.boards))
    head, *rows = map(tuple, fault_table(report.whole_and_failing))
    figures = "".join(
        f'<figure><img src="{escape(name)}" alt="{escape(caption)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for name, caption in pictures.items()
    )
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(report.device)}</title><style>{STYLE}</style>"
        f"<h1>{escape(report.device)}</h1><p>{escape(report.verdict)}</p>{hand}{promises}"
        f"<h2>What it can render</h2>{rendering}"
        f"<h2>Policies, pace {escape(report.pace)}</h2>{boards}"
        "<h2>If a clutch fails</h2><p>Path error on standard [mm], and how many episodes arrive, "
        f"if not all do. The policies are not told what fails.</p>{_table(head, rows)}"
        f"<h2>Pictures</h2>{figures}<p>pter_gym {__version__}; the numbers are in "
        "<a href='device.json'>device.json</a>.</p></html>\n"
    )


def _board(board: Leaderboard) -> str:
    rows = [
        (
            standing.policy,
            _number(1e3 * standing.error.value, "mm"),
            _number(100.0 * standing.scores["completed"], "%"),
            _number(standing.scores["resisting_force_n"], "N"),
            _number(standing.scores["peak_force_n"], "N"),
            str(standing.reason or f"rank {standing.rank}"),
        )
        for standing in board.standings
    ]
    worst = [each.worst.sentence(each.policy) for each in board.standings if each.worst]
    heads = ("policy", "path error", "completed", "resisting force", "peak force", "rank")
    below = "".join(f"<p>{escape(sentence)}</p>" for sentence in worst)
    return f"<h3>{escape(board.scenario)}</h3>{_table(heads, rows)}{below}"


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a table, whose columns of words are set left and those of numbers right."""
    columns = zip(*rows, strict=True)
    kinds = ["" if any(cell[:1].isdigit() for cell in column) else "text" for column in columns]

    def line(tag: str, cells: tuple[str, ...]) -> str:
        pairs = zip(cells, kinds, strict=True)
        texts = (f'<{tag} class="{kind}">{escape(cell)}</{tag}>' for cell, kind in pairs)
        return f"<tr>{''.join(texts)}</tr>"

    return f"<table>{line('th', heads)}{''.join(line('td', row) for row in rows)}</table>"


def _number(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if math.isfinite(value) else "–"
