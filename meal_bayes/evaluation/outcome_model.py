"""One hierarchical model of the outcomes of many agents: who is ahead, by how much, how surely.

A measure of a trial depends on the agent, the object, the attributes asked and the repeat, and an
agent may do better or worse with one of them than with others:

    eta = mean + agent + object + attributes + repeat
               + (agent x object) + (agent x attributes) + (agent x repeat)

each term normal with a spread that is learned. Effects of agents are shrunk towards each other,
which is what makes many comparisons at once honest [Gelman2012]. Successes are binomial on the
logistic scale, costs and rewards normal. Trials enter as sums over cells of equal terms, so that
NUTS (PyMC) takes seconds for thousands of trials.
"""

import dataclasses
import json
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from meal_bayes.arrays import Floats
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.statistics import HIGH_QUANTILE, LOW_QUANTILE, Measures
from meal_bayes.evaluation.summary import measured, paired_rows
from meal_bayes.palette import reference_agent
from meal_bayes.trials import TrialOutcomes, Trials

MARGINS = {"success": 0.02, "cost": 2.0, "reward": 10.0}  # regions of practical equivalence
_LOGISTIC = math.pi / 8  # of averaging a logistic over a normal: expit(m / sqrt(1 + pi v / 8))

Index = NDArray[np.intp]


@dataclasses.dataclass(frozen=True, slots=True)
class AgentEffect(Measures):
    """What the model says of an agent beside the reference."""

    agent: str
    reference: str
    measure: str
    trials: int
    plain: float  # mean of the differences on the same tasks; NaN where they share none
    effect: float  # the same by the model, shrunk, over new objects and repeats
    low: float  # of its 95 % credible interval
    high: float
    ahead: float  # Pr(better than the reference); better is less for costs
    equivalent: float  # Pr(the effect is smaller than the margin, on both sides of 0)
    margin: float
    attributes: str = ""  # asked, where the row is of some trials only


@dataclasses.dataclass(frozen=True, slots=True)
class Cells:
    """Trials that share all terms of the model, summed."""

    terms: dict[str, Index]  # (C,) level of each term by name; several columns for attributes
    sizes: dict[str, int]  # levels of each term
    trials: NDArray[np.int64]  # (C,)
    total: Floats  # (C,) of their measure
    spread: float  # standard deviation of the measure within cells; nan for successes
    agents: tuple[str, ...]
    attributes: tuple[str, ...]

    @classmethod
    def of(cls, outcomes: TrialOutcomes, measure: str, repeats: ArrayLike | None = None) -> "Cells":
        """Sum trials over cells."""
        values = measured(outcomes, measure)
        mask = ~np.isnan(values)
        if not mask.any():
            raise SettingsError(f"No trial has a {measure}; give trials whose truth is known.")
        judged = outcomes.rows(mask)
        measures = values[mask]
        repeat = np.zeros(len(judged), int) if repeats is None else np.asarray(repeats)[mask]
        columns = {
            "agent": judged.agent,
            "object": judged.object_name,
            "repeat": repeat,
            "attribute": judged.attribute,
        }
        names = {}  # distinct values of each column, in order
        codes = []  # (n,1) of each column their places in these; (n,N) of attributes
        for name, column in columns.items():
            names[name], code = np.unique(column.astype(str), return_inverse=True)
            codes.append(code.reshape(len(judged), -1))
        # A cell is what trials of equal agent, object, repeat and attributes share.
        cells, cell_of = np.unique(np.hstack(codes), axis=0, return_inverse=True)
        cell_of = cell_of.ravel()
        trials = np.bincount(cell_of)
        total = np.bincount(cell_of, measures)
        spread = math.nan
        if measure != "success":
            spread = max(_spread_within(measures, (total / trials)[cell_of], len(cells)), 1e-9)
        sizes = {name: len(levels) for name, levels in names.items()}
        terms = _crossed(cells, sizes)
        return cls(
            terms={name: index for name, index in terms.items() if sizes[name] > 1},
            sizes=sizes,
            trials=trials,
            total=np.asarray(total, float),
            spread=spread,
            agents=tuple(names["agent"].tolist()),
            attributes=tuple(names["attribute"].tolist()),
        )


def _spread_within(measures: Floats, means: Floats, cells: int) -> float:
    """Compute the standard deviation of a measure (n,) about the means of its cells (n,).

    Where each cell has one trial alone, it is that of all trials.
    """
    free = len(measures) - cells
    if free <= 0:
        return float(measures.std())
    return math.sqrt(float(((measures - means) ** 2).sum()) / free)


def _crossed(cells: Index, sizes: dict[str, int]) -> dict[str, Index]:
    """Return the terms' levels in cells (C,3+N), each also crossed with the agent.

    A crossed term has a level for every pair: agent * levels of the other + the other's. Its number
    of levels is added to `sizes`; where the other has one level only, nothing is crossed.
    """
    agent, object_index, repeat = cells[:, :3].T
    crossed_with = {"object": object_index, "repeat": repeat, "attribute": cells[:, 3:]}
    terms = {"agent": agent, **crossed_with}
    for name, index in crossed_with.items():
        if sizes[name] > 1 or name == "object":
            terms[f"agent {name}"] = (agent * sizes[name] + index.T).T
            sizes[f"agent {name}"] = sizes["agent"] * sizes[name]
    return terms


def compare_outcomes(
    trials: Trials,
    *,
    measure: str = "success",
    reference: str | None = None,
    repeats: ArrayLike | None = None,
    margin: float | None = None,
    by_attributes: bool = False,
    draws: int = 500,
    seed: int = 0,
) -> list[AgentEffect]:
    """Compare agents with one of them by the hierarchical model of their outcomes, a row each.

    Parameters
    ----------
    measure : str
        "success", "cost" or "reward".
    reference : str | None
        The agent that others are compared with; by default the paper's, else that of the
        first trial.
    repeats : ArrayLike | None
        (n,) the repeat of each trial, where objects were split anew.
    margin : float | None
        Of practical equivalence; .02 of accuracy, 2 s of cost, 10 of reward by default.
    by_attributes : bool
        Whether rows of the trials that ask the same attributes follow.
    draws : int
        Of the posterior, in each of two chains.

    Raises
    ------
    SettingsError
        A measure that is unknown or that no trial has, an unknown reference, a single agent, a
        task that an agent has twice in a repeat.
    """
    outcomes = TrialOutcomes.of(trials)
    if measure not in MARGINS:
        raise SettingsError(f"Unknown measure {measure!r}; expected {', '.join(MARGINS)}.")
    names = outcomes.agents
    reference_name = reference_agent(names) if reference is None and names else reference
    if len(names) < 2 or reference_name not in names:
        raise SettingsError(
            f"Found the agents {', '.join(names) or 'none'}; expected two or more, and the "
            f"reference {reference_name!r} among them; give the logs of each."
        )
    # Before the model is compiled, which takes a minute: tasks that do not pair are refused.
    pairs = _paired(outcomes, repeats, reference_name, measure)
    cells = Cells.of(outcomes, measure, repeats)
    means, queries, index = population_means(cells, sample(cells, draws=draws, seed=seed))
    equivalence = MARGINS[measure] if margin is None else margin
    masks = {"": np.full(len(index), True)}  # of cells, by the attributes that are asked
    if by_attributes:
        for number, query in enumerate(queries):
            masks[", ".join(np.array(cells.attributes)[query])] = index == number
    reference_index = cells.agents.index(reference_name)
    rows = []
    for attributes, mask in masks.items():
        weights = np.bincount(index[mask], cells.trials[mask], minlength=len(queries))
        levels = np.average(means, axis=2, weights=weights)  # (draws, agents)
        count = np.bincount(cells.terms["agent"][mask], cells.trials[mask], len(names))
        for name in (name for name in names if name != reference_name):
            number = cells.agents.index(name)
            effect = levels[:, number] - levels[:, reference_index]
            low, high = np.quantile(effect, [LOW_QUANTILE, HIGH_QUANTILE])
            better = effect < 0 if measure == "cost" else effect > 0
            rows.append(
                AgentEffect(
                    agent=name,
                    reference=reference_name,
                    measure=measure,
                    trials=int(count[number]),
                    plain=pairs[name].get(attributes, math.nan),
                    effect=float(effect.mean()),
                    low=float(low),
                    high=float(high),
                    ahead=float(better.mean()),
                    equivalent=float((np.abs(effect) < equivalence).mean()),
                    margin=equivalence,
                    attributes=attributes,
                )
            )
    return rows


def _paired(
    outcomes: TrialOutcomes, repeats: ArrayLike | None, reference: str, measure: str
) -> dict[str, dict[str, float]]:
    """Return the mean difference of each agent from the reference, by the attributes asked.

    Those of all tasks that both have are under ""; sets without a task are not there.
    """
    if repeats is not None:
        pairs = zip(np.asarray(repeats).tolist(), outcomes.key.tolist(), strict=True)
        keys = [json.dumps([str(repeat), key]) for repeat, key in pairs]
        outcomes = dataclasses.replace(outcomes, key=np.array(keys, object))
    reference_trials = outcomes.of_agent(reference)
    rows_of_names = reference_trials.attribute.tolist()
    attributes = np.array([", ".join(map(str, names)) for names in rows_of_names])
    differences = dict[str, dict[str, float]]()
    for name in outcomes.agents:
        other = outcomes.of_agent(name)
        rows, reference_rows = paired_rows(other, reference_trials)
        reference_values = measured(reference_trials, measure)[reference_rows]
        gain = measured(other, measure)[rows] - reference_values
        has_gain = ~np.isnan(gain)
        masks = {"": has_gain}
        for text in set(attributes):
            masks[text] = has_gain & (attributes[reference_rows] == text)
        differences[name] = {
            text: float(gain[mask].mean()) for text, mask in masks.items() if mask.any()
        }
    return differences


def sample(cells: Cells, *, draws: int, seed: int) -> dict[str, Floats]:
    """Draw from the posterior by NUTS, two chains joined: arrays (draws, ...) by name.

    They are `mean`, the effect of each term by its name, and its spread by `spread of <name>`.
    """
    from meal_bayes.posterior import hierarchical  # noqa: PLC0415  takes seconds
    from meal_bayes.posterior.draws import Sampling  # noqa: PLC0415

    pm: Any = hierarchical.pm  # type: ignore[attr-defined]  # PyMC, once its folders are set
    means = cells.total / cells.trials
    center = 0.0
    scale = 1.0
    if not math.isnan(cells.spread):  # costs and rewards are measured in their own spread
        center = float(cells.total.sum() / cells.trials.sum())
        scale = math.sqrt(np.average((means - center) ** 2, weights=cells.trials)) or 1.0
    with pm.Model() as model:
        eta = pm.Normal("mean", 0.0, 1.5)
        for name, index in cells.terms.items():
            spread = pm.HalfNormal(f"spread of {name}", 0.7)
            standard = pm.Normal(f"standard {name}", 0.0, 1.0, shape=cells.sizes[name])
            effect = pm.Deterministic(name, spread * standard)
            eta = eta + (effect[index] if index.ndim == 1 else effect[index].mean(axis=1))
        if math.isnan(cells.spread):
            pm.Binomial("successes", cells.trials, logit_p=eta, observed=cells.total)
        else:
            noise = pm.HalfNormal("noise", 2.0 * cells.spread / scale) / np.sqrt(cells.trials)
            pm.Normal("means", eta, noise, observed=(means - center) / scale)
    sampling = Sampling(draws, draws, chains=2, cores=1, seed=seed)
    trace = hierarchical.sample(model, sampling, "outcomes")
    values = {
        str(name): scale * value.to_numpy().reshape(2 * draws, *value.shape[2:])
        for name, value in trace.posterior.items()
        if not str(name).startswith("standard")
    }
    return values | {"mean": values["mean"] + center}


def population_means(cells: Cells, posterior: dict[str, Floats]) -> tuple[Floats, Index, Index]:
    """Return the mean measure of every agent by query, over new objects and repeats.

    It is (draws, agents, Q), with the attributes of each query, (Q,N), and the query of each cell.
    Objects and repeats are averaged over their normal terms: the logistic of a normal has a closed
    form, to a hundredth (probit approximation).
    """
    eta = (posterior["mean"][:, None] + posterior["agent"])[:, :, None]
    attributes_of_cells = cells.terms.get("attribute", np.zeros((len(cells.trials), 1), int))
    queries, index = np.unique(attributes_of_cells, axis=0, return_inverse=True)
    if "attribute" in cells.terms:
        interaction = posterior["agent attribute"].reshape(*eta.shape[:2], -1)
        eta = eta + (posterior["attribute"][:, None] + interaction)[:, :, queries].mean(axis=3)
    if math.isnan(cells.spread):
        drawn = ("object", "repeat", "agent object", "agent repeat")
        variance = sum(posterior[f"spread of {name}"] ** 2 for name in drawn if name in cells.terms)
        eta = expit(eta / np.sqrt(1.0 + _LOGISTIC * np.asarray(variance, float))[..., None, None])
    return eta, queries, index.ravel()
