"""A robot of one's own answers, is told what was true, and answers better.

    python examples/own_robot.py

The recordings stand for what a robot felt of twelve cups; the arm stands for its driver.
"""

import sys

import numpy as np

import meal_bayes as mb

DOMAIN = sys.argv[1] if len(sys.argv) > 1 else "examples/kitchen.toml"
RNG = np.random.default_rng(0)


def color(red):  # what a camera sees: red, green, blue
    return RNG.normal([200, 40, 40] if red else [40, 60, 190], 50)


def force(full):  # what a wrist feels, in N
    return RNG.normal([5.5 if full else 2.0], 1.2)


# ---- the user's own code: a driver speaks in names, nothing else ----------------------------
class Arm:
    """A full blue cup stands on the table."""

    def start(self):
        self.state = "table"
        return self.state

    def execute(self, behavior):
        if behavior == "look":
            return mb.Outcome(self.state, {"camera": color(red=False)})
        if RNG.random() < 0.1:
            return mb.Outcome(self.state)  # the grip slipped: nothing felt
        self.state = "held" if behavior == "lift" else "table"
        return mb.Outcome(self.state, {"wrist": force(full=True)} if behavior == "lift" else None)


def main():
    domain = mb.load_domain(DOMAIN)
    cups = {f"cup {n}": {"red": n % 2 == 0, "full": n % 3 == 0} for n in range(12)}
    look = {name: [color(cup["red"]) for _ in range(3)] for name, cup in cups.items()}
    lift = {name: [force(cup["full"]) for _ in range(3)] for name, cup in cups.items()}
    recordings = mb.Dataset.from_frames(
        domain, {("look", "camera"): look, ("lift", "wrist"): lift}, cups
    )
    learner = mb.Learner(domain).fit(recordings)
    trial = learner.ask("Is it red, and is it full?", Arm(), object_name="my cup")
    print("it says:", trial.task.query.report_name(trial.report))
    learner.tell(trial, {"red": False, "full": True})
    learner.save("logs/kitchen.mind")


if __name__ == "__main__":
    main()
