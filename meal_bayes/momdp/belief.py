"""The exact belief filter: N times C log-probabilities and percept counts.

Percepts of different attributes are independent given the truth, so evidence is gathered of each
attribute alone, in N times C numbers. Of a group, exactly one attribute is true; its posterior
needs nothing else than each value's likelihood ratio L_k = Pr(percepts | true) / Pr(percepts |
false):

    Pr(k | percepts) ~ prior_k L_k^((K - 1) / K)

Without the power this is the prior restricted to the joint values that are allowed. But the K
percepts come from the same features, each tells its value from the K - 1 others, and they hold the
evidence of K - 1: the percept of the second of two values is that of the first, and would count
twice. For weak evidence from equal features the power is exact, for two values always.

Where attributes exclude or imply each other, the prior is a table of all values y, and so is the
posterior, by the same ratios (those of a group with their power):

    Pr(y | percepts) ~ prior(y) prod over true attributes of L_i
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import (
    FrozenArrays,
    check_place,
    freeze,
    shaped_array,
    tiny_is_zero,
    whole_array,
)
from meal_bayes.domain.query import value_table
from meal_bayes.errors import ImpossibleObservation, SettingsError
from meal_bayes.look import facts_repr, listed
from meal_bayes.momdp.model import MOMDP
from meal_bayes.momdp.observation import predictive


def group_power(values: int) -> float:
    """Return the power (K - 1) / K of the likelihood ratios of a group's K values."""
    return 1 - 1 / values


class Truths(NamedTuple):
    """Probabilities of the truth in one or several beliefs, which are the leading axes.

    Attributes
    ----------
    log_odds : NDArray[np.float64]
        (...,N) log-odds that each attribute is true.
    joint_table : NDArray[np.float64] | None
        (...,Y) probability of each combination of values if the prior is a joint distribution.
    """

    log_odds: NDArray[np.float64]
    joint_table: NDArray[np.float64] | None = None

    @property
    def positive(self) -> NDArray[np.float64]:
        """Probability that each attribute is true, (...,N)."""
        from scipy.special import expit  # noqa: PLC0415  light names import no SciPy

        return np.asarray(expit(self.log_odds))

    def factors(self, groups: tuple[tuple[int, ...], ...]) -> list[NDArray[np.float64]]:
        """Return the probabilities (...,V) of each independent factor; see `Belief.factors`."""
        return (
            by_variable(self.positive, groups) if self.joint_table is None else [self.joint_table]
        )


def by_variable(
    positive: NDArray[np.float64], groups: tuple[tuple[int, ...], ...]
) -> list[NDArray[np.float64]]:
    """Return Pr(value) (...,V) of each variable, from Pr(attribute is true) (...,N)."""
    group_of = {i: group for group in groups for i in group}
    by_truth = np.stack([1.0 - positive, positive], axis=-1)  # (...,N,2)
    return [
        positive[..., list(group_of[i])] if i in group_of else by_truth[..., i, :]
        for i in range(positive.shape[-1])
        if i == min(group_of.get(i, (i,)))  # a group comes once, at its first attribute
    ]


def truths_of(momdp: MOMDP, log_prob: NDArray[np.float64]) -> Truths:
    """Compute the probabilities of the truth from ln Pr(latent class), (...,N,C).

    Percepts and truth are independent given the class, so the MOMDP contains Pr(truth | class).
    """
    log_joint = log_prob[..., None, :] + momdp.log_truth  # (...,N,2,C)
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no value is possible
        of_truth = np.logaddexp.reduce(log_joint, axis=-1)  # (...,N,2)
        if momdp.joint is not None:
            return _coupled_truths(momdp, momdp.joint, of_truth)
        odds = np.asarray(of_truth[..., 1] - of_truth[..., 0])
        # Values of a group exclude each other: the odds of each are taken as one of K answers.
        for group in map(list, momdp.query.groups):
            prior = momdp.prior[group]
            log_ratio = odds[..., group] - (np.log(prior) - np.log1p(-prior))
            weight = np.log(prior) + group_power(len(group)) * log_ratio
            weight[..., prior == 0] = -np.inf
            weight[..., prior == 1] = 0.0
            others = np.where(np.eye(len(group), dtype=bool), -np.inf, weight[..., None, :])
            odds[..., group] = weight - np.logaddexp.reduce(others, axis=-1)
    return Truths(odds)


def _coupled_truths(
    momdp: MOMDP, joint: NDArray[np.float64], of_truth: NDArray[np.float64]
) -> Truths:
    """Compute Pr(values) and its marginals from ln Pr(truth) (...,N,2) of each attribute alone."""
    values = value_table(len(momdp.query), momdp.query.groups)  # (Y,N)
    log_joint = _log_joint(momdp, joint, of_truth)
    # ln of the sums over the values in which each attribute is true, and false, (...,N)
    true = np.logaddexp.reduce(np.where(values, log_joint[..., None], -np.inf), axis=-2)
    false = np.logaddexp.reduce(np.where(values, -np.inf, log_joint[..., None]), axis=-2)
    return Truths(true - false, np.exp(log_joint))


def _log_joint(
    momdp: MOMDP, joint: NDArray[np.float64], of_truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute ln Pr(values), (...,Y), from ln Pr(truth) (...,N,2) of each attribute alone."""
    values = value_table(len(momdp.query), momdp.query.groups)  # (Y,N)
    alone = np.log(np.stack([1.0 - momdp.prior, momdp.prior], axis=1))  # (N,2)
    # ln Pr(percepts | truth), but for a constant; a truth that the prior rules out needs none.
    log_likelihood = np.where(np.isneginf(alone), 0.0, of_truth - alone)
    for group in map(list, momdp.query.groups):
        log_likelihood[..., group, :] *= group_power(len(group))
    truth = values.astype(np.intp)  # of each attribute, by values
    attributes = np.arange(len(momdp.query))
    log_joint = np.log(joint) + log_likelihood[..., attributes, truth].sum(axis=-1)  # (...,Y)
    return np.asarray(log_joint - np.logaddexp.reduce(log_joint, axis=-1, keepdims=True))


def joint_tables(
    momdp: MOMDP, joint: NDArray[np.float64], log_prob: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute Pr(values), (...,Y), from ln Pr(latent class) (...,N,C), without marginals."""
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no value is possible
        of_truth = np.logaddexp.reduce(log_prob[..., None, :] + momdp.log_truth, axis=-1)
        return np.asarray(np.exp(_log_joint(momdp, joint, of_truth)))


class Transition(NamedTuple):
    """One step (a, x', z) of the history: action, next state and observation.

    Attributes
    ----------
    action : int
        Index of a behavior, or of an answer.
    next_x : int
        Index of the next state.
    observation : NDArray[np.int8] | None
        (N,) percept levels; -1 for attributes without a percept. The value is None if the step
        yields no percept.
    """

    action: int
    next_x: int
    observation: NDArray[np.int8] | None


@dataclass(frozen=True, slots=True)
class Belief(FrozenArrays):
    """Belief in a trial: the observed state, the evidence about each attribute, and the percepts.

    Attributes
    ----------
    x : int
        Index of the observed state.
    log_prob : NDArray[np.float64]
        (N,C) logarithm of Pr(latent class); in the paper the two classes are false and true.
    percept_counts : NDArray[np.int64]
        (N,E,K) number of percepts of this object so far, by attribute, behavior and level.
    log_odds : NDArray[np.float64]
        (N,) log-odds that each attribute is true; see `belief_of`.
    groups : tuple[tuple[int, ...], ...]
        For each group, the indices of its attributes, of which exactly one is true; as in the
        query.
    joint_table : NDArray[np.float64] | None
        (Y,) probability of each combination of values if the prior is a joint distribution.
        `log_odds` are then the marginals of this table. None if attributes are independent.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> meal_bayes.initial_belief(momdp).x
    0
    """

    x: int
    log_prob: NDArray[np.float64]
    percept_counts: NDArray[np.int64]
    log_odds: NDArray[np.float64]
    groups: tuple[tuple[int, ...], ...] = ()
    joint_table: NDArray[np.float64] | None = None

    __repr__ = facts_repr

    def _facts(self) -> tuple[str, dict[str, str]]:
        return f"Belief in state {self.x}, after {int(self.shown.sum())} percepts", {
            "Pr(true)": listed([f"{value:.3f}" for value in self.positive], 10),
            "certainty": f"{self.certainty:.3f}, entropy {self.entropy:.2f} bits",
        }

    def at(self, x: int) -> "Belief":
        """Return the same belief in another observed state."""
        return replace(self, x=x)

    @property
    def shown(self) -> NDArray[np.int64]:
        """Return the number of percepts of each behavior, (E,): the largest over all attributes."""
        return np.asarray(self.percept_counts.sum(axis=2).max(axis=0, initial=0), np.int64)

    @property
    @tiny_is_zero
    def positive(self) -> NDArray[np.float64]:
        """Probability that each attribute is true, (N,)."""
        with np.errstate(over="ignore"):
            return freeze(1.0 / (1.0 + np.exp(-self.log_odds)))

    @property
    def marginals(self) -> list[NDArray[np.float64]]:
        """Probabilities of the values of each variable (see `Query.variables`)."""
        return by_variable(self.positive, self.groups)

    @property
    def factors(self) -> list[NDArray[np.float64]]:
        """Independent factors of the belief: `marginals`, or one joint table if there is one."""
        return self.marginals if self.joint_table is None else [self.joint_table]

    @property
    @tiny_is_zero
    def joint(self) -> NDArray[np.float64]:
        """Probability of every combination of values, (Y,); for small N only."""
        if self.joint_table is not None:
            return self.joint_table
        # Variables are independent; the first is the most significant digit of y.
        joint = np.ones(1)
        for row in self.marginals:
            joint = np.concatenate([joint[:, None] * p for p in row], 1).ravel()
        return freeze(joint)

    @property
    def best_report(self) -> NDArray[np.bool_]:
        """The most probable combination of values, (N,)."""
        if self.joint_table is not None:
            return np.asarray(self._values[self.joint_table.argmax()])
        best = self.log_odds > 0
        for group in map(list, self.groups):
            best[group] = np.arange(len(group)) == self.log_odds[group].argmax()
        return freeze(best, np.bool_)

    def agreement(self, report: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the independent factors of Pr(report is right), (N,): one for each attribute.

        The factor of an attribute is the probability of its reported value. In a group, the factor
        of a value that the report denies is 1, because the reported value already implies it. If
        attributes are dependent, the only factor is the probability of the whole report.
        """
        if self.joint_table is not None:
            return np.asarray(self.joint_table[(self._values == report).all(axis=1)])
        grouped = np.isin(np.arange(len(report)), [i for group in self.groups for i in group])
        false = np.where(grouped, 1.0, 1.0 - self.positive)
        return np.asarray(np.where(report, self.positive, false))

    @property
    @tiny_is_zero
    def certainty(self) -> float:
        """Probability of the most probable combination of values."""
        return float(self.right.prod())

    @property
    @tiny_is_zero
    def right(self) -> NDArray[np.float64]:
        """Factors of `certainty`: the probability of the most probable value of each variable."""
        if self.joint_table is not None:
            return freeze([self.joint_table.max()])
        if self.groups:
            return freeze([row.max() for row in self.marginals])
        return freeze(1.0 / (1.0 + np.exp(-np.abs(self.log_odds))))

    @property
    @tiny_is_zero
    def entropy(self) -> float:
        """Entropy of the belief in bits."""
        rows = (np.clip(row, 1e-300, 1.0) for row in self.factors)
        return float(-sum((row * np.log2(row)).sum() for row in rows))

    @property
    def _values(self) -> NDArray[np.bool_]:
        return value_table(len(self.log_odds), self.groups)


@tiny_is_zero
def belief_of(
    momdp: MOMDP, x: int, log_prob: NDArray[np.float64], percept_counts: NDArray[np.int64]
) -> Belief:
    """Return the belief in state x with the log-probabilities (N,C) and percept counts (N,E,K).

    Raises
    ------
    SettingsError
        The MOMDP does not have the state, or arrays have wrong shapes.
    """
    check_place("x", x, len(momdp.x_names))
    n, e, classes, levels = momdp.confusion.shape
    log_prob = shaped_array("log_prob", log_prob, n, classes)
    percept_counts = whole_array("percept_counts", percept_counts, n, e, levels)
    return _belief(momdp, x, log_prob, percept_counts)


def _belief(
    momdp: MOMDP, x: int, log_prob: NDArray[np.float64], percept_counts: NDArray[np.int64]
) -> Belief:
    odds, joint_table = truths_of(momdp, log_prob)
    return Belief(
        x=x,
        log_prob=log_prob,
        percept_counts=percept_counts,
        log_odds=odds,
        groups=momdp.query.groups,
        joint_table=joint_table,
    )


@tiny_is_zero
def initial_belief(momdp: MOMDP) -> Belief:
    """Return the belief at the start of a trial: the first state, the prior, and no percepts.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> meal_bayes.initial_belief(momdp).x
    0
    """
    chance = np.stack([1.0 - momdp.prior, momdp.prior], axis=1)  # (N,2)
    with np.errstate(divide="ignore"):
        log_prob = np.log((chance[:, :, None] * momdp.latent_classes).sum(axis=1))
    percept_counts = np.zeros((len(momdp.query), momdp.n_behaviors, momdp.levels), dtype=np.int64)
    return _belief(momdp, momdp.start, log_prob, percept_counts)


@tiny_is_zero
def update_belief(belief: Belief, momdp: MOMDP, transition: Transition) -> Belief:
    """Condition the belief on one executed action (Algorithm 1, line 10).

    The probability of each latent class is multiplied by its predictive probability of the percept.
    For level z this is (s c_z + n_z) / (s + n), where c_z is the mean probability of the level, s
    the Dirichlet precision, n_z the number of earlier percepts of level z in this trial, and n the
    number of all earlier percepts. With infinite s this is Eq. 8. The belief about an attribute
    without a percept (level -1) does not change.

    Parameters
    ----------
    belief : Belief
        Belief before the action.
    momdp : MOMDP
        Decision problem of the question.
    transition : Transition
        The action, the next state, and the percept levels. Without levels only the state changes.

    Raises
    ------
    ImpossibleObservation
        The percept has probability 0 under every latent class.
    SettingsError
        The MOMDP does not have the action, the state or the levels.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> from meal_bayes.momdp import Transition
    >>> belief = meal_bayes.initial_belief(momdp)
    >>> look = Transition(0, belief.x, np.array([1]))
    >>> meal_bayes.update_belief(belief, momdp, look).percept_counts[0, 0]
    array([0, 1])
    """
    e, next_x, percept = transition
    n = len(momdp.query)
    levels = np.zeros(n, int) if percept is None else np.asarray(percept)
    whole = levels.shape == (n,) and np.issubdtype(levels.dtype, np.integer)
    exists = 0 <= e < momdp.n_actions and 0 <= next_x < len(momdp.x_names)
    if not (whole and exists and levels.min() >= -1 and levels.max() < momdp.levels):
        raise SettingsError(
            f"Found {transition}; expected an action from 0 to {momdp.n_actions - 1}, x from 0 to "
            f"{momdp.terminal}, and None or whole numbers from 0 to {momdp.levels - 1} (-1 where "
            f"nothing came), one for each of {list(momdp.query.attributes)}."
        )
    attributes = np.flatnonzero(levels >= 0)  # of which something came
    if percept is None or e >= momdp.n_behaviors or not len(attributes):
        return belief.at(next_x)
    levels = levels[attributes]
    percept_counts = belief.percept_counts[attributes, e]
    total = percept_counts.sum(axis=1)
    mean = momdp.confusion[attributes, e, :, levels]
    precision = momdp.precision[attributes, e]  # (N,C)
    counts = percept_counts[np.arange(len(levels)), levels][:, None]
    # Pr(class | z) is Pr(class) times the predictive of z, normalized.
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no class is possible
        factor = predictive(mean, precision, counts, total[:, None])
        posterior = belief.log_prob[attributes] + np.log(factor)
        posterior -= np.logaddexp.reduce(posterior, axis=-1, keepdims=True)
    log_prob = belief.log_prob.copy()
    log_prob[attributes] = posterior
    # The next percept of this behavior is predicted by this one, too.
    counted = belief.percept_counts.copy()
    counted[attributes, e, levels] += 1
    after = _belief(momdp, next_x, log_prob, counted)
    impossible = np.flatnonzero(np.isnan(after.log_odds))
    if len(impossible):
        bad = momdp.query.attributes[impossible[0]]
        raise ImpossibleObservation(
            f"Percept of {bad!r} by {momdp.behavior_names[e]!r} has probability zero under every "
            "value that is still possible; use a prior without zeros for the confusion matrices."
        )
    return after


@tiny_is_zero
def next_percept(momdp: MOMDP, belief: Belief) -> NDArray[np.float64]:
    """Compute Pr(truth, level) of the next percept of each behavior and attribute, (N,E,2,K).

    Its sum over truths is Pr(level) under the belief. For planners that look several steps ahead,
    `predictive` returns the probability given a latent class and any number of earlier percepts.
    """
    counts = belief.percept_counts[:, :, None]  # (N,E,1,K)
    total = counts.sum(axis=3, keepdims=True)
    precision = momdp.precision[..., None]
    rows = predictive(momdp.confusion, precision, counts, total)  # (N,E,C,K)
    # Pr(truth, z) = sum_c Pr(c) Pr(truth | c) Pr(z | c), given the percepts so far
    prob = np.exp(belief.log_prob[:, None] + momdp.log_truth)  # (N,2,C) Pr(truth, class)
    # Where attributes are coupled, percepts of the others move Pr(truth), but not Pr(c | truth).
    if momdp.coupled:
        truth = np.stack([1.0 - belief.positive, belief.positive], axis=1)
        prob *= (truth / prob.sum(axis=2).clip(1e-300))[..., None]
    return np.asarray(np.einsum("nvc,neck->nevk", prob, rows))


def percepts_left(momdp: MOMDP, belief: Belief) -> NDArray[np.float64]:
    """Return how many more percepts each behavior can bring, (E,): recordings are not used twice.

    Where none is left it brings nothing, here and in kernels (`is_useless`, `expand`). The limit is
    what `build_momdp` is given, and inf of behaviors that ask a person; where it is finite of any,
    tables are no state (`POMCPPolicy.tables`).
    """
    return np.asarray(momdp.limit - belief.shown, np.float64)


def best_report(momdp: MOMDP, belief: Belief) -> int:
    """Return the action index of the report with the highest expected reward."""
    reports = momdp.reports
    if reports.event is None:
        return momdp.n_behaviors + momdp.query.index_of(belief.best_report)
    no, yes = _yes_or_no_values(momdp, belief).tolist()
    return momdp.n_behaviors + int(yes > no)


def report_value(momdp: MOMDP, belief: Belief) -> float:
    """Compute the expected reward of the best report."""
    reports = momdp.reports
    if reports.event is None:
        return float(reports.of_right(belief.right))
    return float(_yes_or_no_values(momdp, belief).max())


def _yes_or_no_values(momdp: MOMDP, belief: Belief) -> NDArray[np.float64]:
    """Compute the expected rewards (2,) of no and yes."""
    reports = momdp.reports
    return reports.answers(reports.probability(belief))


def _checked_report(momdp: MOMDP, report: object) -> NDArray[np.bool_]:
    """Return a report as an array; refuse what is none of the MOMDP's."""
    return np.asarray(shaped_array("report", report, momdp.query.report_size) != 0)


def expected_reward(momdp: MOMDP, belief: Belief, report: NDArray[np.bool_]) -> float:
    """Compute the expected reward (s) of a report, (N,) values or (1,) yes, under a belief."""
    report = _checked_report(momdp, report)
    reports = momdp.reports
    if reports.event is None:
        return float(reports.of_right(belief.agreement(report)))
    return float(_yes_or_no_values(momdp, belief)[int(report[0])])


@tiny_is_zero
def report_certainty(momdp: MOMDP, belief: Belief, report: NDArray[np.bool_]) -> float:
    """Compute Pr(report is right) of a report, (N,) values or (1,) yes, under a belief."""
    report = _checked_report(momdp, report)
    if momdp.reports.event is None:
        return float(belief.agreement(report).prod())
    p = float(momdp.reports.probability(belief))
    return p if report[0] else 1.0 - p


def best_answer(momdp: MOMDP, belief: Belief) -> int:
    """Return the answer with the highest expected reward: a report, or to abstain."""
    abstains = report_value(momdp, belief) < momdp.exit_value
    return momdp.abstention if abstains else best_report(momdp, belief)


def answer_value(momdp: MOMDP, belief: Belief) -> float:
    """Compute the expected reward of the best answer, which may be to abstain."""
    return max(report_value(momdp, belief), momdp.exit_value)
