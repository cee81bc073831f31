"""``pter hil``: a partner at the end of a line, and lines and partners that fail."""

import csv
import os
import re
import shutil
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import Any

import deploy as bench  # in benchmarks
import numpy as np
import pytest

from pter_gym._commands.main import main
from pter_gym._engine.batch import Batch
from pter_gym.benchmark import find_policy
from pter_gym.errors import ParameterError, PartnerError
from pter_gym.params import ACTUATORS, BASELINE, Machine
from pter_gym.scenarios import SCENARIOS
from pter_gym.tasks.path_following import COLUMN, PathFollowing, Sensing, Starts
from pter_gym.tools.deploy import source_of
from pter_gym.tools.hil import session
from pter_gym.tools.hil.command import BANDS, hil
from pter_gym.tools.hil.line import SerialLine, framed, payload_of
from pter_gym.tools.hil.session import ANSWER, GREETING, VERSION, Partner
from pter_gym.tools.identification import rehearsal

LOOP = Path(__file__).parents[3] / "examples" / "serial_loop.c"
NAME = "single-dof-tuned"
PATIENT = 10.0
"""Seconds to wait for an answer, where nothing but the machine's load delays it."""

SAME = "all scores have the same bits"

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no pseudo-terminals")
needs_compiler = pytest.mark.skipif(
    not (shutil.which("cc") or find_spec("ziglang")), reason="no C compiler is installed"
)


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = source_of(find_policy(NAME)).write(tmp_path_factory.mktemp("loop"))
    return str(bench.program(folder, LOOP))


@pytest.mark.parametrize("size", [0, 1, 253, 254, 255, 507, 508, 509, 3596])
def test_a_frame_is_its_payload_unless_a_byte_is_wrong(size: int) -> None:
    random = np.random.default_rng(size)
    for most in (1, 2, 256):  # zeros only, many, few
        payload = random.integers(0, most, size, np.uint8).tobytes()
        frame = bytearray(framed(payload))
        assert frame.count(0) == 1
        assert payload_of(bytes(frame[:-1])) == payload
        frame[random.integers(len(frame) - 1)] ^= int(random.integers(1, 256))
        assert payload_of(bytes(frame[:-1])) is None


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "episodes"), [("standard", 10), ("everything", 3)])
def test_the_partner_in_c_scores_as_python_does(
    scenario: str, episodes: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    loop = bench.program(source_of(find_policy(NAME, scenario)).write(tmp_path), LOOP)
    hil(NAME, str(loop), scenario=scenario, episodes=episodes, deadline=PATIENT)
    printed = capsys.readouterr().out
    assert printed.count(SAME) == episodes
    assert "; 0 of" in printed
    assert ", 0 frames broken" in printed


@needs_compiler
def test_pulses_for_a_hand_are_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In C as in Python, and as the table has them: each from its time on."""
    monkeypatch.setattr(rehearsal, "SECONDS", 30.0)
    table, ride = tmp_path / "pulses.csv", tmp_path / "ride.csv"
    assert main(["identify", "--pulses", str(table), "--seconds", "20"]) == 0
    folder = source_of(find_policy(table)).write(tmp_path / "c")
    hil(str(table), str(bench.program(folder, LOOP)), deadline=PATIENT, csv=ride)
    assert SAME in capsys.readouterr().out
    pulses = np.loadtxt(table, delimiter=",", skiprows=1)
    rows = list(csv.DictReader(ride.read_text().splitlines()))[1:]
    given = np.array([[float(row[f"volts_{k} [V]"]) for k in range(1, 5)] for row in rows])
    at = 0.01 * np.arange(len(rows)) + 1e-9
    expected = pulses[np.searchsorted(pulses[:, 0], at) - 1, 1:]
    np.testing.assert_array_equal(given, np.float32(expected))
    assert len({*map(tuple, given)}) > 2


@needs_compiler
@pytest.mark.slow
@pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="gcc-arm-none-eabi or qemu-system-arm is not installed",
)
def test_the_partner_on_an_emulated_board_scores_as_python_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    board = bench.firmware(source_of(find_policy(NAME)).write(tmp_path), LOOP, serial=True)
    hil(NAME, f"qemu-system-arm {bench.MACHINE} -serial stdio -kernel {board}", deadline=PATIENT)
    assert SAME in capsys.readouterr().out


@needs_compiler
def test_real_time_is_kept_at_a_thousand_steps_per_second(loop: str, tmp_path: Path) -> None:
    table, begun = tmp_path / "ride.csv", time.monotonic()
    hil(NAME, loop, rate=1000.0, real_time=True, pace="brisk", csv=table)
    took = time.monotonic() - begun
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert float(rows[1]["time [s]"]) == 0.001
    assert took > 0.999 * float(rows[-1]["time [s]"])


Answer = Callable[[int, bytes], bytes | None]


def volts(number: int, *values: float) -> bytes:
    return ANSWER.pack(number, *(values or (1.0, 2.0, 3.0, 4.0)))


class Fake(Thread):
    """A partner in this process: ``answers`` turns a number and a payload into bytes to send."""

    def __init__(self, answers: Answer, greeting: bytes) -> None:
        super().__init__(daemon=True)
        self.greeting = greeting
        self.end, self.other = os.openpty()
        self.port, self.answers = os.ttyname(self.other), answers
        self.line = SerialLine(self.port, 115200)
        self.start()

    def run(self) -> None:
        pending = b""
        while True:
            try:
                pending += os.read(self.end, 4096)
            except OSError:
                return
            *frames, pending = pending.split(b"\0")
            for payload in filter(None, map(payload_of, frames)):
                number = struct.unpack_from("<I", payload)[0]
                sent = self.answers(number, payload) if number else framed(self.greeting)
                if sent is None:
                    os.close(self.other)
                    os.close(self.end)
                    return
                os.write(self.end, sent)


def drive(
    answers: Answer,
    deadline: float = PATIENT,
    greeting: bytes = GREETING.pack(0, VERSION),
    machine: Machine = BASELINE,
) -> tuple[Partner, Any, PartnerError | None]:
    """A partner's ride on the line: the partner, the telemetry, and what has ended it."""
    fake = Fake(answers, greeting)
    partner = Partner(fake.line, deadline, real_time=False)
    rows: list[Any] = []
    error = None
    try:
        partner.drive(machine, PathFollowing(pace=0.25), 0, rows)
    except PartnerError as raised:
        error = raised
    fake.line.close()
    return partner, np.array(rows), error


def test_a_broken_or_late_frame_is_skipped_and_the_last_voltages_stay() -> None:
    def answers(number: int, payload: bytes) -> bytes:
        frame = bytearray(framed(volts(number, 0.1 * (number % 7), 0.0, 0.0, 0.0)))
        if number % 5 == 4:
            frame[3] ^= 0x55
            return bytes(frame)
        return b"" if number % 5 == 3 else bytes(frame)

    partner, rows, error = drive(answers, 0.05)
    assert error is None
    steps = np.arange(1, len(rows))
    answered = np.where(steps % 5 == 4, steps - 2, np.where(steps % 5 == 3, steps - 1, steps))
    sent = np.float32(0.1 * (answered % 7))
    late = partner.missed - (steps % 5 == 3).sum() - (steps % 5 == 4).sum()
    assert late >= 0
    assert (np.float32(rows[1:, COLUMN.volts.x1]) == sent).mean() >= 1.0 - 2.0 * late / len(steps)
    assert partner.line.broken == (steps % 5 == 4).sum()


def test_a_first_answer_may_be_late_after_a_slow_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*arguments: Any) -> Any:
        time.sleep(session.SILENCE)
        return Batch(*arguments)

    monkeypatch.setattr(session, "Batch", slow)
    partner, rows, error = drive(lambda k, _: framed(volts(k)) if k > 1 else b"", 0.2)
    assert error is None
    assert partner.missed >= 1
    assert rows[1, COLUMN.volts.x1] == 0.0


@pytest.mark.parametrize("greeting", [GREETING.pack(0, VERSION + 1), ANSWER.pack(0, *4 * [0.0])])
def test_a_partner_of_another_version_is_refused(greeting: bytes) -> None:
    _, rows, error = drive(lambda k, _: framed(volts(k)), greeting=greeting)
    assert f"version {VERSION} of the protocol" in str(error)
    assert len(rows) == 1


def test_the_largest_voltage_is_the_machines() -> None:
    machine = replace(BASELINE, clutch=ACTUATORS["rough-mr-brake"].clutch)
    assert machine.clutch.voltage_max == 12.0
    _, rows, error = drive(
        lambda k, _: framed(volts(k, *[12.1 if k == 3 else 12.0] * 4)), machine=machine
    )
    assert "from 0 to 12, got" in str(error)
    assert len(rows) == 3


def test_a_partner_reads_sensors_with_the_delay_of_the_task() -> None:
    task = PathFollowing(starts=Starts(moving=1.0), sensing=Sensing(delay=2))
    batch = Batch(BASELINE, task, 1)
    rows = [batch.reset([0])[1][0]]
    rows += [batch.step_alone(np.zeros(4))[1] for _ in range(5)]
    theta = [*COLUMN.theta]
    assert not np.array_equal(rows[-1][theta], rows[-3][theta])
    np.testing.assert_array_equal(session.reading_of(batch, rows[-1])[:2], rows[-3][theta])


WRONG: dict[str, tuple[Answer, str]] = {
    "length": (lambda k, _: framed(volts(k) + (b"more" if k == 9 else b"")), "20 bytes.* got 24"),
    "NaN": (lambda k, _: framed(volts(k, *[np.nan if k == 9 else 0.0] * 4)), "numbers from 0 to"),
    "range": (lambda k, _: framed(volts(k, *[24.1 if k == 9 else 0.0] * 4)), "from 0 to 24, got"),
    "silent": (lambda k, _: framed(volts(k)) if k < 9 else b"", "silent for 1 s"),
    "flood": (lambda k, _: framed(volts(k)) if k < 9 else 999 * framed(volts(1)), "silent for"),
    "cut": (lambda k, _: framed(volts(k)) if k < 9 else None, "the line was cut"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_partner_that_fails_ends_the_episode_and_what_was_recorded_stays(what: str) -> None:
    answers, message = WRONG[what]
    _, rows, error = drive(answers, 0.3 if "silent" in message else PATIENT)
    assert re.search(message, str(error))
    assert len(rows) >= 9
    assert np.isfinite(rows[:, COLUMN.time]).all()


def test_a_program_that_ends_is_reported_with_what_was_recorded(
    tmp_path: Path, loop: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "killed.py"
    program.write_text(
        "import os, subprocess, sys, threading\n"
        "child = subprocess.Popen([sys.argv[1]], stdin=0, stdout=subprocess.PIPE)\n"
        "sent = 0\n"
        "while sent < 26 * 50:\n"
        "    data = os.read(child.stdout.fileno(), 26)\n"
        "    sent += os.write(1, data)\n"
        "child.kill()\n"
        "os._exit(9)\n"
    )
    table = tmp_path / "ride.csv"
    with pytest.raises(PartnerError, match=r"cut: .* ended with status 9"):
        hil(NAME, f"{sys.executable} {program} {loop}", csv=table, deadline=PATIENT)
    printed = capsys.readouterr().out
    assert "ended after" in printed
    assert "deadlines missed" in printed
    assert len(table.read_text().splitlines()) > 40


def test_scenarios_with_a_free_band_are_not_offered() -> None:
    tasks = {name: each.draws.varied_task.template for name, each in SCENARIOS.items()}
    assert set(BANDS) == {name for name, task in tasks.items() if task.free_left or task.free_right}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 2000.0}, "rate"),
        ({"deadline": 0.0}, "deadline"),
        ({"episodes": 65}, "episodes"),
        ({"episodes": 0}, "episodes"),
        ({"partner": "./nowhere"}, "partner"),
        ({"partner": ""}, "partner"),
        ({"partner": os.devnull}, "partner"),
        ({"baud": 12345}, "baud"),
        ({"csv": Path("ride.txt")}, "csv"),
        ({"policy": "impedence"}, "policies"),
    ],
)
def test_arguments_are_refused_by_name(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        hil(**{"policy": NAME, "partner": "true", **options})
