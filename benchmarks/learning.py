"""Learning from nothing: reward of a robot's first trials, on a toy and in physics.

    python benchmarks/learning.py toy|many|detector|repeating|physics FIRST-END [--agent A]
                                                        [--trials T] [--horizon H] [--json]

Seeds are FIRST to END - 1. A right answer is worth 100 s, a wrong one -100 s, less the seconds of
the trial; then all labels are told. In the toy one attribute is asked, and of three behaviors one
tells (.15 and .85), the others nothing; trial i of a seed has the same object for every agent.
`many` is the toy with 39 more attributes, about which nobody asks or tells anything.
`detector` is the toy with percepts that are given as such, so that no classifier is to be learned;
in `repeating`, a detector that sees an object again always says the same of it. The agent
`bayes_same_objects` is `bayes` with Eq. 8, which is true of the toy. In physics one random
attribute of each new object is asked, all labels are told (extra `sim`).
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from measuring import options_of, show

from meal_bayes import Learner, Outcome
from meal_bayes.agents import load_agent
from meal_bayes.domain import Behavior, Domain, Effect, TransitionDiagram
from meal_bayes.trials import Trial

COSTS = {"look": 1.0, "tap": 2.0, "shake": 3.0}
RATES = {"look": (0.5, 0.5), "tap": (0.5, 0.5), "shake": (0.15, 0.85)}  # Pr(yes | no, or yes)
TOY = Domain(
    name="toy",
    attributes=("full",),
    report_reward=100.0,
    behaviors=tuple(Behavior(name, cost, ("sensor",)) for name, cost in COSTS.items()),
    diagram=TransitionDiagram(
        states=("table", "term"),
        start="table",
        effects=tuple(Effect("table", name, "table", 1.0) for name in COSTS),
    ),
)


MANY = replace(TOY, attributes=(*TOY.attributes, *(f"other{number}" for number in range(39))))


class ToyRobot:
    """Shows 0 or 1 of an object that is full, or not."""

    def __init__(self, rng: np.random.Generator, full: int) -> None:
        self.rng = rng
        self.full = full

    def start(self) -> str:
        """Return where it is."""
        return "table"

    def execute(self, behavior: str) -> Outcome:
        """Draw a feature."""
        yes = self.rng.random() < RATES[behavior][self.full]
        return Outcome("table", {"sensor": np.array([int(yes)])})


class DetectingRobot(ToyRobot):
    """Says yes or no itself."""

    def execute(self, behavior: str) -> Outcome:
        """Draw a percept."""
        yes = self.rng.random() < RATES[behavior][self.full]
        return Outcome("table", percepts={"full": bool(yes)})


class RepeatingRobot(DetectingRobot):
    """Says of an object what it said before."""

    def __init__(self, rng: np.random.Generator, full: int) -> None:
        super().__init__(rng, full)
        self.said: dict[str, Outcome] = {}

    def execute(self, behavior: str) -> Outcome:
        """Draw the first percept of each behavior."""
        if behavior not in self.said:
            self.said[behavior] = super().execute(behavior)
        return self.said[behavior]


def toy_trials(
    learner: Learner, trials: int, seed: int, robot: type[ToyRobot] = ToyRobot
) -> Iterator[Trial]:
    """Ask about one object after another, and tell its label."""
    rng = np.random.default_rng([seed, 1])
    for full in np.random.default_rng([seed, 0]).integers(0, 2, trials).tolist():
        truth = {"full": bool(full)}
        trial = learner.ask("Is it full?", robot(rng, full), truth=truth)
        learner.tell(trial, truth)
        yield trial


def detector_trials(learner: Learner, trials: int, seed: int) -> Iterator[Trial]:
    """Ask as `toy_trials` does, of a robot with a detector."""
    yield from toy_trials(learner, trials, seed, DetectingRobot)


def repeating_trials(learner: Learner, trials: int, seed: int) -> Iterator[Trial]:
    """Ask as `toy_trials` does, of a robot whose detector repeats itself."""
    yield from toy_trials(learner, trials, seed, RepeatingRobot)


def physics_trials(learner: Learner, trials: int, seed: int) -> Iterator[Trial]:
    """Ask about one new object of the simulated arm after another."""
    from simulated_arm.questions import learn_live  # noqa: PLC0415  needs MuJoCo

    yield from learn_live(learner, trials, seed)


ARM = Path(__file__).resolve().parents[1] / "examples" / "simulated_arm" / "simulated_arm.toml"
PARTS = {
    "toy": (TOY, toy_trials),
    "many": (MANY, toy_trials),
    "detector": (TOY, detector_trials),
    "repeating": (TOY, repeating_trials),
    "physics": (ARM, physics_trials),
}
OWN = {
    "bayes_same_objects": replace(
        load_agent("bayes"), name="bayes_same_objects", object_level=False, shared_trait=False
    )
}


def measure(
    part: str, seed: int, *, agent: str, trials: int, horizon: float | None
) -> dict[str, object]:
    """Measure the first trials of one learner."""
    domain, ask = PARTS[part]
    begin = time.process_time()
    learner = Learner(domain, agent=OWN.get(agent, agent), seed=seed, logs=None, horizon=horizon)
    done = list(ask(learner, trials, seed))
    reward = np.array([_answered(trial) - trial.cost for trial in done])
    right = np.array([bool(trial.success) for trial in done])
    return {
        "seed": seed,
        "reward": float(reward.sum()),
        "first 15": float(reward[:15].sum()),
        "last half": float(reward[trials // 2 :].sum()),
        "right, last half": float(right[trials // 2 :].mean()),
        "work, s": float(sum(trial.cost for trial in done)),
        "executions": sum(len(trial.steps) for trial in done),
        "cpu, s": time.process_time() - begin,
    }


def _answered(trial: Trial) -> float:
    """Return +-100 of an answer, 0 of none."""
    if trial.report is None:
        return 0.0
    return 100.0 if trial.success else -100.0


def main() -> None:
    """Measure seeds, and print a table or JSON, with means and standard errors."""
    parser = options_of(__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("seeds", metavar="FIRST-END")
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--horizon", type=float, help="questions to come; by default not told")
    options = parser.parse_args()
    first, end = map(int, options.seeds.split("-"))
    how = {"agent": options.agent, "trials": options.trials, "horizon": options.horizon}
    rows = [measure(options.part, seed, **how) for seed in range(first, end)]
    columns = [name for name in rows[0] if name != "seed"]
    values = {name: np.array([row[name] for row in rows], float) for name in columns}
    summary = [{"seed": "mean", **{name: float(x.mean()) for name, x in values.items()}}]
    if len(rows) > 1:
        error = {n: float(x.std(ddof=1) / np.sqrt(len(rows))) for n, x in values.items()}
        summary.append({"seed": "s.e.", **error})
    show([*rows, *summary], rows if options.json else None)


if __name__ == "__main__":
    main()
