"""The comparison with trusted projects: what it says of this one holds, and its table has a cell for each probe."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trusted
from safetensors.numpy import save

REFUSED = ["our_short", "our_weights", "our_doubled", "our_code", "our_mass", "our_state"]


@pytest.mark.parametrize("name", REFUSED)
def test_hostile_input_is_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    found = trusted.PROBES[name].run()
    assert found.startswith(("refused: `DataError`", "refused: `ParameterError`"))
    assert "code executed" not in found


def test_a_full_disk_leaves_the_earlier_file():
    assert trusted.in_process("our_disk").endswith("the earlier file is whole")


def test_a_pickle_that_is_read_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert trusted.executed("accepted").endswith("nothing executed")
    pickle.loads(trusted.pickled(b""))
    assert trusted.executed("accepted").endswith("**code executed**")


def test_a_lost_file_is_noticed(tmp_path: Path):
    driver = f"""
import sys
sys.path[:0] = [{str(Path(trusted.__file__).parent)!r}]
from pathlib import Path
import trusted
path = Path({str(tmp_path / "file")!r})
path.write_bytes(bytes(1000))
print(trusted.on_full_disk(path, lambda: path.write_bytes(bytes(2000))))
"""
    done = subprocess.run([sys.executable, "-c", driver], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "refused: `OSError`; the earlier file is **lost**"


def test_every_probe_has_a_cell():
    cells = {name: f"cell of {name}" for name in trusted.PROBES}
    text = trusted.comparison(cells, dict.fromkeys(trusted.PROJECTS, "1"))
    assert all(cell in text for cell in cells.values())
    ours = {each.what for each in trusted.PROBES.values() if each.project == trusted.OURS}
    assert ours == {each.what for each in trusted.PROBES.values()}


def test_names_in_a_header_are_doubled():
    data = trusted.doubled(save({"a": np.ones(2, np.float32)}))
    assert data.count(b'"a"') == 2
