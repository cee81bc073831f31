"""What ``pter reproduce`` makes: the files of each figure or table, and the claims about them."""

import json
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from pter_gym.errors import unknown_name

if TYPE_CHECKING:
    from pter_gym.tools.paper.claims import Claim
    from pter_gym.tools.paper.experiments import Experiments

OUTPUTS = ("fig3", "fig4", "step", "fig5", "fig7", "fig8", "table1", "fig9", "fig10", "fig11")
"""Names of the figures and tables, in the order of the paper."""


def find_outputs(names: Iterable[str]) -> list[str]:
    """Return names of outputs once each, in the order of the paper; ``all`` means all of them.

    Raises
    ------
    ParameterError
        If there is no output of a name.
    """
    requests = set(names)
    unknown = sorted(requests - {"all", *OUTPUTS})
    if unknown:
        raise unknown_name("figures", ", ".join(unknown), ("all", *OUTPUTS))
    return [name for name in OUTPUTS if "all" in requests or name in requests]


def make_outputs(
    experiments: "Experiments",
    outputs: Iterable[str],
    *,
    pdf: bool = False,
    on_progress: Callable[[str], None] = lambda _: None,
) -> "tuple[dict[str, bytes], tuple[Claim, ...]]":
    """Return the content of all files of outputs by their names, and the claims about them.

    With ``pdf`` each picture is a PDF file too. ``on_progress`` is called with an output's name
    when it is done, and finally with ``claims``.
    """
    from pter_gym.tools.figures import encoded
    from pter_gym.tools.paper.claims import STATEMENTS, check
    from pter_gym.tools.paper.figures import PICTURES
    from pter_gym.tools.paper.tables import COLUMNS, csv_text, table1_entries

    names = list(outputs)
    files: dict[str, bytes] = {}
    for name in names:
        for stem, (draw, result) in PICTURES.items():
            if stem.partition("_")[0] == name:
                figure = draw(getattr(experiments, result))
                for suffix in (".png", ".pdf")[: 1 + pdf]:
                    files[stem + suffix] = encoded(figure, suffix)
        files[f"{name}.csv"] = csv_text(COLUMNS[name](experiments)).encode()
        if name == "table1":
            files["table1.json"] = _json(table1_entries(experiments))
        on_progress(name)
    claims = check(
        experiments, [statement for statement in STATEMENTS if statement.figure in names]
    )
    files["claims.json"] = _json([claim.as_json() for claim in claims])
    on_progress("claims")
    return files, claims


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode()
