"""Couple two FMUs: the arm, and a hand of your own in C (needs FMPy and a C compiler)."""

from pathlib import Path
from tempfile import mkdtemp

import fmpy
from fmpy.fmi3 import FMU3Slave

from pter_gym.tools.deploy import Variable, find_unit, unit_of

TIP = ("tip_x", "tip_y", "tip_velocity_x", "tip_velocity_y")
FORCE = ("force_x", "force_y")
PERIOD = 0.01  # s

hand_c = Path(__file__).with_name("fmu_hand.c").read_text("utf-8")
inputs = [Variable(name, "input", "1", f"{name} of the arm", 0.0, -9.0, 9.0) for name in TIP]
outputs = [Variable(name, "output", "N", f"{name} on it", 0.0, direct=True) for name in FORCE]
units = {
    "arm": find_unit(hand="open"),
    "hand": unit_of("A hand", {"hand.c": hand_c}, inputs + outputs, PERIOD),
}
slaves, references = {}, {}
for name, unit in units.items():
    file = unit.write(Path(mkdtemp()) / f"{name}.fmu")
    description = fmpy.read_model_description(file)
    references[name] = {each.name: each.valueReference for each in description.modelVariables}
    place, token = fmpy.extract(file), description.instantiationToken
    slave = FMU3Slave(name, guid=token, unzipDirectory=place, modelIdentifier="pter")
    slave.instantiate()
    slave.enterInitializationMode()
    slaves[name] = slave

arm, hand = slaves["arm"], slaves["hand"]
seen = [references["arm"][f"telemetry.{name}"] for name in TIP]
felt = [references["hand"][name] for name in TIP]
pushes, pushed = ([references[name][each] for each in FORCE] for name in ("hand", "arm"))
hand.setFloat64(felt, arm.getFloat64(seen))
arm.exitInitializationMode()
hand.exitInitializationMode()
step, over = 0, False
while not over:
    hand.setFloat64(felt, arm.getFloat64(seen))
    arm.setFloat64(pushed, hand.getFloat64(pushes))
    _, over, _, _ = arm.doStep(PERIOD * step, PERIOD)
    hand.doStep(PERIOD * step, PERIOD)
    step += 1
(arrived,) = arm.getFloat64([references["arm"]["telemetry.is_success"]])
print(
    f"the hand has {'reached the end' if arrived else 'lost its way'} after {PERIOD * step:.2f} s"
)
