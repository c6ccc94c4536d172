"""The page's action, and what its server does: a red cup stands on the table.

The arm keeps its own state, and raises when it is told to do what it cannot do.
"""

from types import SimpleNamespace

LEGAL = {"table": {"look", "lift"}, "held": {"put_down"}}


class Explore:
    state = "table"

    class Goal:
        def __init__(self, *, behavior=""):
            self.behavior = behavior

    @classmethod
    def execute(cls, goal, fails):
        if goal.behavior != "where" and goal.behavior not in LEGAL[cls.state]:
            raise RuntimeError(f"cannot {goal.behavior} in the state {cls.state}")
        if not fails:
            cls.state = {"lift": "held", "put_down": "table"}.get(goal.behavior, cls.state)
        modality = {"look": "camera", "lift": "wrist"}.get("" if fails else goal.behavior, "")
        features = {"camera": [200.0, 40.0, 40.0], "wrist": [2.0]}.get(modality, [])
        return SimpleNamespace(state=cls.state, modality=modality, features=features)
