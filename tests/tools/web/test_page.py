"""The page of ``pter play``: pushed in a browser, and compared with Python on the same pushes."""

import http.client
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from pter_gym.params._preset import PRESET, format_preset

from pter_gym._commands.main import main
from pter_gym._engine.batch import Batch
from pter_gym.benchmark.policies import find_policy
from pter_gym.benchmark.rollout import record_episode
from pter_gym.benchmark.scores import score
from pter_gym.errors import ParameterError
from pter_gym.hands import read_forces
from pter_gym.params import BASELINE, MACHINES, Machine, find_machine, machine_of
from pter_gym.paths import Circle
from pter_gym.policies._files import SHIPPED
from pter_gym.scenarios import PACES
from pter_gym.scenarios._variations import WIDTH
from pter_gym.tasks.path_following import TELEMETRY, PathFollowing
from pter_gym.tools.web import site
from pter_gym.tools.web.site import make_server, site_files, write_site
from pter_gym.tools.web.tables import PATHS, pages_batch, tables

CONTROLS = "[...document.querySelectorAll('#control option')].map((option) => option.value)"

WIDE = "document.documentElement.scrollWidth > document.documentElement.clientWidth"

# --- the server ---


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Address of a running ``pter play``."""
    pytest.importorskip("websockets", reason="driving a browser needs websockets")
    import playing

    with playing.started() as found:
        yield found


def answer(address: str, path: str, method: str = "GET") -> tuple[int, str | None, bytes]:
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=10)
    connection.request(method, path)
    response = connection.getresponse()
    found = response.status, response.getheader("Content-Type"), response.read()
    connection.close()
    return found


@pytest.mark.smoke
def test_all_files_of_the_page_are_served(address: str) -> None:
    files = site_files()
    assert {
        "index.html",
        "style.css",
        "page.js",
        "pter.wasm",
        "policies/residual.safetensors",
    } <= set(files)
    for name, file in files.items():
        assert answer(address, f"/{name}")[::2] == (200, file.read_bytes())
    assert answer(address, "/")[:2] == (200, "text/html; charset=utf-8")
    assert answer(address, "/?embedded")[0] == 200
    assert answer(address, "/pter.wasm", "HEAD") == (200, "application/wasm", b"")
    assert answer(address, "/page.js")[1] == "text/javascript; charset=utf-8"


@pytest.mark.parametrize(
    "path",
    ["/../__init__.py", "/%2e%2e/site.py", "//etc/passwd", "/policies/../pter.js", "/package.json"],
)
def test_nothing_else_is_served(path: str, address: str) -> None:
    assert answer(address, path)[0] == 404


@pytest.fixture
def served() -> Iterator[int]:
    """Port of a server in this process."""
    with make_server(allowed_hosts=["Hub.example.org"]) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def ask(port: int, *hosts: str) -> tuple[int, str]:
    """Return the status and the text of the answer to a request with these headers."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.putrequest("GET", "/", skip_host=True)
    for host in hosts:
        connection.putheader("Host", host.format(port=port))
    connection.endheaders()
    response = connection.getresponse()
    found = response.status, response.read().decode()
    connection.close()
    return found


@pytest.mark.parametrize(
    "host",
    [
        "localhost:{port}",
        "LOCALHOST:9000",
        "localhost",
        "127.0.0.1:{port}",
        "[::1]:80",
        "172.17.0.2:{port}",
        "hub.example.org",
    ],
)
def test_this_computer_a_tunnel_and_allowed_names_are_answered(host: str, served: int) -> None:
    assert ask(served, host)[0] == 200


@pytest.mark.parametrize(
    "hosts",
    [
        (),
        ("",),
        ("[::1",),
        ("evil.example:{port}",),
        ("127.0.0.1.evil.example",),
        ("localhost:{port}", "evil.example"),
    ],
)
def test_other_names_are_refused(hosts: tuple[str, ...], served: int) -> None:
    assert ask(served, *hosts)[0] == 421


def test_errors_name_the_option(served: int) -> None:
    assert "--allow-host proxy.example" in ask(served, "Proxy.example:8000")[1]


def test_a_closed_tab_is_silent(served: int, capsys: pytest.CaptureFixture[str]) -> None:
    reset_on_close = struct.pack("ii", 1, 0)
    for _ in range(20):
        with socket.create_connection(("127.0.0.1", served), timeout=10) as tab:
            tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, reset_on_close)
            tab.sendall(b"GET /pter.wasm HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert ask(served, "localhost")[0] == 200
    assert capsys.readouterr().err == ""


def test_a_silent_connection_ends(served: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site._Handler, "timeout", 0.1)
    with socket.create_connection(("127.0.0.1", served), timeout=30) as idle:
        idle.sendall(b"GET / HTTP/1.1\r\n")
        assert idle.recv(1) == b""


def test_a_site_has_all_files(tmp_path: Path) -> None:
    write_site(tmp_path / "push")
    found = {
        path.relative_to(tmp_path / "push").as_posix() for path in (tmp_path / "push").rglob("*.*")
    }
    assert found == set(site_files())
    weights = tmp_path / "push" / "policies" / "residual.safetensors"
    assert weights.read_bytes() == (SHIPPED / "residual.safetensors").read_bytes()


@pytest.mark.parametrize("port", ["-1", "65536"])
def test_a_wrong_port_is_refused(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", "--no-open", "--port", port]) == 2
    assert "port" in capsys.readouterr().err


def test_a_taken_port_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert main(["play", "--no-open", "--port", str(taken.getsockname()[1])]) == 2
    assert "port" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_ctrl_c_ends_it() -> None:
    import playing

    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # not ignored in the background
    command = [sys.executable, "-c", f"{heard}; {playing.PLAY}", "play", "--no-open"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("http://127.0.0.1:")
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=10)
        finally:
            process.kill()
    assert "Traceback" not in told


# --- the page ---


@pytest.fixture(scope="module")
def opened(address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    import browser
    import playing

    program = browser.find_browser()
    if program is None:
        pytest.skip("no Chromium is installed")
    with browser.open_browser(program) as tab:
        yield playing.Play(tab, address, tmp_path_factory.mktemp("downloads"))


@pytest.fixture
def play(opened: Any) -> Iterator[Any]:
    """The page; a test fails on any error that its console tells."""
    yield opened
    assert opened.problems == []


def task_of(path: str, push: Path, pace: str) -> PathFollowing:
    width = {} if path == "line" else {"error_max": WIDTH}
    return PathFollowing(path=PATHS[path], hand=read_forces(push), pace=PACES[pace], **width)


def compare(
    play: Any,
    path: str,
    *,
    pace: str = "medium",
    machine: str = "baseline",
    lag: float,
    friction: float,
) -> Any:
    """Compare the trial on the page with Python: the same push, the same voltages.

    Return its score.
    """
    import playing

    push = play.saved("save-push", "push.csv")
    names, rows = playing.record(play.saved("save-record", "record.csv"))
    assert names == list(TELEMETRY.names)
    begun = find_machine(machine)
    clutch = replace(begun.clutch, time_constant=lag)
    scale = tuple(friction * own for own in begun.clutch_scale)
    task = task_of(path, push, pace)
    batch = Batch(replace(begun, clutch=clutch, clutch_scale=scale), task, 1, sensors="force")
    batch.reset([1])
    found = np.array(rows)
    volts = found[1:, [names.index(f"volts_{n}") for n in range(1, 5)]]
    expected = np.array([batch.step_alone(each[: batch.num_actions])[1] for each in volts])
    np.testing.assert_allclose(found[1:], expected, rtol=1e-7, atol=1e-7)
    scored = score(found, task)
    told = play.run("page.trials[0].result")
    for name, value in told.items():
        assert value == pytest.approx(getattr(scored, name), rel=1e-9), name
    return scored


def shown_millimetres(play: Any) -> str:
    return play.run("document.querySelector('#board [aria-current] td:nth-child(5)').textContent")


@pytest.mark.slow
def test_a_push_by_mouse_is_that_of_python(play: Any) -> None:
    play.open("path=arc&control=single-dof-tuned&lag=60&friction=1.2&material=delrin_experimental")
    play.drag()
    assert "mm off" in play.text("caption")
    scored = compare(play, "arc", machine="delrin_experimental", lag=0.06, friction=1.2)
    assert scored.completed
    assert shown_millimetres(play) == f"{1000 * scored.path_error_m:.1f} mm"
    assert float(play.text("time")) == pytest.approx(scored.duration_s, abs=0.005)
    assert play.text("energy-given") == "0"
    ledger = {
        name: float(play.text(f"energy-{name}"))
        for name in ("hand", "kinetic", "clutches", "rounding")
    }
    assert ledger["hand"] == pytest.approx(scored.hand_work_j, abs=0.006)
    assert ledger["clutches"] == pytest.approx(scored.dissipated_j, abs=0.006)
    assert ledger["hand"] == pytest.approx(
        ledger["kinetic"] + ledger["clutches"] + ledger["rounding"], abs=0.03
    )


@pytest.mark.slow
def test_the_learned_policy_rides_on_the_same_push(play: Any) -> None:
    play.open("path=sine&control=impedance-tuned")
    play.drag()
    push = play.saved("save-push", "push.csv")
    play.until("document.querySelectorAll('#board tbody tr').length === 2")
    row = play.run("document.querySelector('#board tbody tr:not([aria-current])').innerText")
    task, limit = (
        task_of("sine", push, "medium"),
        play.run("page.workshop.timeLimit(page.settings, page.push)"),
    )
    ridden = record_episode(find_policy("residual", scenario="paths"), BASELINE, task, 1, limit)
    assert f"{1000 * score(ridden.telemetry, task).path_error_m:.1f} mm" in row
    assert play.saved("save-board", "scores.png").read_bytes().startswith(b"\x89PNG")


def test_a_dot_keeps_the_pace(play: Any) -> None:
    play.open("path=arc&pace=brisk")
    path, pace = PATHS["arc"], PACES["brisk"]
    sagitta = (path.length / 200) ** 2 * path.max_curvature / 8  # of the page's 200 chords
    for part in (0.0, 0.37, 1.0, 2.0):
        found = play.run(f"page.trials[0].paced({part * path.length / pace})")
        np.testing.assert_allclose(
            found["at"], path.point(min(part, 1.0) * path.length), atol=1.01 * sagitta
        )


def test_an_arm_on_which_clutches_slip_is_not_called_free(play: Any) -> None:
    play.open("control=sliders&volts=4,4,0,0")
    start = play.handle()
    play.mouse("mousePressed", *start)
    seen: set[tuple[str, str]] = set()
    for k in range(50):
        play.mouse("mouseMoved", start[0] + 6 * k, start[1] - 2 * k)
        play.run("page.readout.show(page.trials[0])")
        seen.add(
            (
                play.text("mode"),
                str(play.run("[0, 1, 2, 3].map((k) => page.trials[0].clutch(k)).join(' ')")),
            )
        )
    play.mouse("mouseReleased", *start)
    assert any("slipping" in states for _, states in seen)
    assert all(
        (mode == "free to move") == ("s" not in states.replace("released", ""))
        for mode, states in seen
    )


@pytest.mark.slow
def test_a_user_machine_moves_as_in_python(opened: Any, tmp_path: Path) -> None:
    import playing

    clutch = {**PRESET.clutch, "time_constant": 0.052, "scale": (0.9, 1.1, 1.05, 0.95)}
    own = replace(PRESET, arm={**PRESET.arm, "length_a": 0.6, "inertia_a": 0.8}, clutch=clutch)
    preset = tmp_path / "own.toml"
    preset.write_text(format_preset(own, "own"), "utf-8")
    with playing.started("--machine", str(preset)) as address:
        play = playing.Play(opened.tab, address, tmp_path)
        play.open("path=arc&friction=1.2")
        assert play.run("[page.settings.material, page.settings.lag]") == ["own", 52]
        assert (
            play.run("document.getElementById('material').selectedOptions[0].text")
            == "Your machine"
        )
        assert "material" not in play.run("location.hash")
        law = find_policy("single-dof-tuned", scenario="paths").bind(
            machine_of(own), pages_batch().layout
        )
        assert (
            play.run("page.workshop.tables.laws['single-dof-tuned'].paths")
            == law.law.gains.tolist()
        )
        play.drag()
        compare(play, "arc", machine=str(preset), lag=0.052, friction=1.2)
        play.choose("material", "baseline")
        play.drag()
        compare(play, "arc", lag=0.052, friction=1.2)
        assert play.problems == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["two-brakes", pytest.param("double-brakes", marks=pytest.mark.long)]
)
def test_a_machine_with_other_clutches_is_felt(name: str, opened: Any, tmp_path: Path) -> None:
    """Laws brake with what is there; policies, which were trained with the paper's clutches, are not offered."""
    import playing

    clutches = find_machine(name).clutches
    with playing.started("--machine", name) as address:
        play = playing.Play(opened.tab, address, tmp_path)
        play.open("control=single-dof")
        assert play.run("page.readout.clutches.map((row) => row.cells[1].textContent)") == [
            c.name for c in clutches
        ]
        assert "residual" not in play.run(CONTROLS)
        assert play.run("page.workshop.tables.laws['single-dof'].standard.length") > 5
        play.drag()
        compare(play, "line", machine=name, lag=0.105, friction=1.0)
        play.open("control=locked")
        play.drag(seconds=0.5)
        states = play.run(
            "page.trials[0].env.tables.clutches.map((_, k) => page.trials[0].clutch(k))"
        )
        assert states == ["stuck"] * len(clutches)
        assert play.problems == []


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (replace(BASELINE, clutch=replace(BASELINE.clutch, voltage_max=12.0)), "voltage_max"),
        (replace(BASELINE, arm=replace(BASELINE.arm, length_a=0.1, length_b=0.1)), "path"),
    ],
    ids=["voltage", "reach"],
)
def test_a_machine_that_the_page_cannot_have_is_refused(own: Machine, told: str) -> None:
    with pytest.raises(ParameterError, match=told):
        tables(own)


def test_a_page_begins_with_a_path_and_a_pace_of_ones_own() -> None:
    found = tables(path=Circle(radius=0.05), pace=0.3)
    assert found["begin"] == {"path": "own", "pace": "own"}
    assert found["paces"]["own"] == 0.3
    assert found["paths"]["own"]["error_max"] < 0.05
    assert tables(path="sine", pace="slow")["begin"] == {"path": "sine", "pace": "slow"}
    for field, bad in {"path": {"path": "sone"}, "pace": {"pace": "fats"}}.items():
        with pytest.raises(ParameterError, match=field):
            tables(**bad)


@pytest.mark.slow
def test_every_setting_can_be_chosen(play: Any) -> None:
    play.open("hand=paper")
    for control in play.run(CONTROLS):
        play.choose("control", control)
        play.until(
            f"page.trials[0].settings.control === '{control}' && page.trials[0].rows.length > 5"
        )
    for identity, values in {
        "path": PATHS,
        "pace": PACES,
        "material": [name for name, machine in MACHINES.items() if machine.has_paper_clutches],
        "lag": (10, 300),
        "friction": (0.2, 2),
        "other": ("free", "residual"),
    }.items():
        for value in values:
            play.choose(identity, value)
            assert str(play.run(f"page.settings.{identity}")) == str(value)
            assert play.run("document.getElementById('problem').hidden")
    play.choose("control", "sliders")
    for clutch in range(1, 5):
        play.choose(f"volts-{clutch}", 5 * clutch)
    play.click("again")
    play.until("page.trials[0].now.volts_4 === 20")
    assert play.run("page.trials[0].now.volts_1") == 5
    assert "volts=5,10,15,20" in play.run("location.hash")


@pytest.mark.slow
def test_an_address_keeps_the_settings(play: Any) -> None:
    stroke = ";".join(f"{x},{600 + x // 5}" for x in range(-300, 300, 20))
    address = (
        f"control=sliders&path=drawn&stroke={stroke}&pace=slow&lag=30&friction=0.5&volts=1,2,3,4"
    )
    play.open(address)
    told = play.run("page.settings")
    assert (told["path"], told["pace"], told["lag"], told["friction"]) == ("drawn", "slow", 30, 0.5)
    assert told["volts"] == [1, 2, 3, 4]
    assert play.run("page.trials[0].line[0]") == pytest.approx([-0.3, 0.54])
    play.choose("pace", "brisk")
    hash_now = play.run("location.hash").removeprefix("#")
    play.open(hash_now)
    assert play.run("page.settings") == {**told, "pace": "brisk"}


@pytest.mark.slow
def test_a_shared_link_challenges_with_the_score(play: Any) -> None:
    play.open("path=arc&lag=60")
    play.drag()
    mine = shown_millimetres(play)
    play.run("navigator.clipboard.writeText = (text) => { window.shared = text; }")
    play.run("page.share()")
    play.until("window.shared")
    assert mine in play.text("caption")
    play.open(play.run("window.shared").partition("#")[2])
    assert f"The score to beat: {mine}" in play.text("caption")
    assert play.run("location.hash") == "#path=arc&lag=60"


BAD = {
    "lag=9": "lag",
    "lag=": "lag",
    "friction=many": "friction",
    "control=magic": "control",
    "control=constructor": "control",
    "path=drawn": "stroke",
    "path=drawn&stroke=1,2;3": "stroke",
    "path=drawn&stroke=0,600;50,600": "path",
    "path=drawn&stroke=0,600;0,1500": "reach",
    "volts=1,2,3": "volts",
    "volts=0,0,0,25": "volts",
    "beat=-1": "beat",
    "magic=1": "magic",
    "pace=%3Cscript%3E": "pace",
}


@pytest.mark.slow
def test_bad_input_gets_a_sentence_and_loses_nothing(play: Any, tmp_path: Path) -> None:
    play.open("path=sine&lag=50&control=locked")
    before = play.run("page.settings")
    for bad, told in BAD.items():
        play.run(f"location.hash = 'path=sine&lag=50&control=locked&{bad}'")
        play.until("!document.getElementById('problem').hidden")
        assert told in play.text("problem"), bad
        assert play.run("page.settings") == before, bad
        assert play.run("page.trials.length") == 1
        play.run("page.complain('')")
    files = {"": "columns time", "time,along,across\n": "no rows", "time,along,across\n0,1,x\n": "Line 2",
             "time,along,across\n0,1,2\n0,1,2\n": "Line 3", "time,along,across\n0,0,0\n99,0,0\n": "60 s"}  # fmt: skip
    for content, told in files.items():
        play.run(f"page.openPush(new File([{content!r}], 'push.csv'))")
        play.until("!document.getElementById('problem').hidden")
        assert told in play.text("problem")
        assert play.run("page.settings") == before
        play.run("page.complain('')")


# --- all of it, slowly ---


@pytest.mark.long
@pytest.mark.parametrize("path", PATHS)
def test_every_path_is_pushed_to_its_end(path: str, play: Any) -> None:
    play.open(f"path={path}&control=residual&other=free")
    play.drag()
    scored = compare(play, path, lag=0.105, friction=1.0)
    assert scored.completed
    assert shown_millimetres(play) == f"{1000 * scored.path_error_m:.1f} mm"
    pushed = play.run("page.trials[0].rows.map((row) => [...row])")
    play.click("compare")
    play.until("page.trials.length === 2 && page.trials.every((trial) => trial.ended)", 60)
    assert play.run("page.trials[0].rows.map((row) => [...row])") == pushed, (
        "the same push, the same controller"
    )
    assert play.run("page.trials[1].settings.control") == "free"
    assert play.run("page.trials[1].rows.map((row) => [...row])") != pushed
