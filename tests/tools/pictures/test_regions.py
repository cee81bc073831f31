"""The figure of displayable forces: what it shows, and where it is registered."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Polygon

from pter_gym.haptics import force_extremes, force_region, link_angles
from pter_gym.params import BASELINE, MACHINES
from pter_gym.plugins import load_artist
from pter_gym.tools.pictures import regions


def test_polygons_and_the_map_are_those_of_the_machine() -> None:
    poses, steering, _ = regions.force_map(BASELINE).axes
    reach = BASELINE.arm.length_a + BASELINE.arm.length_b
    first = np.array(regions.TIPS[0]) * reach
    polygons = [patch.get_xy()[:-1] for patch in poses.patches if isinstance(patch, Polygon)]
    drawn, forces = polygons[0] - first, force_region(BASELINE, link_angles(BASELINE.arm, first))
    np.testing.assert_allclose(
        drawn * np.abs(forces).max(), forces * np.abs(drawn).max(), atol=1e-9
    )
    assert regions.SIZE / 2.0 < np.abs(drawn).max() <= regions.SIZE
    (mesh,) = steering.collections
    values = np.ma.filled(mesh.get_array(), np.nan)
    middle = values.shape[0] // 2
    assert np.isnan(values[middle, middle]), "no tip at the drive"
    assert np.nanmin(values) == pytest.approx(0.0, abs=1e-9)
    x = np.linspace(-1.0, 1.0, 401) * np.abs(
        BASELINE.arm.length_a + BASELINE.arm.length_b * np.exp(1j * math.asin(regions.DRAWN_MARGIN))
    )
    for at in (250, 280, 340):
        found = force_extremes(BASELINE, link_angles(BASELINE.arm, (x[at], 0.0))).least_steering
        assert values[middle, at] == pytest.approx(found, abs=0.5)


@pytest.mark.parametrize("name", ["baseline", "two-brakes"])
def test_a_machine_is_drawn_by_the_registered_artist_the_same_each_time(
    name: str, tmp_path: Path
) -> None:
    first = load_artist("region")(name, tmp_path / "a.png")
    assert (
        first.read_bytes()
        == regions.draw_force_region(MACHINES[name], tmp_path / "b.png").read_bytes()
    )
