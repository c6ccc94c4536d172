"""What a robot earns that knows little: base rates, a few known objects, nothing, a detector.

    python benchmarks/knowing_little.py rates cy101,ispy32,roc36 [--json]
    python benchmarks/knowing_little.py known cy101 --known 0,1,2 --seeds 0-10 --json > now.json
    python benchmarks/knowing_little.py nothing cy101,ispy32 --seeds 0-4 --json > now.json
    python benchmarks/knowing_little.py detector cy101 --known 0,2,4,8 --seeds 0-6 --json > now.json
    python benchmarks/knowing_little.py scores cy101 --known 0,2,4,8,16 --seeds 0-10
    python benchmarks/knowing_little.py words --seeds 0-4
    python benchmarks/knowing_little.py wrong_labels cy101 --seeds 0-8 --told --json > now.json
    python benchmarks/knowing_little.py raters ispy32
    python benchmarks/knowing_little.py compare before.json now.json
    python benchmarks/knowing_little.py detector cy101 --seeds 0-10 --keep now
    python benchmarks/knowing_little.py picture

`rates`: 400 splits of a label table; n objects are known, and the answers that base rates alone
give are judged on the others: how many are right, and log-loss; pooled, and each attribute alone.
"More" is how many more are right than with the number of objects in the row above, with the
standard error of this difference over splits.

The others are run in two checkouts (PYTHONPATH) or by two agents, and compared: equal seeds have
the same objects, questions and luck. `known`: recordings and all labels of n objects are given,
then QUESTIONS questions about others follow, of one attribute each. `nothing`: TRIALS objects, one
attribute of each asked and told, then TESTS on objects that were not met; `--agent alone` prices
exploring by rates of each attribute alone. `detector`: as `known`, with the shipped percepts as a
detector's, in place of recordings; `--agent chance` has a detector that says anything. `scores`:
as `detector`, and once more with what the levels were cut from, as a probability that is not
calibrated, and paired differences. `words`:
the recordings of 70 objects of CY101 are given, with the labels of the words FIRST; the ten words
of the domain are added afterwards, and told of n of these objects, then QUESTIONS questions about
the other 30 objects ask them. `wrong_labels`: as the first 100 trials of
`nothing`, with right labels, and with labels of which WRONG are drawn to be wrong; the difference
is what these cost. With `--told` a third robot gets the same wrong labels and is told how many are
right. `raters`: how often a second rater of a data set agrees with its labels, on all
pairs of word and object that both judged, and on those of the words that experiments ask, with a
95 % interval over objects. `compare` prints paired differences with 95 % t-intervals over the
seeds. `--keep before` and `--keep now` put the rows of `known` and `detector` into
`knowing_little.json`, and `picture` draws it: how many answers are right, and the reward of a
detector. "Before" is commit fdfc6c03, on PYTHONPATH.
"""

import json
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from measuring import options_of, show
from scipy import stats
from scipy.special import expit

from meal_bayes import Learner, Outcome, load_dataset, load_percepts
from meal_bayes.agents import Agent, Progress, load_agent
from meal_bayes.datasets import Dataset
from meal_bayes.datasets.percepts import PerceptTable
from meal_bayes.datasets.sources import fetch, find_folder, source
from meal_bayes.domain import Domain, Query
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Predefined, Solver
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import stream
from meal_bayes.trials import Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SPLITS = 400
QUESTIONS = 150
TRIALS = 300
TESTS = 100
KNOWN = (0, 1, 2, 4, 8, 16)
FIRST = ("small", "cylindrical", "closed", "light", "short", "deformable", "tall", "brown")
WITH_LATER_WORDS = (0, 3, 5, 10, 20, 70)  # objects of which the words are told that were added
WRONG = 0.17  # of labels
SAID = ("surely no", "no", "yes", "surely yes")  # by level
POWER = 0.6  # of log-odds, and a shift, that make a probability which is not calibrated
SHIFT = 1.0
KEPT = Path(__file__).with_suffix(".json")  # rows by part, and "before" or "now"
ASSETS = Path(__file__).resolve().parents[1] / "docs" / "assets"
BEFORE, NOW = "before", "now"
ENOUGH = 4  # seeds, for an interval
Row = dict[str, Any]


def rates(name: str) -> list[Row]:
    """Judge base rates by the labels of objects that they were not learned from."""
    from meal_bayes.agents.base_rates import learn_base_rates  # noqa: PLC0415  new

    table = load_percepts(name)
    rng = np.random.default_rng(5)
    orders = [rng.permutation(len(table.labels)) for _ in range(SPLITS)]
    rows: list[Row] = []
    before = np.zeros(SPLITS)
    for n in KNOWN:
        found = []
        for order in orders:
            told = table.labels[order[:n]]
            truth = table.labels[order[max(KNOWN) :]]  # the same, however many are known
            known = truth >= 0
            alone = ((told == 1).sum(axis=0) + 1) / ((told >= 0).sum(axis=0) + 2)
            pooled = learn_base_rates(table.domain, told).mean
            for rate, yes in ((pooled, pooled > 0.5), (alone, alone >= 0.5)):  # ties were yes
                right = ((yes == truth) & known).sum() / known.sum()
                loss = -(np.log(np.where(truth == 1, rate, 1 - rate)) * known).sum() / known.sum()
                found += [right, loss]
        of_splits = np.reshape(found, (SPLITS, 4))
        labels = ("right", "log-loss", "right, alone", "log-loss, alone")
        row = dict(zip(labels, of_splits.mean(axis=0).tolist(), strict=True))
        gained = of_splits[:, 0] - before
        before = of_splits[:, 0]
        more = f"{gained.mean():+.4f} ± {stats.sem(gained):.4f}" if rows else ""
        rows.append({"data": name, "known": n, **row, "more": more})
    return rows


@dataclass(frozen=True)
class Laplace:
    """The bonus of `bayes`, priced by rates (k + 1) / (n + 2) of each attribute alone."""

    bonus_limit: float = 1.0

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with the bonus."""
        known = progress.knowledge
        alone = (known.rates.true + 1) / (known.rates.labeled + 2)
        progress = replace(progress, knowledge=replace(known, base_rates=alone, rates=None))
        return load_agent("bayes").exploration.shape(momdp, progress)


def agent_of(name: str) -> Agent:
    """Return an agent by name, or `bayes` with the bonus of an arm."""
    bayes = load_agent("bayes")
    if name == "alone":
        return replace(bayes, exploration=Laplace())
    return bayes if name == "chance" else load_agent(name)


def first_objects(dataset: Dataset, places: np.ndarray) -> Dataset:
    """Return a data set of some of the objects."""
    features = {context: values[places] for context, values in dataset.features.items()}
    names = tuple(dataset.objects[o] for o in places.tolist())
    return Dataset(dataset.domain, names, features, dataset.labels[places])


def answers(truth: dict[str, bool], rng: np.random.Generator, accuracy: float) -> dict[str, bool]:
    """Return what a person says who is right with such an accuracy."""
    return {name: bool(rng.random() < accuracy) == value for name, value in truth.items()}


def question(
    data: Dataset | PerceptTable, o: int, rng: np.random.Generator
) -> tuple[dict[str, bool], int]:
    """Draw a known attribute of an object; return its label, and its place."""
    p = int(rng.choice(np.flatnonzero(data.labels[o] >= 0)))
    return {data.domain.attributes[p]: bool(data.labels[o, p])}, p


def replayed(data: Dataset, o: int, truth: dict[str, bool], *key: object) -> RecordedRobot:
    """Return the robot of a trial; its luck has the trial's key."""
    luck = (stream(*key, part) for part in ("order", "failures"))
    person = partial(answers, truth, stream(*key, "errors"))
    return RecordedRobot(data.domain, o, replayable(data)[o], *luck, data, person=person)


def of_trials(trials: list[Trial], start: float) -> Row:
    """Sum up trials of which truth is known."""
    return {
        "reward": float(np.mean([trial.reward for trial in trials])),
        "right": float(np.mean([bool(trial.success) for trial in trials])),
        "s": float(np.mean([trial.cost for trial in trials])),
        "cpu": time.process_time() - start,
    }


def known_objects(name: str, seed: int, n: int, agent: str) -> Row:
    """Measure questions about objects after n others are known."""
    start = time.process_time()
    data = load_dataset(name)
    rng = stream(seed, "knowing little", name)
    order = rng.permutation(len(data.objects))
    learner = Learner(data.domain, agent=agent_of(agent), seed=seed, logs=None)
    if n:
        learner.fit(first_objects(data, order[:n]))
    asked = order[max(KNOWN) :]  # the same, however many are known
    trials = []
    for q in range(QUESTIONS):
        o = int(asked[q % len(asked)])
        truth, _ = question(data, o, rng)
        robot = replayed(data, o, truth, seed, "known", q)
        trials.append(learner.ask(list(truth), robot, truth=truth, learn=False))
    return {"data": name, "known": n, "seed": seed, **of_trials(trials, start)}


def from_nothing(name: str, seed: int, agent: str) -> Row:
    """Measure a robot that begins with nothing, and is told what it was asked."""
    start = time.process_time()
    data = load_dataset(name)
    rng = stream(seed, "from nothing", name)
    objects = rng.permutation(len(data.objects))
    tested = len(objects) // 3
    learner = Learner(data.domain, agent=agent_of(agent), seed=seed, logs=None)
    rewards = []
    for t in range(TRIALS + TESTS):
        part = objects[tested:] if t < TRIALS else objects[:tested]
        o = int(part[t % len(part)])
        truth, _ = question(data, o, rng)
        robot = replayed(data, o, truth, seed, "nothing", t)
        learns = t < TRIALS
        trial = learner.ask(
            list(truth), robot, truth=truth, object_name=data.objects[o], learn=learns
        )
        if learns:
            learner.tell(trial, truth)
        rewards.append(trial.reward)
    return {
        "data": name,
        "seed": seed,
        "first 100": sum(rewards[:100]),
        "first 300": sum(rewards[:TRIALS]),
        "tests": float(np.mean(rewards[TRIALS:])),
        "cpu": time.process_time() - start,
    }


def wrong_labels(name: str, seed: int, agent: str, *, told: bool = False) -> Row:
    """Measure what 100 trials from nothing lose where some of the labels told are wrong."""
    start = time.process_time()
    data = load_dataset(name)
    reward: Row = {}
    cases: list[tuple[str, float, dict[str, float]]] = [
        ("right labels", 0.0, {}),
        ("wrong labels", WRONG, {}),
    ]
    if told:
        cases.append(("told", WRONG, {"label_accuracy": 1.0 - WRONG}))
    for kind, wrong, options in cases:
        rng = stream(seed, "from nothing", name)
        errors = stream(seed, "wrong labels", name)
        objects = rng.permutation(len(data.objects))[len(data.objects) // 3 :]
        learner = Learner(data.domain, agent=agent_of(agent), seed=seed, logs=None, **options)
        total = 0.0
        for t in range(100):
            o = int(objects[t % len(objects)])
            truth, _ = question(data, o, rng)
            robot = replayed(data, o, truth, seed, "nothing", t)
            trial = learner.ask(list(truth), robot, truth=truth, object_name=data.objects[o])
            learner.tell(trial, answers(truth, errors, 1.0 - wrong))
            total += trial.reward
        reward[kind] = total
    lost = {"lost": reward["right labels"] - reward["wrong labels"]}
    if told:
        lost["lost, told"] = reward["right labels"] - reward["told"]
    return {"data": name, "seed": seed, **reward, **lost, "cpu": time.process_time() - start}


def raters(name: str) -> list[Row]:
    """Compare the labels of a data set with what a second rater said."""
    data = load_dataset(name)
    both = (data.answers >= 0) & (data.labels >= 0)
    agree = data.answers == data.labels
    least = data.domain.asked_minimum
    positive = (data.labels == 1).sum(axis=0)
    asked = (positive > least) & ((data.labels == 0).sum(axis=0) > least)
    rng = stream(0, "raters", name)
    rows: list[Row] = []
    for words, chosen in (("all", both), (f"the {asked.sum()} asked", both & asked)):
        right, number = (agree & chosen).sum(axis=1), chosen.sum(axis=1)
        drawn = rng.integers(len(number), size=(10_000, len(number)))
        share = right[drawn].sum(axis=1) / number[drawn].sum(axis=1)
        low, high = np.quantile(share, (0.025, 0.975)).tolist()
        row = {"data": name, "words": words, "pairs": int(number.sum())}
        rows.append({**row, "agree": right.sum() / number.sum(), "from": low, "to": high})
    return rows


class Detecting:
    """A robot that replays the shipped percepts of an object as a detector's."""

    def __init__(
        self,
        table: PerceptTable,
        o: int,
        robot: RecordedRobot,
        *,
        luck: np.random.Generator | None,
        scores: bool,
    ) -> None:
        self.table = table
        self.object = o
        self.robot = robot
        self.luck = luck  # of a detector at chance
        self.scores = scores  # in place of words

    def start(self) -> str:
        """Start a trial."""
        return self.robot.start()

    def execute(self, behavior: str) -> Outcome:
        """Say of each attribute whether it is so."""
        outcome = self.robot.execute(behavior)
        if outcome.recording is None or outcome.recording < 0:
            return outcome
        domain = self.table.domain
        e = domain.behavior_index(behavior)
        odds = self.table.log_odds[self.object, outcome.recording, e]
        if self.luck is None and self.scores:
            bent = np.sign(odds) * np.abs(odds.astype(float)) ** POWER + SHIFT
            said = zip(domain.attributes, expit(bent).tolist(), strict=True)
            return Outcome(outcome.state, percepts=dict(said))
        if self.scores:
            said = zip(domain.attributes, self.luck.random(len(odds)).tolist(), strict=True)
            return Outcome(outcome.state, percepts=dict(said))
        levels = self.table.levels_of(odds, len(SAID))
        if self.luck is not None:
            levels = self.luck.integers(len(SAID), size=len(odds))
        said = zip(domain.attributes, (SAID[level] for level in levels), strict=True)
        return Outcome(outcome.state, percepts=dict(said))


def meeting(domain: Domain, query: Query) -> Solver:
    """Execute all behaviors where two attributes are asked, else plan as `bayes` does."""
    if len(query) > 1:
        return Predefined(domain.default_sequence)
    return load_agent("bayes").solver(domain, query)


def with_detector(name: str, seed: int, n: int, agent: str, *, scores: bool = False) -> Row:
    """Measure questions after a detector was heard of n objects, all labels of which were told."""
    start = time.process_time()
    table = load_percepts(name)
    domain = table.domain
    rng = stream(seed, "detector", name)
    order = rng.permutation(len(table.objects))
    bayes = replace(agent_of(agent), solver=meeting)
    learner = Learner(domain, agent=bayes, seed=seed, logs=None)

    def robot(o: int, *key: object) -> Detecting:
        luck = (stream(seed, *key, part) for part in ("order", "failures"))
        replay = RecordedRobot(domain, o, replayable(table)[o], *luck)
        chance = stream(seed, *key, "chance") if agent == "chance" else None
        return Detecting(table, o, replay, luck=chance, scores=scores)

    # One object is met of which nothing is told, so that it is known what the detector speaks of.
    learner.ask(list(domain.attributes[:2]), robot(int(order[-1]), "first"))
    for o in order[:n].tolist():
        trial = learner.ask(list(domain.attributes[:2]), robot(o, "met", o))
        known = np.flatnonzero(table.labels[o] >= 0).tolist()
        labels = {domain.attributes[p]: bool(table.labels[o, p]) for p in known}
        learner.tell(trial, labels)
    asked = order[max(KNOWN) : -1]
    trials = []
    for q in range(QUESTIONS):
        o = int(asked[q % len(asked)])
        truth, _ = question(table, o, rng)
        trials.append(learner.ask(list(truth), robot(o, "asked", q), truth=truth, learn=False))
    return {"data": name, "known": n, "seed": seed, **of_trials(trials, start)}


def later_words(seed: int, agent: str) -> list[Row]:
    """Measure questions about words that were added once objects had been met."""
    data = load_dataset("cy101")
    words = data.domain.attributes
    known = replace(data.domain, attributes=FIRST)
    before = source("cy101").load(known, find_folder("cy101", fetch("cy101")))
    order = stream(seed, "later words").permutation(len(data.objects))
    met = order[: WITH_LATER_WORDS[-1]]
    tested = order[WITH_LATER_WORDS[-1] :]
    learner = Learner(known, agent=agent_of(agent), seed=seed, refit_every=None, logs=None)
    learner.fit(first_objects(before, met))
    for word in words:
        learner.add_attribute(word)
    rows = []
    told = 0
    for n in WITH_LATER_WORDS:
        start = time.process_time()
        for o in met[told:n].tolist():
            learner.tell(data.objects[o], dict(zip(words, map(bool, data.labels[o]), strict=True)))
        told = n
        learner.refit()
        trials = []
        for q in range(QUESTIONS):
            o = int(tested[q % len(tested)])
            p = q // len(tested) * 2 + q % 2  # each object has five of the words
            truth = {words[p]: bool(data.labels[o, p])}
            robot = replayed(before, o, truth, seed, "later", q)
            trials.append(learner.ask(list(truth), robot, truth=truth, learn=False))
        rows.append({"data": "cy101", "known": n, "seed": seed, **of_trials(trials, start)})
    return rows


def scores_and_levels(name: str, seeds: range, n: int, agent: str) -> list[Row]:
    """Compare a detector that gives scores with one that gives the levels which they are cut to."""
    levels = [with_detector(name, seed, n, agent) for seed in seeds]
    scores = [with_detector(name, seed, n, agent, scores=True) for seed in seeds]
    rows = []
    for measure in ("reward", "right", "s"):
        one, other = (np.array([float(row[measure]) for row in run]) for run in (levels, scores))
        width = stats.t.ppf(0.975, len(seeds) - 1) * stats.sem(other - one)
        rows.append({
            "data": name,
            "known": n,
            "measure": measure,
            "levels": one.mean(),
            "scores": other.mean(),
            "difference": f"{(other - one).mean():+.3g} ± {width:.2g}",
        })  # fmt: skip
    return rows


def compare(before: Path, now: Path) -> list[Row]:
    """Compare two runs seed by seed."""
    first, second = (json.loads(path.read_text("utf-8")) for path in (before, now))

    def place(row: Row) -> tuple[object, ...]:
        return row["data"], row.get("known"), row["seed"]

    earlier = {place(row): row for row in first}
    groups: dict[tuple[object, object], list[Row]] = {}
    for row in second:
        if place(row) in earlier:
            was = earlier[place(row)]
            differences = {k: float(v) - float(was[k]) for k, v in row.items() if k in _MEASURES}
            groups.setdefault((row["data"], row.get("known")), []).append(differences)
    rows = []
    for (data, known), pairs in groups.items():
        row: Row = {"data": data, "known": known, "seeds": len(pairs)}
        for measure in pairs[0]:
            values = np.array([pair[measure] for pair in pairs])
            width = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values)
            row[measure] = f"{values.mean():+.4g} ± {width:.3g}"
        rows.append(row)
    return rows


def keep(part: str, version: str, rows: list[Row]) -> None:
    """Put rows in place of those of the same data set, number of objects and seed."""
    kept = json.loads(KEPT.read_text("utf-8")) if KEPT.is_file() else {}
    place = kept.setdefault(part, {})
    cells = {(row["data"], row["known"], row["seed"]): row for row in place.get(version, [])}
    cells |= {(row["data"], row["known"], row["seed"]): row for row in rows}
    place[version] = [cells[cell] for cell in sorted(cells)]
    KEPT.write_text(json.dumps(kept, indent=1) + "\n", "utf-8")


def write_pictures() -> None:
    """Draw the rows that are kept, on light and on dark pages."""
    from meal_bayes.look import save  # noqa: PLC0415  versions before have it elsewhere

    kept = json.loads(KEPT.read_text("utf-8"))
    for dark in (False, True):
        end = "-dark.svg" if dark else ".svg"
        save(draw_right(_in_both(kept["known"]), dark=dark), ASSETS / f"knowing-little{end}")
        save(draw_detector(_in_both(kept["detector"]), dark=dark), ASSETS / f"detector{end}")


def _in_both(rows: dict[str, list[Row]]) -> dict[str, list[Row]]:
    """Return the rows of data sets and seeds that both versions have been measured on."""
    measured = [{(row["data"], row["seed"]) for row in rows[version]} for version in (BEFORE, NOW)]
    both = set.intersection(*measured)
    return {v: [row for row in of if (row["data"], row["seed"]) in both] for v, of in rows.items()}


def draw_right(rows: dict[str, list[Row]], *, dark: bool) -> "Axes":
    """Draw how many answers are right by the number of objects known, a panel a data set."""
    from meal_bayes.canvas import Figure  # noqa: PLC0415
    from meal_bayes.look import drawn_in_style  # noqa: PLC0415

    names = ("cy101", "ispy32", "roc36")
    with drawn_in_style():
        figure = Figure(figsize=(8.4, 3.1), layout="constrained")
        panels = figure.subplots(1, len(names), sharey=True)
        for ax, name in zip(panels, names, strict=True):
            for version in (BEFORE, NOW):
                of_name = [row for row in rows[version] if row["data"] == name]
                _draw_curve(ax, of_name, "right", 100, version, dark=dark)
            ax.set(title=name.upper(), ylim=(0, 103))
            _name_panel(ax, "answers that are right, %" if ax is panels[0] else "", dark=dark)
        panels[-1].legend(loc="lower right", labelcolor=_ink(dark))
        title = "With none to two objects known, more answers on CY101 are right than before"
        figure.suptitle(title, color=_ink(dark), size=12)
        figure.patch.set_alpha(0)
    return panels[0]


def draw_detector(rows: dict[str, list[Row]], *, dark: bool) -> "Axes":
    """Draw the reward of a detector by the number of objects known; a line where all are."""
    from meal_bayes.look import axes_to_draw  # noqa: PLC0415

    with axes_to_draw(None, width=6.4, height=3.4) as ax:
        for version in (BEFORE, NOW):
            few = [row for row in rows[version] if row["known"] <= max(KNOWN)]
            _draw_curve(ax, few, "reward", 1, version, dark=dark)
        full = [row["reward"] for row in rows[NOW] if row["known"] > max(KNOWN)]
        ax.axhline(
            float(np.mean(full)), color=_ink(dark), ls="--", lw=1.2, label="all objects known"
        )
        ax.set_title(
            "On CY101 a detector earns nearly all it can from the first object on", size=12
        )
        _name_panel(ax, "mean reward of a question, s", dark=dark)
        ax.legend(loc="lower right", labelcolor=_ink(dark))
        ax.figure.patch.set_alpha(0)
    return ax


def _draw_curve(
    ax: "Axes", rows: list[Row], measure: str, scale: float, version: str, *, dark: bool
) -> None:
    """Draw means with 95 % t-intervals over the seeds, or each of few seeds as a dash."""
    from meal_bayes.look import agent_style, lightened  # noqa: PLC0415

    numbers = sorted({row["known"] for row in rows})
    values = [scale * np.array([r[measure] for r in rows if r["known"] == n]) for n in numbers]
    means = [value.mean() for value in values]
    places = [KNOWN.index(n) for n in numbers]
    style = agent_style("bayes" if version == NOW else "random")
    color = lightened(style.color) if dark else style.color
    half = None
    if min(map(len, values)) >= ENOUGH:
        half = [stats.t.ppf(0.975, len(value) - 1) * stats.sem(value) for value in values]
    else:
        for place, value in zip(places, values, strict=True):
            ax.plot([place] * len(value), value, "_", color=color, ms=6, zorder=1)
    look = {"marker": style.marker, "color": color, "capsize": 2, "label": version}
    ax.errorbar(places, means, yerr=half, **look)


def _name_panel(ax: "Axes", y_label: str, *, dark: bool) -> None:
    """Name the axes, in the ink of the page."""
    from meal_bayes.look import name_axes  # noqa: PLC0415

    name_axes(ax, "objects known", y_label, grid="y")
    ax.grid(axis="y", color="#38414C" if dark else "#E6E6E6", lw=0.7)
    ax.set_xticks(range(len(KNOWN)), [str(n) for n in KNOWN])
    ax.patch.set_alpha(0)
    ax.tick_params(colors=_ink(dark))
    for text in (ax.xaxis.label, ax.yaxis.label, ax.title):
        text.set_color(_ink(dark))
    for side in ax.spines.values():
        side.set_color(_ink(dark))


def _ink(dark: bool) -> str:
    return "#E8EBEF" if dark else "#1C2430"


_MEASURES = (
    "reward", "right", "s", "first 100", "first 300", "tests",
    "right labels", "wrong labels", "lost", "told", "lost, told",
)  # fmt: skip


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = options_of(__doc__)
    parts = (
        "rates",
        "known",
        "nothing",
        "detector",
        "scores",
        "words",
        "wrong_labels",
        "raters",
        "compare",
        "picture",
    )
    parser.add_argument("part", choices=parts)
    parser.add_argument("what", nargs="*", help="data sets, with commas; or two files")
    parser.add_argument("--known", default=",".join(map(str, KNOWN)))
    parser.add_argument("--seeds", default="0-4", metavar="FIRST-END")
    parser.add_argument("--agent", default="bayes")
    parser.add_argument("--told", action="store_true", help="tell how often labels are wrong")
    parser.add_argument("--keep", choices=(BEFORE, NOW), help="put rows into knowing_little.json")
    options = parser.parse_args()
    if options.part == "picture":
        write_pictures()
        return
    if options.part == "compare":
        rows = compare(*map(Path, options.what))
        show(rows, rows if options.json else None)
        return
    names = options.what[0].split(",") if options.what else []
    seeds = range(*map(int, options.seeds.split("-")))
    known = [int(n) for n in options.known.split(",")]
    if options.part == "rates":
        rows = [row for name in names for row in rates(name)]
    elif options.part == "raters":
        rows = [row for name in names for row in raters(name)]
    elif options.part == "words":
        rows = [row for seed in seeds for row in later_words(seed, options.agent)]
    elif options.part in ("nothing", "wrong_labels"):
        measure = from_nothing
        if options.part == "wrong_labels":
            measure = partial(wrong_labels, told=options.told)
        rows = [measure(name, seed, options.agent) for name in names for seed in seeds]
    elif options.part == "scores":
        rows = [
            row
            for name in names
            for n in known
            for row in scores_and_levels(name, seeds, n, options.agent)
        ]
    else:
        after = known_objects if options.part == "known" else with_detector
        cells = ((name, seed, n) for name in names for seed in seeds for n in known)
        rows = [after(*cell, options.agent) for cell in cells]
        if options.keep:
            keep(options.part, options.keep, rows)
    show(rows, rows if options.json else None)


if __name__ == "__main__":
    main()
