import numpy as np

import meal_bayes as mb

rng = np.random.default_rng(0)


class Arm:  # a simulated driver: a full blue cup stands on the table
    def start(self):
        return "table"

    def execute(self, behavior):  # return the next state and, if it succeeded, the features
        if behavior == "look":
            return mb.Outcome("table", {"camera": rng.normal([40, 60, 190], 50)})
        if behavior == "lift" and rng.random() < 0.9:
            return mb.Outcome("held", {"wrist": rng.normal([5.5], 1.2)})
        return mb.Outcome("table")


cups = {f"cup {n}": {"red": n % 2 == 0, "full": n % 3 == 0} for n in range(12)}
color = {True: [200, 40, 40], False: [40, 60, 190]}  # red, green, blue
look = {name: rng.normal(color[cup["red"]], 50, (3, 3)) for name, cup in cups.items()}
lift = {name: rng.normal(2 + 3.5 * cup["full"], 1.2, (3, 1)) for name, cup in cups.items()}  # N
recordings = {("look", "camera"): look, ("lift", "wrist"): lift}  # three of each cup
domain = mb.load_domain("examples/kitchen.toml")
learner = mb.Learner(domain).fit(mb.Dataset.from_frames(domain, recordings, cups))
trial = learner.ask("Is it red, and is it full?", Arm(), object_name="my cup")
print(trial.answer)
learner.tell(trial, {"red": False, "full": True})  # the posterior is updated at once
