"""An arm in physics (MuJoCo, extra `sim`): objects that it really touches.

In: a seed. Out: a robot that executes behaviors by name, and data sets of what it felt. No
behavior reads a parameter or a label of its object.
"""
