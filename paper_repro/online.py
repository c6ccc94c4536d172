"""Online runs of an item: which panel, which agents, on recordings or as the published code."""

from collections.abc import Sequence

import numpy as np
from frame import Cell, Estimate, Setting, Table
from numpy.typing import NDArray

from meal_bayes.agents import PublishedVariants
from meal_bayes.evaluation import clustered_se, curves_of, plots, summarize_learning
from meal_bayes.experiments import OnlineConfig, OnlineRun, run_online
from meal_bayes.momdp import observation_entropy
from meal_bayes.trial_log import BatchOutcomes, read_trials

PAPERS = ("iterative_random_legal", "iterative_morc", "morc_itrs")
OURS = ("bayes", "bayes_memory")
COLUMNS = (
    "agent",
    "explored, h",
    "accuracy",
    "claimed",
    "reward",
    "ECE",
    "reward less Iterative MORC's, over its hours",
    "90 % low",
    "high",
    "in the end",
)


def panel(
    setting: Setting,
    dataset: str,
    n: int,
    agents: Sequence[str],
    repeats: int,
    *,
    published: bool = False,
    alpha: float | None = None,
    beta: float | None = None,
) -> OnlineRun:
    """Run what the logs do not hold yet; of tests, log the outcomes only."""
    config = OnlineConfig(
        dataset,
        attributes=n,
        agents=tuple(agents),
        batches=setting.of("online", "batches"),
        trials=setting.of("online", "trials"),
        repeats=repeats,
        seed=setting.seed,
        reward=setting.of("reward", "online"),
        alpha=alpha,
        beta=beta,
        published=PublishedVariants.named(*["all"] * published),
    )
    return run_online(config, logs=setting.logs, jobs=setting.jobs, on_progress=setting.on_progress)


def compared(title: str, results: list[BatchOutcomes]) -> Table:
    """Compare the agents of a panel with Iterative MORC."""
    last = max(result.batch for result in results)
    rows: list[tuple[Cell, ...]] = []
    for one in summarize_learning(results, reference="iterative_morc"):
        end = [r for r in results if (r.agent, r.batch) == (one.agent, last)]
        rows.append(
            (
                one.agent,
                float(np.mean([r.hours for r in end])),
                one.accuracy_after,
                float(np.mean([r.outcomes.certainty.mean() for r in end])),
                one.reward_after,
                one.ece_after,
                one.area_reward_difference,
                one.area_low,
                one.area_high,
                one.reward_after_difference,
            )
        )
    return Table(title, COLUMNS, tuple(rows))


def chosen_weights(run: OnlineRun) -> tuple[float, float]:
    """Alpha and beta that an agent chose after pretraining, by its first training MOMDPs; means.

    The bonus of a MOMDP is alpha Ent - beta IE (Eq. 11), and its counts are delta IE before the
    batch: two numbers from some twenty entries.
    """
    found = []
    for log in sorted(run.folder.glob(f"{run.config.agents[0].name}/repeat-*/01-train.mcap")):
        momdp = next(read_trials(log)).momdp
        entropy, counts = observation_entropy(momdp), momdp.counts.sum(axis=(2, 3))
        explores = momdp.bonus.any(axis=2)
        entropy = entropy[explores].ravel()
        experience = np.repeat(counts[explores] / len(momdp.query), 2)
        sides = np.stack([entropy, -experience], axis=1)
        if sides.any():
            found.append(np.linalg.lstsq(sides, momdp.bonus[explores].ravel())[0])
    alpha, beta = np.mean(found, axis=0) if found else (0.0, 0.0)
    return float(alpha), float(beta)


def curve(results: list[BatchOutcomes], agent: str, name: str = "") -> plots.Series:
    """Mean accuracy over mean hours, with the band of one standard error over repeats."""
    found = curves_of(results, agent)
    mean, root = found.accuracy.mean(axis=0), max(len(found.repeats), 2) ** 0.5
    error = found.accuracy.std(axis=0, ddof=min(1, len(found.repeats) - 1)) / root
    return plots.Series(name or agent, found.hours.mean(axis=0), mean, mean - error, mean + error)


def nearest(values: Sequence[float], value: float) -> int:
    """Give the place of the value that is next."""
    return int(np.abs(np.array(values) - value).argmin())


def mean_of(values: NDArray[np.float64]) -> Estimate:
    """Estimate a mean over repeats."""
    return Estimate(float(values.mean()), clustered_se(values, range(len(values))))
