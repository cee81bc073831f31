"""Without MuJoCo its comparison is left out, and every other test can still be collected."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("mujoco") else ["test_mujoco.py"]
