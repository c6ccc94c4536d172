"""A domain from a dictionary and recordings from arrays, such as a UR5's; then one question."""

import numpy as np

import meal_bayes as mb

LAB = {
    "name": "ur5",
    "attributes": ["heavy", "empty", "half", "full"],
    "groups": {"fill": ["empty", "half", "full"]},
    "report_reward": 100.0,
    "behaviors": [
        {"name": "lift", "cost": 4.0, "modalities": ["effort"]},  # six joints' torques, N m
        {"name": "shake", "cost": 3.0, "modalities": ["effort", "audio"]},
    ],
    "diagram": {
        "states": ["table", "hand"],
        "start": "table",
        "effects": [
            {"from": "table", "do": "lift", "to": "hand", "probability": 0.95},
            {"from": "hand", "do": "shake", "to": "hand"},
        ],
    },
}

rng = np.random.default_rng(0)
# 15 lines from arrays to an answer; here they are drawn, yours come from files
cups = [f"cup {number}" for number in range(30)]
heavy = np.arange(30) % 2
fill = np.arange(30) // 2 % 3
labels = np.column_stack([heavy, fill[:, None] == np.arange(3)])  # (objects, attributes)
shape = 30, 5  # objects, recordings
mass = (1.5 * heavy + 0.5 * fill)[:, None, None]
features = {  # (behavior, modality): (objects, recordings, numbers)
    ("lift", "effort"): mass * np.linspace(1, 2, 6) + rng.normal(0, 0.3, (*shape, 6)),
    ("shake", "effort"): mass * np.linspace(2, 1, 6) + rng.normal(0, 0.3, (*shape, 6)),
    ("shake", "audio"): np.eye(3)[fill][:, None] + rng.normal(0, 0.4, (*shape, 3)),
}
dataset = mb.Dataset.from_frames(mb.load_domain(LAB), features, labels, objects=cups)
learner = mb.Learner(LAB, logs=None).fit(mb.build_percept_table(dataset))  # each cup by the others
trial = learner.ask("Is it heavy, and what fill is it?", "cup 9")
print(trial.answer, trial.success)
