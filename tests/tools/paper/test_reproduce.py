"""`pter reproduce`: the files, their contracts, and what is refused."""

import csv
import json

import pytest
from pter_gym.tools.paper.experiments.claims import STATEMENTS, Claim
from pter_gym.tools.paper.reproduce import results as results_module
from pter_gym.tools.paper.reproduce.chapters import PRODUCTS, find_products
from pter_gym.tools.paper.reproduce.figures import files_of
from pter_gym.tools.paper.reproduce.results import results

from pter_gym._commands import main as cli
from pter_gym.errors import ParameterError
from pter_gym.units import to_inches


@pytest.fixture(scope="module")
def everything(study) -> tuple[dict[str, bytes], tuple[Claim, ...]]:
    """All files, and the claims."""
    return results(study, PRODUCTS)


@pytest.fixture(scope="module")
def files(everything) -> dict[str, bytes]:
    return everything[0]


def rows_of(content: bytes) -> tuple[list[str], list[dict[str, str]]]:
    reader = csv.DictReader(content.decode().splitlines())
    rows = list(reader)
    return list(reader.fieldnames), rows


# --- what is written ---


def test_there_is_a_picture_and_a_table_for_everything(files):
    assert set(files) == {
        *(f"{name}.csv" for name in PRODUCTS),
        *(f"{stem}.{kind}" for product in PRODUCTS.values() for stem in product.pictures for kind in ("png", "pdf")),
        "table1.json",
        "claims.json",
        "report.html",
    }
    for name, content in files.items():
        if name.endswith(".png"):
            assert content.startswith(b"\x89PNG\r\n")
            width, height = (int.from_bytes(content[k : k + 4]) for k in (16, 20))
            assert width >= 1000
            assert height >= 400
        if name.endswith(".pdf"):
            assert content.startswith(b"%PDF-")


def test_table_1_keeps_its_contract(files, study):
    table = json.loads(files["table1.json"])
    assert list(table) == ["baseline", "delrin_experimental", "delrin_theoretical"]
    for name, row in table.items():
        assert list(row) == ["position_error_in", "tip_speed_in_s", "tip_acceleration_in_s2"]
        assert row["position_error_in"] == to_inches(study.table1[name].position_error)
        assert row["tip_speed_in_s"] == to_inches(study.table1[name].tip_speed)
        assert row["tip_acceleration_in_s2"] == to_inches(study.table1[name].tip_acceleration)


def test_claims_keep_their_contract(files):
    claims = json.loads(files["claims.json"])
    assert [claim["id"] for claim in claims] == [statement.id for statement in STATEMENTS]
    for claim in claims:
        assert {"id", "section", "claim", "measured", "unit", "condition", "holds", "kind"} <= set(claim)
        assert isinstance(claim["holds"], bool)
        assert isinstance(claim["measured"], float)
        assert claim["kind"] in ("prediction", "calibration", "construction", "not met")


def test_data_of_a_figure_are_its_experiment(files, study):
    _, rows = rows_of(files["fig7.csv"])
    for name, sweep in study.sweeps.items():
        errors = [float(row["position_error_m"]) for row in rows if row["model"] == name]
        assert errors == pytest.approx(sweep.position_error.tolist(), rel=1e-8)
    _, rows = rows_of(files["fig4.csv"])
    assert max(float(row["clutch_torque_in_lbf"]) for row in rows) == pytest.approx(63.5, abs=0.2)
    _, rows = rows_of(files["fig5.csv"])
    measured = [float(row["volts_v"]) for row in rows if row["bench_dynamic_nm"]]
    assert min(measured) == 4.0


def test_the_same_study_gives_the_same_bytes(files, study):
    for file, content in files_of("table1", study).items():
        assert files[file] == content


# --- the command ---


def test_one_figure_writes_its_files_alone(tmp_path, capsys):
    assert cli.main(["reproduce", "fig9", "table1", "--out", str(tmp_path / "a" / "b")]) == 0
    assert {path.name for path in (tmp_path / "a" / "b").iterdir()} == {
        "fig9.png",
        "fig9.pdf",
        "fig9.csv",
        "table1.png",
        "table1.pdf",
        "table1.csv",
        "table1.json",
    }
    assert "calibration" in capsys.readouterr().out


def test_everything_is_written_and_named(tmp_path, capsys, monkeypatch, everything):
    asked = []
    monkeypatch.setattr(results_module, "results", lambda _, chosen, **__: asked.extend(chosen) or everything)
    assert cli.main(["reproduce", "--out", str(tmp_path)]) == 0
    assert asked == list(PRODUCTS)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == everything[0]
    assert (tmp_path / "report.html").stat().st_size > 1e5
    assert "report.html" in capsys.readouterr().out.replace("\n", "")


def test_an_unknown_figure_names_the_known_ones(tmp_path, capsys):
    assert cli.main(["reproduce", "fig6", "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err.replace("\n", " ")
    assert all(name in message for name in ("fig6", "all", *PRODUCTS))
    assert not (tmp_path / "out").exists()
    with pytest.raises(ParameterError, match="fig6, fig99"):
        find_products(["fig3", "fig99", "fig6"])
    assert list(find_products(["all"])) == list(find_products(["fig11", "all"])) == list(PRODUCTS)
    assert list(find_products(["fig11", "fig3", "fig11"])) == ["fig3", "fig11"]


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(results_module, "files_of", lambda *_: pytest.fail("worked before it looked at the folder"))
    blocked = tmp_path / "file"
    blocked.write_text("mine")
    assert cli.main(["reproduce", "step", "--out", str(blocked / "below")]) == 2
    assert "out" in capsys.readouterr().err
    assert blocked.read_text() == "mine"


# --- tables ---
