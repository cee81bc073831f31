"""What a compiled control law remembers of each world.

A law is ``law(obs, scales, gains, memory) -> PerClutch``: ``obs`` is one float32 observation,
``obs·scales`` is in physical units, ``gains`` belongs to the law and ``memory`` to one world. What
the memory holds is a record: ``Memory`` for the built-in laws, any other for a law that needs one
(``pter_gym.controllers.Policy`` takes it).
"""

from typing import Annotated, NamedTuple

from pter_gym._compiled.records import Entry, rows


class Memory(NamedTuple):
    """What the built-in laws remember of one world."""

    kept: Annotated[float, Entry("1", "the clutch engaged last, or a counter")]
    brake: Annotated[float, Entry("N", "force along the path that the pace's integral has come to")]
    steps: Annotated[float, Entry("1", "control steps of the episode that went before")]
    episode: Annotated[float, Entry("1", "number of the episode")]


MEMORY = rows(Memory)
