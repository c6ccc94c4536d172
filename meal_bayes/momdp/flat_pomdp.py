"""A MOMDP for other solvers: as dense arrays, and as the tables that files are made of."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import FrozenArrays, check_place
from meal_bayes.domain import TERMINAL
from meal_bayes.errors import SettingsError
from meal_bayes.momdp.belief import initial_belief
from meal_bayes.momdp.model import MOMDP
from meal_bayes.momdp.reports import ABSTAINED

_LARGEST = 1_000_000  # numbers in a file; as .pomdp some 60 MB, more than solvers get through
_DENSE = 20_000_000  # entries of O in dense arrays, 160 MB

_SAME = 1e-9  # probabilities that differ by less are rounded alike
NOTHING = "na"  # in files, the observation of all that shows no percept,
DONE = "done"  # and, where x is not observed, of an x that has changed
_RESERVED = {
    "T", "O", "R", "discount", "values", "reward", "cost", "states", "actions", "observations",
    "start", "include", "exclude", "uniform", "identity", "reset", "null", TERMINAL, NOTHING, DONE,
}  # fmt: skip


class FileTables(NamedTuple):
    """What a file says of a MOMDP, with names that every parser takes."""

    x_names: tuple[str, ...]  # (X,) states
    y_names: tuple[str, ...]  # (Y,) bits of the values, the query's first attribute leading
    action_names: tuple[str, ...]  # (A,) behaviors, then reports, then abstaining
    percept_names: tuple[str, ...]  # (Z-1,) levels, the first attribute leading
    transition: NDArray[np.float64]  # (E,X,X) Pr(x' | behavior, x)
    comes: NDArray[np.float64]  # (E,X) Pr(a percept comes | behavior, x')
    moves: NDArray[np.bool_]  # (E,X) does the behavior lead to x' from another x?
    reward: NDArray[np.float64]  # (X,Y,A), none in `term`
    prior: NDArray[np.float64]  # (Y,) Pr(y)


def percept_probabilities(momdp: MOMDP, behavior: int) -> NDArray[np.float64]:
    """Compute Pr(percept vector | y) by Eq. 8, (Y,K^N); the first attribute varies slowest."""
    check_place("behavior", behavior, momdp.n_behaviors)
    truth = momdp.query.values.astype(int)  # (Y,N)
    # Percepts of attributes are independent given y: the joint row is an outer product.
    joint = np.ones((len(truth), 1))
    for i, rows in enumerate(momdp.confusion[:, behavior]):  # (2,K)
        joint = (joint[:, :, None] * rows[truth[:, i], None]).reshape(len(truth), -1)
    return joint


def _rewards(momdp: MOMDP) -> NDArray[np.float64]:
    """Compute the reward (X,Y,A) of every action, none in `term`: Eq. 4, and Eq. 11 if shaped.

    A bonus is paid for percepts: expected, of an execution, Pr(a percept comes | x) times it.
    """
    truth = momdp.query.values.astype(int)  # (Y,N)
    reward = np.zeros((momdp.terminal + 1, len(truth), momdp.n_actions))
    bonus = momdp.bonus[np.arange(truth.shape[1]), :, truth].sum(axis=1)  # (Y,E)
    # Formats know no legality: what is not legal ends the trial at a price below every report.
    comes = (momdp.transition * momdp.observation_probability).sum(axis=2).T  # (X,E)
    gained = np.where(momdp.legal[:-1, None], comes[:-1, None] * bonus, momdp.incorrect - 1.0)
    reward[:-1, :, : momdp.n_behaviors] = gained - momdp.expected_cost()[:-1, None]
    reward[:-1, :, momdp.n_behaviors : momdp.abstention] = momdp.reports.rewards()
    reward[:-1, :, momdp.abstention :] = ABSTAINED  # nothing where the agent may not
    return reward


def _legal_transition(momdp: MOMDP) -> NDArray[np.float64]:
    """Return Pr(x' | x, behavior), (E,X,X), where all that is not legal ends the trial."""
    end = np.eye(len(momdp.x_names))[momdp.terminal]
    return np.where(momdp.legal.T[:, :, None], momdp.transition, end)


def _check_size(momdp: MOMDP, size: float, largest: float) -> None:
    """Check that one hidden y a truth is all that a MOMDP's state needs, and that it is small."""
    if not np.isinf(momdp.precision).all() or not momdp.class_is_truth:
        raise SettingsError(
            "A flat POMDP cannot represent rows of finite precision or several latent classes "
            "for one truth; build the MOMDP with precision=inf and without `latent_classes` (Eq. "
            "8)."
        )
    if momdp.bonus_runs_out:
        raise SettingsError(
            "A flat POMDP does not count percepts, so the exploration bonus would be unlimited; "
            "set bonus_limit=inf, or leave the bonus out."
        )
    if size > largest:
        raise SettingsError(
            f"{len(momdp.query)} attributes make {size:.2g} numbers; flat POMDPs end at "
            f"{largest:.0e}. Ask fewer attributes, or use a factored planner."
        )


@dataclass(frozen=True, slots=True)
class FlatPOMDP(FrozenArrays):
    """A POMDP as dense arrays. State x * Y + y is (x, y), and the last state is `term`.

    The last observation is "none". The arrays differ from the MOMDP in two ways: the number of
    percepts is not limited (by `limit`), and an illegal behavior ends the trial with a reward below
    that of every report.

    Attributes
    ----------
    state_names, action_names, observation_names : tuple[str, ...]
        (S,), (A,) and (Z,) names. An observation is named by the percept level of each attribute,
        such as "1-0".
    transition : NDArray[np.float64]
        (A,S,S) Pr(s' | s, a).
    observation : NDArray[np.float64]
        (A,S,S,Z) Pr(z | a, s, s'). It depends on s if a behavior that does not change x may fail.
    reward : NDArray[np.float64]
        (S,A) expected reward, s.
    start : NDArray[np.float64]
        (S,) belief before the trial.
    discount : float
        Discount factor of a step.
    """

    state_names: tuple[str, ...]
    action_names: tuple[str, ...]
    observation_names: tuple[str, ...]
    transition: NDArray[np.float64]
    observation: NDArray[np.float64]
    reward: NDArray[np.float64]
    start: NDArray[np.float64]
    discount: float


def flatten(momdp: MOMDP) -> FlatPOMDP:
    """Convert a MOMDP to dense arrays.

    Raises
    ------
    SettingsError
        The precision is finite (the state would have to contain the percept counts), a truth has
        several latent classes, or there are too many attributes for dense arrays.
    """
    n_y = momdp.query.n_values
    n_z = momdp.levels ** len(momdp.query) + 1
    n_a = momdp.n_actions
    end = momdp.terminal
    living = end * n_y  # states but `term`
    _check_size(momdp, n_a * momdp.n_states**2 * n_z, _DENSE)
    transition = np.zeros((n_a, momdp.n_states, momdp.n_states))
    transition[:, :, -1] = 1.0  # reports, and `term` itself
    observation = np.zeros((n_a, momdp.n_states, momdp.n_states, n_z))
    observation[..., -1] = 1.0
    for e, moves in enumerate(_legal_transition(momdp)[:, :end]):
        # y stays: Pr(x', y' | x, y) = Pr(x' | x) [y' = y]
        transition[e, :living, :living] = np.kron(moves[:, :end], np.eye(n_y))
        transition[e, :living, -1] = np.repeat(moves[:, end], n_y)
        # Pr(z | x, y, x', y): a percept of y where one comes, "none" elsewhere.
        comes = momdp.observation_probability[e, :end, :end]
        block = observation[e, :living, :living].reshape(end, n_y, end, n_y, n_z).copy()
        for y, row in enumerate(percept_probabilities(momdp, e)):
            block[:, y, :, y, :-1] = comes[..., None] * row
            block[:, y, :, y, -1] = 1.0 - comes
        observation[e, :living, :living] = block.reshape(living, living, n_z)
    start = np.zeros((end + 1, n_y))
    start[momdp.start] = initial_belief(momdp).joint
    levels = np.ndindex((momdp.levels,) * len(momdp.query))
    states = (f"{x}, {values}" for x in momdp.x_names[:-1] for values in momdp.query.report_names)
    return FlatPOMDP(
        state_names=(*states, momdp.x_names[-1]),
        action_names=tuple(momdp.action_name(a) for a in range(n_a)),
        observation_names=(*("-".join(map(str, index)) for index in levels), "none"),
        transition=transition,
        observation=observation,
        reward=_rewards(momdp).reshape(-1, n_a)[: momdp.n_states],
        start=start.ravel()[: momdp.n_states],
        discount=momdp.discount,
    )


def file_tables(momdp: MOMDP) -> FileTables:
    """Convert a MOMDP to the tables of a file; errors as of `write_pomdp`."""
    n_y = momdp.query.n_values
    n_z = momdp.levels ** len(momdp.query)
    perceived = int(momdp.observation_probability.any(axis=1).sum())  # behaviors at an x'
    size = n_y * (perceived * n_z + n_y + momdp.n_behaviors * momdp.terminal)  # O, rewards, T
    _check_size(momdp, size, _LARGEST)
    transition = _legal_transition(momdp)
    y_names = tuple("".join("01"[value] for value in row) for row in momdp.query.values.astype(int))
    separator = "" if momdp.levels <= 10 else "_"  # digits
    levels = np.ndindex((momdp.levels,) * len(momdp.query))
    named = y_names if momdp.query.event is None else ("no", "yes")
    answers = (*(f"a{name}" for name in named), *(["abstain"] if momdp.abstain else []))
    reached = transition > 0
    reached[:, -1] = reached[:, :, -1] = False  # in and into `term` nothing is perceived
    return FileTables(
        x_names=(*_identifiers(momdp.x_names[:-1], ()), TERMINAL),
        y_names=y_names,
        action_names=(*_identifiers(momdp.behavior_names, answers), *answers),
        percept_names=tuple("p" + separator.join(map(str, index)) for index in levels),
        transition=transition,
        comes=_percept_rates(momdp, reached),
        moves=np.asarray((reached & ~np.eye(len(momdp.x_names), dtype=bool)).any(axis=1)),
        reward=_rewards(momdp),
        prior=initial_belief(momdp).joint,
    )


def _percept_rates(momdp: MOMDP, reached: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Compute Pr(percept | behavior, x') (E,X); both formats suppose that x plays no part."""
    senses = momdp.observation_probability
    most = senses.max(axis=1, where=reached, initial=0.0)
    least = senses.min(axis=1, where=reached, initial=1.0)
    for e, target in np.argwhere(reached.any(axis=1) & (most - least > _SAME)):
        sources = [momdp.x_names[x] for x in np.flatnonzero(reached[e, :, target])]
        raise SettingsError(
            f"{momdp.behavior_names[e]!r} arrives at {momdp.x_names[target]!r} from {sources} with "
            f"a percept in {least[e, target]:.0%} to {most[e, target]:.0%} of the cases; the files "
            "know only Pr(z | action, x'). Give the diagram a state of its own for each."
        )
    return np.asarray(most)


def _identifiers(names: Iterable[str], taken: Iterable[str]) -> tuple[str, ...]:
    """Turn names into identifiers of the formats, all different."""
    used = {*taken, *_RESERVED}
    identifiers = []
    for name in names:
        word = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
        word = word if word[:1].isalpha() else f"n{word}"
        while word in used:
            word += "_"
        used.add(word)
        identifiers.append(word)
    return tuple(identifiers)
