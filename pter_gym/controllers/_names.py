"""The built-in laws, known without loading anything that compiles."""

LAWS = {
    "impedance": "Impedance",
    "torque-feedback": "TorqueFeedback",
    "single-dof": "SingleDof",
    "velocity-ratio": "VelocityRatio",
    "free": "Free",
    "locked": "Locked",
    "random": "Random",
}
"""Their classes in ``pter_gym.controllers``, by name."""
