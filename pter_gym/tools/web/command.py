"""``pter play``: the simulator on a page in the browser."""

import webbrowser
from typing import Annotated

import tyro

from pter_gym._commands.terminal import conclude, say
from pter_gym.errors import ParameterError

MAX_PORT = 65535


def play(
    port: Annotated[int, tyro.conf.arg(metavar="NUMBER")] = 0,
    open_browser: Annotated[bool, tyro.conf.arg(name="open")] = True,
    allow_host: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME …")] = (),
) -> None:
    """Push the arm yourself, in your browser.

    You drag the handle, and the simulator responds. The page is served to this computer only and
    needs no network; to see that of a server, forward its port (ssh -L 8000:localhost:8000). Ctrl-C
    ends it.

    Example: pter play --no-open --port 8000

    Args:
        port: Port that serves the page; 0 picks a free one.
        open_browser: Whether to open the page; its address is printed either way.
        allow_host: Further names by which your browser reaches the page, such as that of a proxy.
            localhost and IP addresses always work.
    """
    from pter_gym.tools.web.site import HOST, make_server

    if not 0 <= port <= MAX_PORT:
        raise ParameterError(f"port must be a whole number within [0, {MAX_PORT}], got {port}")
    try:
        server = make_server(port, allow_host)
    except OSError as error:
        raise ParameterError(
            f"port must be free, or 0 for any, got {port}: {error.strerror}"
        ) from None
    address = f"http://{HOST}:{server.server_port}/"
    with server:
        say(f"{address}\nCtrl-C ends it.")
        if open_browser:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            conclude([], "pter watch free,residual --out two.webp")
