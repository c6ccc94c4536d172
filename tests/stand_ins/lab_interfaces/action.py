"""The page's action, and what its server does: a red cup stands on the table."""

from types import SimpleNamespace


class Explore:
    state = "table"

    class Goal:
        def __init__(self, *, behavior=""):
            self.behavior = behavior

    @classmethod
    def execute(cls, goal, fails):
        if not fails:
            cls.state = {"lift": "held", "put_down": "table"}.get(goal.behavior, cls.state)
        modality = {"look": "camera", "lift": "wrist"}.get(goal.behavior, "")
        features = {"camera": [200.0, 40.0, 40.0], "wrist": [2.0]}.get(modality, [])
        return SimpleNamespace(state=cls.state, modality=modality, features=features)
