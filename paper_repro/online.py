"""Online runs of an item as arrays: learning curves of an agent, on recordings or as published."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes.agents import load_agent
from meal_bayes.arrays import Floats
from meal_bayes.domain import load_domain
from meal_bayes.evaluation import Estimate, resampled
from meal_bayes.evaluation.logged import TRAINING
from meal_bayes.experiments import OnlineConfig, run_online
from meal_bayes.experiments.online import batch_log, repeat_folder
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.outcomes import BatchOutcomes
from paper_repro import agents
from paper_repro.frame import Setting, paper_values
from paper_repro.statements import THEIRS

LEGAL = "iterative_random_legal"
BASE = "iterative_morc"
BEST = "morc_itrs"
PAPERS = (LEGAL, BASE, BEST)
# Repeats split the same objects: J of them leave (1/J + .52) of the variance, as a third tests and
# two thirds teach. 10 make the 95 % interval 13 % wider than 20 do, 5 nearly half as wide again.
REPEATS = 10
# By the published code's settings each repeat has a split of its own: repeats are independent.
SPLITS = 20
THIRDS = (33, 33, 34)  # of the objects: pretraining, training, test
VARIANTS: dict[str, Any] = {  # what the published code does otherwise than the paper
    "percepts": "model",
    "answers": "joint",
    "learning": (("by_object", False), ("shaped_answers", True)),
}
PUBLISHED = {1: (15, 40, 45), 2: (30, 35, 35)}  # in the published code, which has CY101 alone
FEW_TESTED = (33, 65, 2)  # by a quick run
ATTRIBUTES = {"cy101": load_domain("cy101").attributes}

Split = tuple[int, int, int] | tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Curves:
    """Test trials of one agent, S repeats and B batches, before any training and after each.

    Attributes
    ----------
    hours : (S,B) of exploration so far.
    accuracy, reward, cost, abstained : (S,B) means over test trials.
    by_attribute : (S,B,P) accuracy of the trials that ask each attribute; nan where none does.
    training : (S,B-1) logs of the training trials.
    ratio : test objects over training objects; 0 where these objects are the whole population.
    tests : (S,B) outcomes of the test trials.
    """

    hours: Floats
    accuracy: Floats
    reward: Floats
    cost: Floats
    abstained: Floats
    by_attribute: Floats
    training: tuple[tuple[Path, ...], ...]
    ratio: float = 0.5
    tests: tuple[tuple[TrialOutcomes, ...], ...] = ()

    def __len__(self) -> int:
        return len(self.hours)


def repeats_of(setting: Setting, protocol: str) -> int:
    """Return how many repeats an agent runs in a column."""
    return setting.repeats_of(SPLITS if protocol == THEIRS else REPEATS)


def curves_config(
    setting: Setting,
    dataset: str,
    *,
    n: int,
    agent: str,
    repeats: int,
    protocol: str = "recorded",
    split: Split | None = None,
    **options: Any,
) -> OnlineConfig:
    """Return the online run of an agent's repeats.

    Parameters
    ----------
    setting : seed, and whether the run is quick.
    dataset, n : what is asked, and how many attributes at a time.
    agent, repeats : who, and how often in all.
    protocol : "recorded", or "theirs": four departures of the published code
        (`VARIANTS`), its split and its diagram.
    split : shares of the objects in each part, or their names; those of the protocol by default.
    options : other settings of `OnlineConfig`.
    """
    code = protocol == THEIRS
    return OnlineConfig(
        f"{dataset}_published" if code else dataset,
        attributes=n,
        agents=(agents.online_agent(agent) if code else load_agent(agent),),
        batches=setting.choose(10, 1),
        trials=setting.choose(40, 4),
        repeats=repeats,
        seed=setting.seed,
        reward=paper_values("online_reward"),
        second_rater=False,  # the paper does not say what people answered
        **(VARIANTS if code else {}),
        split=split or setting.choose(PUBLISHED[n] if code else THIRDS, FEW_TESTED),
        key=agents.key(),
        **options,
    )


def run_curves(setting: Setting, dataset: str, *, agent: str, **how: Any) -> Curves:
    """Run an agent's repeats, or read those that the logs hold; see `curves_config`."""
    config = curves_config(setting, dataset, agent=agent, **how)
    run = run_online(
        config, logs=setting.logs, jobs=setting.jobs, on_progress=setting.progress_in("batches")
    )
    folders = [repeat_folder(run.folder, agent, s) for s in range(config.repeats)]
    setting.spend(path for folder in folders for path in folder.glob("*.mcap"))
    logs = tuple(
        tuple(batch_log(folder, batch, TRAINING) for batch in range(1, config.batches + 1))
        for folder in folders
    )
    sizes = [part if isinstance(part, int) else len(part) for part in config.split]
    pretrained, trained, tested = sizes
    # Splits of few recorded objects share them, and their results are not independent. By the
    # published settings the objects are the whole population, and a split is a fresh draw.
    code = config.percepts == VARIANTS["percepts"]
    ratio = 0.0 if code else tested / (pretrained + trained)
    names = ATTRIBUTES.get(dataset, ())
    return curves_of(run.results(), config.repeats, names, logs=logs, ratio=ratio)


def curves_of(
    results: Iterable[BatchOutcomes],
    repeats: int,
    attributes: Sequence[str],
    *,
    logs: tuple[tuple[Path, ...], ...],
    ratio: float,
) -> Curves:
    """Lay out the tests of all batches, which come repeat by repeat, as curves."""
    hours = list[float]()
    tests = list[TrialOutcomes]()
    for result in results:
        hours.append(result.hours)
        tests.append(result.outcomes)

    size = len(tests) // repeats

    def curve(values: Iterable[Any]) -> Floats:
        """Lay out a value of each test, or P of them, as (S,B) or (S,B,P)."""
        array = np.array(list(values), float)
        return array.reshape(repeats, size, *array.shape[1:])

    return Curves(
        hours=curve(hours),
        accuracy=curve(run.success.mean() for run in tests),
        reward=curve(run.reward.mean() for run in tests),
        cost=curve(run.cost.mean() for run in tests),
        abstained=curve((~run.answered).mean() for run in tests),
        by_attribute=curve(accuracy_by_attribute(run, attributes) for run in tests),
        training=logs,
        ratio=ratio,
        tests=tuple(tuple(tests[s * size : (s + 1) * size]) for s in range(repeats)),
    )


def accuracy_by_attribute(run: TrialOutcomes, attributes: Sequence[str]) -> Floats:
    """Return the accuracy of the trials whose first question is each attribute, (P,)."""
    accuracy = np.full(len(attributes), np.nan)
    for p, name in enumerate(attributes):
        asks = run.attribute[:, 0] == name
        if asks.any():
            accuracy[p] = run.success[asks].mean()
    return accuracy


def at_hours(hours: Floats, values: Floats, when: float) -> Floats:
    """Read curves (S,B) at some hours, (S,); nan beyond the end of a curve."""
    return np.array(
        [np.interp(when, x, y, right=np.nan) for x, y in zip(hours, values, strict=True)]
    )


def paired(first: Floats, second: Floats, ratio: float) -> Estimate:
    """Estimate first - second over the repeats (S,) that both have, splits of the same objects."""
    number = min(len(first), len(second))
    return mean_of(first[:number] - second[:number], ratio)


def mean_of(values: Floats, ratio: float, *, fraction: bool = False) -> Estimate:
    """Estimate a mean over the repeats (S,) that have one; of a fraction inside [0, 1].

    At a ratio of 0 the repeats are independent: splits drawn anew, of the objects that there are.
    """
    effect = resampled(values[~np.isnan(values)], ratio)
    by_splits = "Wilson's on splits" if fraction else "Student's t over splits"
    by_objects = "Wilson's, corrected resampled" if fraction else effect.method
    return replace(effect, fraction=fraction, method=by_objects if ratio else by_splits)
