"""One control step of a world: functions on column ``i``, or the first ones, of rows ``ROW``.

The two functions of this file list its stages in order. The stages are in the files beside it:
``command``, ``motion`` with ``hand``, ``judgement`` and ``sensors``. Each loads what it needs from
a world, calls the physics or the task's rules, and stores the result.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pter_gym._compiled.compiler import inlined
from pter_gym._compiled.records import Records, load, store
from pter_gym._engine.hand import plan_hand, plans
from pter_gym._engine.judgement import judge_step, locate
from pter_gym._engine.motion import heater, load_on, move_hands, set_clutches, torque_sensor
from pter_gym._engine.sensors import observe_reading, observe_world, scale_entries, take_reading
from pter_gym._engine.world import CONFIG, ROW
from pter_gym._physics.step import arrangement_from, control_step_on, count_nonzero, paper_clutches
from pter_gym.hands._model import renew_sines


def _mover(arrangement_at: Any) -> Any:
    """Return what moves worlds with the clutches of ``arrangement_at``; see ``substep_on``."""
    driven = ROW._replace(command=ROW.volts)
    control_step = control_step_on(driven, load_on, arrangement_at, move_hands)
    heat_clutches, sense_torques = heater(arrangement_at), torque_sensor(arrangement_at)

    @inlined
    def move(w: Records, lanes: int, config: Records, guides: bool) -> None:
        """Move the worlds in the first ``lanes`` columns through a control step.

        ``guides`` says that hands may have more than a push and sines, and that clutches may fade.
        """
        h, count = config[CONFIG.substep], int(config[CONFIG.substeps])
        for i in range(lanes):
            set_clutches(w, i, h * count)
        control_step(
            w, lanes, h, count, count_nonzero(w, ROW.machine.voltage_decay.rise, lanes) > 0, guides
        )
        for i in range(lanes):
            sense_torques(w, i)
            store(w, ROW.sines, i, renew_sines(load(w, ROW.sines, i)))
        if guides:
            for i in range(lanes):
                if w[ROW.machine.fade, i] > 0.0:
                    heat_clutches(w, i, h * count)

    return move


move_worlds, move_declared = _mover(paper_clutches), _mover(arrangement_from(ROW))
"""What moves worlds with the paper's clutches, and with others."""


@inlined
def conclude_step(
    w: Records,
    width: int,
    lanes: int,
    words: NDArray[np.uint64],
    first: int,
    config: Records,
    constants: Records,
    with_extras: bool,
) -> None:
    """Find the result of a control step: place, reward, end, the hand's next plan, observation.

    Parameters
    ----------
    w, width, lanes
        The first ``width`` columns are looked at; the first ``lanes`` of them are worlds.
    words, first
        Seed and episode count of all worlds (N, 2), and the number of the world in the first
        column.
    with_extras
        Whether there may be hands that plan or sensors that are not ideal.
    """
    period = config[CONFIG.substep] * config[CONFIG.substeps]
    for i in range(width):
        locate(w, i, constants)
    for i in range(width):
        judge_step(w, i, period, config[CONFIG.max_steps])
    if with_extras:
        for i in range(lanes):
            if plans(w, i):
                plan_hand(w, i, constants, period, config[CONFIG.substeps])
    for i in range(width):
        observe_world(w, i)
    if with_extras:
        for i in range(lanes):
            if w[ROW.task.sensing.is_ideal, i] == 0.0:
                take_reading(w, i, words[first + i, 0], words[first + i, 1], period)
                observe_reading(w, i, constants)
    scale_entries(w, 0, width, config)
