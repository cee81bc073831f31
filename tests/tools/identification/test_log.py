"""Logs as loggers write them: clocks, gaps, names, units, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oracle.experiment import Experiment, record_log
from pter_gym._commands.main import main
from pter_gym.errors import ParameterError
from pter_gym.params import BASELINE
from pter_gym.tools.identification import Log, identify, join_logs, read_log, write_log
from pter_gym.tools.identification.verdict import EXACT
from pter_gym.tools.identification.windows import cut, smooth

HEAD = "t_s,V1,V2,V3,V4,theta_A,theta_B,F_x,F_y"
TIMES = 0.002 * np.arange(5001)


def volts(times: np.ndarray) -> np.ndarray:
    return np.outer(6.0 * (np.floor(times) % 2), [1, 0, 0, 0])


def motion(times: np.ndarray) -> np.ndarray:
    return np.column_stack([0.7 + 0.3 * np.sin(3.0 * times), 2.2 + 0.2 * np.sin(4.0 * times)])


def written(
    folder: Path,
    times: np.ndarray = TIMES,
    origin: float = 0.0,
    head: str = HEAD,
    edit: dict[int, str] | None = None,
) -> Path:
    """A log of known motion and forces at times [s]; ``edit`` replaces lines by number."""
    table = np.column_stack([origin + times, volts(times), motion(times), 20.0 * motion(times)])
    lines = [head, *(",".join(f"{value:.15g}" for value in row) for row in table)]
    for line, text in (edit or {}).items():
        lines[line - 1] = text
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def clock(late: int = 0, wander: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    step = 2.0007e-3 * (1.0 + wander * np.sin(np.linspace(0.0, 6.0, 5000)))
    step[rng.choice(5000, late, replace=False)] += rng.uniform(10e-3, 20e-3, late)
    return np.concatenate([[0.0], np.cumsum(step)])


@pytest.mark.parametrize("origin", [0.0, 1732550400.25, -3e9])
@pytest.mark.parametrize(("late", "wander"), [(0, 0.0), (0, 1e-3), (3, 0.0), (60, 1e-3)])
def test_rows_of_a_loggers_clock_are_interpolated(
    late: int, wander: float, origin: float, tmp_path: Path
):
    times = clock(late, wander)
    log = read_log(written(tmp_path, times, origin))
    clear = log.is_clear(0)
    assert log.interval == pytest.approx(2.0007e-3, rel=1e-3)
    assert log.duration == pytest.approx(times[-1], abs=log.interval)
    assert np.allclose(log.theta[clear], motion(log.times)[clear], atol=1e-5)
    assert np.allclose(log.force[clear], 20.0 * motion(log.times)[clear], atol=1e-3)
    missing = np.array(
        [np.any((times[:-1] < t) & (t < times[1:]) & (np.diff(times) > 0.01)) for t in log.times]
    )
    assert clear[missing].sum() <= late  # the ends of gaps
    charge = np.cumsum(log.interval * log.volts, axis=0)[-2]
    assert charge == pytest.approx(np.diff(times) @ volts(times)[:-1], abs=12.1 * log.interval)


def test_windows_with_gaps_are_left_out(tmp_path: Path):
    times = np.delete(TIMES, np.s_[2250:2260])  # from 4.5 to 4.52 s, while no voltage changes
    log = read_log(written(tmp_path, times))
    windows = cut(log, smooth(log), BASELINE, 0.08)
    assert np.flatnonzero(~windows.used).tolist() == [22]
    assert windows.gaps == 1
    assert any("4.5" in remark for remark in log.remarks)


def test_a_voltage_that_changed_in_a_gap_is_uncertain_until_it_has_settled(tmp_path: Path):
    log = read_log(written(tmp_path, np.delete(TIMES, 2500)))
    assert np.flatnonzero(~log.is_clear(0)) * log.interval == pytest.approx(
        np.arange(4.998, 5.502, 0.002)[1:], abs=1e-9
    )


@pytest.mark.smoke
def test_names_units_blanks_and_missing_columns(tmp_path: Path):
    head = HEAD.replace("theta_A", "thetaA").replace("V3", "spare")
    path = written(
        tmp_path, head=head, edit={k: f"{0.002 * (k - 2)},0,0,0,0,,,," for k in range(3, 400, 2)}
    )
    log = read_log(path, columns={"theta_A": "thetaA"}, degrees=True, relative_b=True)
    theta_a, theta_b = np.radians(motion(log.times)).T
    assert np.allclose(log.theta, np.column_stack([theta_a, theta_a + theta_b]), atol=1e-6)
    assert not log.volts[:, 2].any()
    assert any("V3" in remark for remark in log.remarks)


def test_joined_logs_are_one(tmp_path: Path):
    """At the coarser interval, with half a second between them that is not measured."""
    fine, coarse = read_log(written(tmp_path)), read_log(written(tmp_path, TIMES[::4]))
    log = join_logs([fine, coarse])
    begin = len(coarse.theta) + round(0.5 / 0.008)
    assert log.interval == pytest.approx(0.008)
    assert np.allclose(log.theta[begin:], coarse.theta)
    assert np.allclose(log.theta[: len(coarse.theta)], coarse.theta, atol=1e-6)
    assert np.allclose(log.volts[: len(coarse.theta)], volts(TIMES[::4]))
    assert log.unmeasured.tolist() == list(range(len(coarse.theta), begin))
    gappy = join_logs([fine, replace(coarse, unmeasured=np.array([3, 4]))])
    assert gappy.unmeasured.tolist() == [*log.unmeasured.tolist(), begin + 3, begin + 4]
    higher = join_logs([fine, replace(coarse, volts=coarse.volts + 0.5)])
    assert (higher.volts[log.unmeasured] == coarse.volts[0] + 0.5).all()
    with pytest.raises(ParameterError, match="log"):
        join_logs([])


def test_a_log_is_read_as_it_was_written(tmp_path: Path):
    log = record_log(BASELINE, Experiment(levels=(6.0,)))
    write_log(log, tmp_path / "log.csv")
    again = read_log(tmp_path / "log.csv")
    assert again.remarks == ()
    for name in ("volts", "theta", "force"):
        assert np.allclose(getattr(again, name), getattr(log, name), rtol=1e-8)


def test_a_large_file_is_read(tmp_path: Path):
    path = written(tmp_path)
    lines = path.read_text("utf-8").splitlines()
    path.write_text("\n".join(line + " " * 4000 for line in lines), "utf-8")
    assert path.stat().st_size > 1 << 24
    assert len(read_log(path).theta) == len(TIMES)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"head": HEAD.replace("F_y", "F_z")}, "F_y"),
        ({"head": HEAD.replace("V", "U")}, "V1"),
        ({"edit": {9: "0.014,0,0,0,0,x,2.2,1,1"}}, "line 9.*theta_A"),
        ({"edit": {9: "0.014,-0.1,0,0,0,0.7,2.2,1,1"}}, "line 9.*V1"),
        ({"edit": {9: "0.011,0,0,0,0,0.7,2.2,1,1"}}, "line 9.*t_s"),
        ({"edit": {9: ",0,0,0,0,0.7,2.2,1,1"}}, "line 9.*t_s"),
        ({"edit": {9: "0.014,0,0,0,0,0.7,9.0,1,1"}}, "theta_B"),
        ({"times": TIMES[:100]}, "t_s"),
        ({"times": TIMES[::9]}, "t_s"),
        ({"times": TIMES[:0]}, "rows"),
    ],
)
def test_an_invalid_log_is_refused(arguments: dict, said: str, tmp_path: Path):
    with pytest.raises(ParameterError, match=said):
        read_log(written(tmp_path, **arguments))


def rows_of_text(separator: str = ",", decimal: str = ".") -> str:
    table = np.column_stack([TIMES, volts(TIMES), motion(TIMES), 20.0 * motion(TIMES)])
    lines = [separator.join(f"{v:.9g}".replace(".", decimal) for v in row) for row in table]
    return "\n".join([HEAD.replace(",", separator), *lines]) + "\n"


PLAIN = rows_of_text()
LINES = PLAIN.split("\n")

TEXTS: dict[str, str | bytes] = {
    "tabs": rows_of_text("\t"),
    "blanks": rows_of_text(" "),
    "semicolons and decimal commas": rows_of_text(";", ","),
    "tabs and decimal commas in UTF-16": rows_of_text("\t", ",").encode("utf-16"),
    "sep=;": "sep=;\n" + rows_of_text(";"),
    "a semicolon in a comment": "# Monday; cold\n" + PLAIN,
    "a comment between rows": PLAIN.replace("\n" + LINES[50], "\n# marker\n" + LINES[50]),
    "NaN": PLAIN.replace(LINES[50], ",".join([*LINES[50].split(",")[:7], "NaN", "nan"])),
    "a line of units": PLAIN.replace("\n", "\ns,V,V,V,V,rad,rad,N,N\n", 1),
    "a comma after the last number": PLAIN.replace("\n", ",\n").replace("F_y,\n", "F_y\n"),
    "NUL bytes at the end": PLAIN.encode() + bytes(512),
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_tables_of_other_programs_are_read(text: str | bytes, tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    log = read_log(path)
    assert len(log.theta) == len(TIMES)
    assert np.allclose(log.theta, motion(TIMES), atol=1e-6)
    assert np.allclose(log.volts, volts(TIMES))


@pytest.mark.parametrize(("size", "unit"), [(1e3, "milli"), (1e6, "micro"), (1e9, "nano")])
@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_units_of_stamps_are_told_by_their_interval(
    size: float, unit: str, origin: float, tmp_path: Path
):
    table = np.column_stack([TIMES, volts(TIMES), motion(TIMES), 20.0 * motion(TIMES)])
    stamps = np.round(size * (origin + TIMES)).astype(np.int64)
    lines = [f"{t}," + ",".join(f"{v:.9g}" for v in row[1:]) for t, row in zip(stamps, table)]  # noqa: B905
    (tmp_path / "log.csv").write_text("\n".join([HEAD.replace("t_s", "t"), *lines]), "utf-8")
    log = read_log(tmp_path / "log.csv")
    assert log.interval == pytest.approx(2e-3, rel=1e-6)
    assert any(f"{unit}seconds" in remark for remark in log.remarks)
    (tmp_path / "log.csv").write_text("\n".join([HEAD, *lines]), "utf-8")
    with pytest.raises(ParameterError, match="t_s must span"):
        read_log(tmp_path / "log.csv")


def test_units_in_names(tmp_path: Path):
    head = HEAD.replace("theta_A", "theta_A [deg]").replace("V1", "V1_mV")
    path = written(tmp_path, head=head)
    log = read_log(path)
    assert np.allclose(log.theta[:, 0], np.radians(motion(TIMES)[:, 0]))
    assert np.allclose(log.volts[:, 0], 1e-3 * volts(TIMES)[:, 0], atol=1e-6)


def test_degrees_are_converted_once(tmp_path: Path):
    """An angle whose name says deg, and one whose name says nothing."""
    path = written(tmp_path, head=HEAD.replace("theta_A", "theta_A [deg]"))
    log = read_log(path, degrees=True)
    assert np.allclose(log.theta, np.radians(motion(TIMES)))
    path = written(tmp_path, head=HEAD.replace("theta_A", "theta_A/rad"))
    with pytest.raises(ParameterError, match="theta_A is in rad"):
        read_log(path, degrees=True)


def test_what_was_taken_from_names_is_told(tmp_path: Path):
    head = HEAD.replace("theta_A", "joint_states/position[0]").replace("F_x", "Fx/N")
    log = read_log(
        written(tmp_path, head=head), columns={"theta_A": "joint_states/position[0]", "F_x": "Fx/N"}
    )
    assert log.remarks == ("log.csv: theta_A is joint_states/position[0], F_x is Fx/N in N.",)
    assert np.allclose(log.theta, motion(TIMES))


def test_a_line_of_units_with_one_unknown_is_named(tmp_path: Path):
    (tmp_path / "log.csv").write_text(PLAIN.replace("\n", "\ns,V,V,V,V,rad,gon,N,N\n", 1), "utf-8")
    with pytest.raises(ParameterError, match="theta_B must be in rad, mrad, deg, not in gon"):
        read_log(tmp_path / "log.csv")


def test_voltages_a_little_below_zero_are_zero(tmp_path: Path):
    log = read_log(written(tmp_path, edit={9: "0.014,-0.001,0,0,0,0.7126,2.2112,14.2,44.2"}))
    assert log.volts.min() == 0.0
    assert any("V1 is below 0 V" in remark for remark in log.remarks)


def stamped(stamps: np.ndarray, folder: Path, name: str = "t_s") -> Log:
    """Rows at even times of which the logger has stamped some together."""
    path = written(folder, head=HEAD.replace("t_s", name))
    head, *lines = path.read_text("utf-8").split()
    lines = [f"{t:.10g},{line.split(',', 1)[1]}" for t, line in zip(stamps, lines, strict=True)]
    path.write_text("\n".join([head, *lines]), "utf-8")
    return read_log(path)


def test_a_counter_of_32_bits_goes_on(tmp_path: Path):
    """As Arduino's micros() does after 71.6 minutes."""
    plain = stamped(1e6 * TIMES, tmp_path, "t")
    assert any("microseconds" in remark for remark in plain.remarks)
    wrapped = stamped((1e6 * TIMES + 2**32 - 4e6) % 2**32, tmp_path, "t_us")
    assert np.allclose(wrapped.volts, plain.volts)
    assert wrapped.interval == pytest.approx(2e-3)


K = np.arange(len(TIMES))


@pytest.mark.parametrize(
    "stamps",
    [
        np.round(TIMES, 2),
        np.floor(TIMES / 0.005 + 1e-9) * 0.005,
        np.floor(TIMES / 0.015625 + 1e-9) * 0.015625,
        (K // 4) * 8e-3 + (K % 4) * 2e-5,
        (K // 8) * 16e-3 + (K % 8) * 2e-5,
        (K // 3) * 6e-3 + (K % 3) * 1e-6,
    ],
    ids=["10 ms", "5 ms", "Windows timer", "bursts of 4", "bursts of 8", "bursts of 3"],
)
def test_rows_that_share_a_stamp_are_counted(stamps: np.ndarray, tmp_path: Path):
    log = stamped(stamps, tmp_path)
    assert log.interval == pytest.approx(2e-3, rel=2e-3)
    assert abs(len(log.theta) - len(TIMES)) <= 10
    assert not len(log.unmeasured)
    assert np.abs(log.theta - motion(log.times)).max() < 0.01  # 10 ms of an unknown origin
    switched = np.flatnonzero(np.diff(log.volts[:, 0])) * log.interval
    assert np.allclose(np.diff(switched), 1.0, atol=3e-3)


@pytest.mark.parametrize("apart", [False, True])
def test_each_sensor_may_have_rows_of_its_own(apart: bool, tmp_path: Path):
    """Angles every 2 ms, in one row or two; forces every 4 ms; voltages where they change."""
    lines, applied = [HEAD], volts(TIMES)
    for k, (t, (a, b)) in enumerate(zip(TIMES, motion(TIMES), strict=True)):
        if k == 0 or applied[k, 0] != applied[k - 1, 0]:
            lines.append(f"{t:.7f},{applied[k, 0]:g},0,0,0,,,,")
        pairs = [(f"{a:.9g}", ""), ("", f"{b:.9g}")] if apart else [(f"{a:.9g}", f"{b:.9g}")]
        lines += [f"{t + 1e-5 * j:.7f},,,,,{x},{y},," for j, (x, y) in enumerate(pairs, 1)]
        if k % 2 == 0:
            f, g = 20.0 * motion(np.array([t + 7e-4]))[0]
            lines.append(f"{t + 7e-4:.7f},,,,,,,{f:.9g},{g:.9g}")
    (tmp_path / "log.csv").write_text("\n".join(lines), "utf-8")
    log = read_log(tmp_path / "log.csv")
    assert log.interval == pytest.approx(2e-3, rel=1e-6)
    assert not len(log.unmeasured)
    assert np.allclose(log.theta, motion(log.times), atol=1e-4)
    assert np.allclose(log.force[1:-2], 20.0 * motion(log.times)[1:-2], atol=2e-3)
    switched = np.flatnonzero(np.diff(log.volts[:, 0])) + 1
    assert np.allclose(log.times[switched], np.round(log.times[switched]), atol=4e-3)


def test_one_column_cannot_stand_for_two(tmp_path: Path):
    with pytest.raises(ParameterError, match="columns"):
        read_log(written(tmp_path), columns={"F_y": "F_x"})


def test_a_bad_line_is_refused_as_it_is_read(tmp_path: Path):
    """Without reading the rest, which is no text."""
    with (tmp_path / "log.csv").open("wb") as file:
        file.write((f"{HEAD}\nnothing\n" + PLAIN).encode() + b"\xff" * (1 << 20))
    with pytest.raises(ParameterError, match="line 2"):
        read_log(tmp_path / "log.csv")


def test_a_log_without_information_is_refused(tmp_path: Path):
    log = read_log(written(tmp_path))

    def refused(change: dict, said: str, machine: str = "baseline") -> None:
        with pytest.raises(ParameterError, match=said):
            identify(replace(log, **change), machine)

    refused({"theta": 0.0 * log.theta}, "theta_A")
    refused({"volts": log.volts + 30.0}, "V1 to V4")
    refused({"volts": log.volts + 5.0}, "V3", "two-brakes")


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("lengths", "1", "lengths"),
        ("lengths", "0.5,0.5,0.5", "lengths"),
        ("lengths", "1,-1", "length_b"),
        ("machine", "basline", "baseline"),
        ("columns", "theta_A", "columns"),
        ("columns", "theta=a", "columns"),
    ],
)
def test_the_command_names_what_is_wrong(
    option: str, value: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["identify", str(written(tmp_path)), f"--{option}", value]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.long
def test_an_uneven_log_gives_the_machine_back(tmp_path: Path):
    """A relative angle in degrees, a clock that wanders and loses rows, joined with an even log."""
    machine = replace(
        BASELINE, arm=replace(BASELINE.arm, inertia_a=0.7, inertia_b=0.6, coupling=0.1)
    )
    even = record_log(machine, Experiment(levels=(6.0, 18.0), on=0.7, off=0.2, free=4.0))
    times = clock(12, 1e-3)
    times = times[times <= even.duration]
    at = np.searchsorted(even.times, times + 1e-9, side="right") - 1

    def values(columns: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(times, even.times, column) for column in columns.T])

    theta = np.degrees(values(even.theta)) @ [[1.0, -1.0], [0.0, 1.0]]
    table = np.column_stack([1732550400.25 + times, even.volts[at], theta, values(even.force)])
    np.savetxt(tmp_path / "log.csv", table, "%.15g", ",", header=HEAD, comments="")
    uneven: Log = read_log(tmp_path / "log.csv", degrees=True, relative_b=True)
    found = identify(join_logs([even, uneven]), BASELINE)
    assert found.verdict.grade == EXACT
    told = {finding.quantity.name: finding for finding in found.findings}
    for name in ("inertia_a", "inertia_b"):
        assert told[name].quantity.value == pytest.approx(getattr(machine.arm, name), rel=0.005)
        assert told[name].status == "identified"
    assert told["slope"].quantity.value == pytest.approx(machine.clutch.dynamic.slope, rel=0.01)
