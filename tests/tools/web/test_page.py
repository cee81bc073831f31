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

from pter_gym._commands.main import main
from pter_gym._engine.batch import Batch
from pter_gym.benchmark.policies import find_policy
from pter_gym.benchmark.rollout import record_episode
from pter_gym.benchmark.scores import score
from pter_gym.controllers import CONTROLLERS
from pter_gym.hands import read_forces
from pter_gym.params import BASELINE, MACHINES
from pter_gym.policies._files import SHIPPED
from pter_gym.policies.tuned import tuned_policies
from pter_gym.scenarios import PACES
from pter_gym.scenarios.variations import CURVED_WIDTH
from pter_gym.tasks.path_following import TELEMETRY, Failure, PathFollowing
from pter_gym.tools.pictures.drawing import clutch_states
from pter_gym.tools.web import site
from pter_gym.tools.web.site import make_server, site_files, write_site
from pter_gym.tools.web.tables import PATHS, policies_of_the_paper

OPTIONS = "[...document.querySelectorAll('#{} option')].map((option) => option.value)"
POLICIES = OPTIONS.format("policy")
COMPARED = """[...document.querySelectorAll('#comparison tbody tr')].map((row) =>
  [row.cells[0].textContent, row.cells[1].textContent])"""
STATES = "[...document.querySelectorAll('#clutches td:last-child')].map((cell) => cell.textContent)"

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

    # a process in the background ignores SIGINT by default
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
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


def task_of(path: str, push: Path, pace: str = "medium") -> PathFollowing:
    width = {} if path == "line" else {"error_max": CURVED_WIDTH}
    return PathFollowing(path=PATHS[path], hand=read_forces(push), pace=PACES[pace], **width)


def compare(
    play: Any, path: str, *, pace: str = "medium", machine: str = "baseline", dead: Any = ()
) -> Any:
    """Compare the trial on the page with Python: the same push, the same voltages.

    Return its score.
    """
    import playing

    push = play.saved("save-push", "push.csv")
    names, rows = playing.read_run(play.saved("save-run", "run.csv"))
    assert names == list(TELEMETRY.names)
    task = replace(task_of(path, push, pace), failures=dead)
    batch = Batch(MACHINES[machine], task, 1, sensors="force")
    batch.reset([1])
    telemetry = np.array(rows)
    volts = telemetry[1:, [names.index(f"volts_{n}") for n in range(1, 5)]]
    expected = np.array([batch.step_alone(action)[1] for action in volts])
    np.testing.assert_allclose(telemetry[1:], expected, rtol=1e-7, atol=1e-7)
    states = clutch_states(telemetry[-1], MACHINES[machine])
    for failure in dead:
        states[failure.clutch - 1] = "dead"
    assert play.run("[0, 1, 2, 3].map((k) => page.trials[0].clutch(k))") == states
    scored = score(telemetry, task)
    for name, value in play.run("page.trials[0].result").items():
        assert value == pytest.approx(getattr(scored, name), rel=1e-9), name
    return scored


@pytest.mark.slow
def test_a_push_by_mouse_is_that_of_python(play: Any) -> None:
    play.open(path="arc", pace="slow", machine="delrin_experimental")
    play.drag()
    scored = compare(play, "arc", pace="slow", machine="delrin_experimental")
    assert scored.completed
    assert f"path error {1000 * scored.path_error_m:.1f} mm" in play.text("caption")
    assert float(play.text("time")) == pytest.approx(scored.duration_s, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [pytest.param(name, marks=() if name == "sine" else pytest.mark.long) for name in PATHS]
)
def test_every_policy_gets_the_same_push(path: str, play: Any) -> None:
    play.open(path=path, policy="impedance-tuned")
    play.drag()
    pushed = play.run("page.trials[0].rows.map((row) => [...row])")
    scored = compare(play, path)
    play.until("!document.getElementById('comparison').hidden")
    shown = dict(play.run(COMPARED))
    assert sorted(shown) == sorted(play.run(POLICIES))
    assert shown["impedance-tuned"].startswith(f"{1000 * scored.path_error_m:.1f} mm")
    arrived = [text.endswith("mm") for text in shown.values()]
    errors = [float(text.split()[0]) for text in shown.values() if text.endswith("mm")]
    assert arrived == sorted(arrived, reverse=True)
    assert errors == sorted(errors)
    push = play.saved("save-push", "push.csv")
    task = task_of(path, push)
    scenario = "standard" if path == "line" else "paths"
    replayed = record_episode(find_policy("residual", scenario=scenario), BASELINE, task, 1)
    result = score(replayed.telemetry, task)
    assert shown["residual"].startswith(f"{1000 * result.path_error_m:.1f} mm")
    play.run("[...document.querySelectorAll('#comparison button')].at(-1).click()")
    play.until("page.trials.length === 2 && page.trials.every((trial) => trial.ended)", 60)
    assert play.run("page.trials[0].rows.map((row) => [...row])") == pushed, "the same push"
    assert play.run("page.trials[1].rows.map((row) => [...row])") != pushed
    play.click("again")
    play.until("page.trials.length === 1 && page.waiting")
    assert not play.run("document.getElementById('comparison').hidden")
    play.choose("pace", "brisk")
    assert play.run("document.getElementById('comparison').hidden"), "of another task"


@pytest.mark.slow
def test_a_clutch_dies_while_a_person_pushes(play: Any) -> None:
    """As in Python, in the replays too, and in the next trial until it is repaired."""
    play.open()
    play.drag(seconds=1.0)
    tick = "document.querySelectorAll('#clutches input')[2].click()"
    play.run(tick)
    play.drag()
    (switched,) = play.run("page.trials[0].switched")
    step = switched.pop("step")
    assert switched == {"clutch": 2, "works": False}
    dead = Failure(clutch=3, torque=0.0, after=PathFollowing.control_period * step)
    assert step > 10
    compare(play, "line", dead=(dead,))
    play.until("!document.getElementById('comparison').hidden")
    play.run("document.querySelector('#comparison button').click()")
    play.until("page.trials.length === 2 && page.trials.every((trial) => trial.ended)", 60)
    assert (
        play.run("page.trials.map((trial) => [trial.works(2), trial.clutch(2)])")
        == [[False, "dead"]] * 2
    )
    play.click("again")
    play.until("page.trials.length === 1 && page.waiting")
    assert not play.run("page.trials[0].works(2)")
    play.until("!document.querySelectorAll('#clutches input')[2].disabled")  # a frame later
    play.run(tick)
    assert play.run("page.trials[0].works(2)")


def test_a_dot_keeps_the_pace(play: Any) -> None:
    play.open(path="arc", pace="brisk")
    path, pace = PATHS["arc"], PACES["brisk"]
    sagitta = (path.length / 200) ** 2 * path.max_curvature / 8  # of the page's 200 chords
    for part in (0.0, 0.37, 1.0, 2.0):
        dot = play.run(f"page.trials[0].paced({part * path.length / pace})")
        point = path.point(min(part, 1.0) * path.length)
        np.testing.assert_allclose(dot["at"], point, atol=1.01 * sagitta)


@pytest.mark.slow
def test_everything_can_be_chosen(play: Any) -> None:
    play.open()
    choices = {
        "path": PATHS,
        "pace": PACES,
        "machine": [name for name, machine in MACHINES.items() if machine.has_paper_clutches],
        "policy": (*CONTROLLERS, *tuned_policies(), *policies_of_the_paper()),
    }
    for identity, names in choices.items():
        assert play.run(OPTIONS.format(identity)) == list(names)
        for name in names:
            play.choose(identity, name)
            assert play.run(f"page.trials[0].settings.{identity}") == name
    assert play.run("document.getElementById('problem').hidden")


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_finger_and_the_arrow_keys_push_on_a_phone(play: Any, scheme: str) -> None:
    play.open(width=390, height=844, scheme=scheme)
    play.drag(by_touch=True)
    assert "path error" in play.text("caption")
    play.until("!document.getElementById('comparison').hidden")
    assert not play.run(WIDE)
    play.run("document.getElementById('stage').focus()")
    for name in ("r", "ArrowRight"):
        play.key(name, "keyDown")
    play.until("page.trials[0].now.arc_length > 0.05")
    play.key("ArrowRight", "keyUp")


def test_the_clutches_show_their_states(play: Any) -> None:
    for policy, state in {"free": "released", "locked": "stuck"}.items():
        play.open(policy=policy)
        play.drag(seconds=0.3)
        play.run("page.readings.show(page.trials[0])")
        assert play.run(STATES) == [state] * 4


@pytest.mark.slow
def test_a_policy_that_cannot_be_loaded_is_reported(opened: Any) -> None:
    opened.open()
    opened.run("page.workshop.simulator.policy = () => Promise.reject(new Error('no such file'))")
    opened.choose("policy", "residual")
    assert "no such file" in opened.text("problem")
    opened.choose("policy", "free")
    assert opened.run("page.trials[0].settings.policy") == "free"
    assert opened.run("document.getElementById('problem').hidden")
