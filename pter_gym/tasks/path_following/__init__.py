"""Follow a path while a hand pushes along it and disturbs across it (paper section IV-A).

What a user states is in ``_specification``, and the numbers that kernels make of it in
``_context`` and ``_model``. ``_position`` says where the tip is, ``_reward`` what that is worth,
``_ending`` when an episode is over, ``_observation`` what is seen, ``_telemetry`` what is recorded.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(  # pyright: ignore[reportUnknownVariableType]
    __name__, __file__
)
