"""What a telemetry row says about each clutch."""

import numpy as np
import pytest

from pter_gym.physics.friction import ClutchMode
from pter_gym.render.clutches import signed
from pter_gym.render.snapshot import MODE_NAMES, Snapshot
from pter_gym.tasks.path_following import TELEMETRY


def row(**values: float) -> np.ndarray:
    telemetry = np.zeros(len(TELEMETRY))
    for name, value in values.items():
        telemetry[TELEMETRY.index(name)] = value
    return telemetry


def test_reads_the_named_entries():
    telemetry = np.arange(float(len(TELEMETRY)))
    telemetry[TELEMETRY.index("mode")] = ClutchMode.STUCK_2
    values = TELEMETRY.as_dict(telemetry)
    snapshot = Snapshot.of(telemetry)
    assert snapshot.time == values["time"]
    assert (snapshot.theta_a, snapshot.theta_b) == (values["theta_a"], values["theta_b"])
    assert snapshot.speed == pytest.approx(np.hypot(values["tip_velocity_x"], values["tip_velocity_y"]))
    assert snapshot.normal_error == values["normal_error"]
    assert snapshot.force.tolist() == [values["force_x"], values["force_y"]]
    assert snapshot.mode is ClutchMode.STUCK_2
    assert snapshot.volts.tolist() == [values[f"volts_{x}"] for x in range(1, 5)]
    assert snapshot.torques.tolist() == [values[f"torque_{x}"] for x in range(1, 5)]


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (ClutchMode.TWO_DOF, ["slipping", "slipping", "slipping", "released"]),
        (ClutchMode.STUCK_1, ["stuck", "slipping", "slipping", "released"]),
        (ClutchMode.STUCK_3, ["slipping", "slipping", "stuck", "released"]),
        (ClutchMode.STUCK_4, ["slipping", "slipping", "slipping", "released"]),
        (ClutchMode.ZERO_DOF, ["stuck", "stuck", "stuck", "released"]),
    ],
)
def test_clutch_states(mode: ClutchMode, expected: list[str]):
    telemetry = row(mode=mode, volts_1=3.0, torque_2=-1.0, volts_3=2.0, torque_3=1.0)
    assert Snapshot.of(telemetry).clutch_states() == expected


def test_every_mode_has_a_name():
    assert set(MODE_NAMES) == set(ClutchMode)


@pytest.mark.parametrize(("value", "text"), [(1.26, "+1.3"), (-1.26, "−1.3"), (0.0, "0.0"), (-0.04, "0.0")])
def test_signed_numbers(value: float, text: str):
    assert signed(value, 1) == text
