"""Doctests of the robot in physics need MuJoCo; without it, the tests of it skip and say so."""

from importlib.util import find_spec

NEEDS_MUJOCO = ["meal_bayes/simulated_arm/*"]

collect_ignore_glob = [] if find_spec("mujoco") else NEEDS_MUJOCO
