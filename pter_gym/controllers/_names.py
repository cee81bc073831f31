"""The built-in laws by name, without loading anything that compiles."""

LAWS = {
    "impedance": "_guided:Impedance",
    "torque-feedback": "_guided:TorqueFeedback",
    "single-dof": "_steering:SingleDof",
    "velocity-ratio": "_steering:VelocityRatio",
    "free": "_simple:Free",
    "locked": "_simple:Locked",
    "random": "_simple:Random",
}
"""Where their classes are in ``pter_gym.controllers``, by name."""
