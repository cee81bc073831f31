from typing import Any
from pter_gym.compiled.records import load, store
from pter_gym.engine.world import ROW

def f(w: Any, i: int) -> float:
    w[ROW.advanse, i] = 0.0
    store(w, ROW.moton, i, load(w, ROW.motion, i))
    return load(w, ROW.motion, i).theta_x
