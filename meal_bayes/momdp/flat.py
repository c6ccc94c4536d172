"""The (x, y) POMDP as dense arrays, for generic solvers and file formats: small queries only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.momdp.model import MOMDP

MAX_ENTRIES = 20_000_000  # of O, 160 MB


@dataclass(frozen=True, slots=True)
class FlatPOMDP:
    """A POMDP of dense arrays; of a MOMDP: state x * Y + y, then `term`; "none" is the last z.

    What generic solvers cannot hold is left out: percepts never run out (`limit`), and every
    behavior may be chosen everywhere, with the illegal ones' cost and consequence.

    Attributes
    ----------
    state_names : (S,).
    action_names : (A,).
    observation_names : (Z,) percept levels by attribute, such as "1-0".
    transition : (A,S,S) Pr(s' | s, a).
    observation : (A,S,S,Z) Pr(z | a, s, s'); it depends on s where a behavior that keeps x fails.
    reward : (S,A).
    start : (S,) belief before the trial.
    discount : factor a step.
    """

    state_names: tuple[str, ...]
    action_names: tuple[str, ...]
    observation_names: tuple[str, ...]
    transition: NDArray[np.float64]
    observation: NDArray[np.float64]
    reward: NDArray[np.float64]
    start: NDArray[np.float64]
    discount: float

    def __post_init__(self) -> None:
        for name in ("transition", "observation", "reward", "start"):
            set_frozen(self, **{name: freeze(getattr(self, name))})


def percept_probabilities(momdp: MOMDP, behavior: int) -> NDArray[np.float64]:
    """Compute Eq. 8, Pr(percept vector | y) when one comes: (Y,K^N), first attribute leading."""
    joint = np.ones((1, 1))
    for rows in momdp.confusion[:, behavior]:  # (2,K)
        joint = np.kron(joint, rows)
    return freeze(joint)


def flatten(momdp: MOMDP) -> FlatPOMDP:
    """Convert a MOMDP to dense arrays.

    Raises
    ------
    SettingsError : finite precision, whose state would have to carry the percept counts; or too
        many attributes for dense arrays.
    """
    n_y, n_z = 2 ** len(momdp.query), momdp.levels ** len(momdp.query) + 1
    size = momdp.n_actions * momdp.n_states**2 * n_z
    if size > MAX_ENTRIES:
        raise SettingsError(
            f"{len(momdp.query)} attributes make {size:.1g} observation probabilities; dense "
            f"arrays end at {MAX_ENTRIES:.0e}. Ask fewer attributes or use a factored planner."
        )
    if not momdp.class_is_truth:
        raise SettingsError(
            "A flat POMDP knows one latent class a truth; build it without `latent_classes`."
        )
    if not np.isinf(momdp.precision).all():
        raise SettingsError(
            "A flat POMDP cannot hold rows of finite precision; build the MOMDP with "
            "precision=inf (Eq. 8) for generic solvers."
        )
    return FlatPOMDP(
        state_names=_state_names(momdp),
        action_names=tuple(momdp.action_name(a) for a in range(momdp.n_actions)),
        observation_names=_observation_names(momdp),
        transition=_transition(momdp, n_y),
        observation=_observation(momdp, n_y, n_z),
        reward=reward_table(momdp, n_y),
        start=_start(momdp, n_y),
        discount=momdp.discount,
    )


def _state_names(momdp: MOMDP) -> tuple[str, ...]:
    values = momdp.query.report_names
    return (*(f"{x}, {v}" for x in momdp.x_names[:-1] for v in values), momdp.x_names[-1])


def _observation_names(momdp: MOMDP) -> tuple[str, ...]:
    shape = (momdp.levels,) * len(momdp.query)
    return (*("-".join(map(str, index)) for index in np.ndindex(shape)), "none")


def _transition(momdp: MOMDP, n_y: int) -> NDArray[np.float64]:
    end, living = momdp.terminal, momdp.terminal * n_y
    flat = np.zeros((momdp.n_actions, momdp.n_states, momdp.n_states))
    flat[:, :, -1] = 1.0  # reports, and term itself
    for e in range(momdp.n_behaviors):
        flat[e, :living, :living] = np.kron(momdp.transition[e, :end, :end], np.eye(n_y))
        flat[e, :living, -1] = np.repeat(momdp.transition[e, :end, end], n_y)
    return flat


def _observation(momdp: MOMDP, n_y: int, n_z: int) -> NDArray[np.float64]:
    end = momdp.terminal
    flat = np.zeros((momdp.n_actions, momdp.n_states, momdp.n_states, n_z))
    flat[..., -1] = 1.0
    blocks = flat[:, :-1, :-1].reshape(momdp.n_actions, end, n_y, end, n_y, n_z)
    for e in range(momdp.n_behaviors):
        percepts = percept_probabilities(momdp, e)  # (Y,Z-1)
        comes = momdp.observation_probability[e, :end, :end]
        for y in range(n_y):
            blocks[e, :, y, :, y, :-1] = comes[..., None] * percepts[y]
            blocks[e, :, y, :, y, -1] = 1.0 - comes
    flat[:, :-1, :-1] = blocks.reshape(momdp.n_actions, end * n_y, end * n_y, n_z)
    return flat


def reward_table(momdp: MOMDP, n_y: int) -> NDArray[np.float64]:
    """Compute the reward (S,A) of every action, `term` last: Eq. 4, and Eq. 11 if shaped.

    Parameters
    ----------
    momdp : the problem.
    n_y : 2^N, value vectors.
    """
    reward = np.zeros((momdp.terminal, n_y, momdp.n_actions))
    truth = momdp.query.values.astype(int)  # (Y,N)
    agrees = (truth[:, None] == truth).astype(float)  # (Y,Y,N) report against truth
    bonus = momdp.bonus[np.arange(truth.shape[1]), :, truth].sum(axis=1)  # (Y,E)
    for x in range(momdp.terminal):
        likeliest = momdp.transition[:, x].argmax(axis=1)  # x', the only one where it is illegal
        cost = [momdp.step_cost(x, e, to) for e, to in enumerate(likeliest)]
        reward[x, :, : momdp.n_behaviors] = np.where(momdp.legal[x], bonus, 0.0) - cost
        reward[x, :, momdp.n_behaviors :] = momdp.report_reward(agrees)
    return np.concatenate([reward.reshape(-1, momdp.n_actions), np.zeros((1, momdp.n_actions))])


def _start(momdp: MOMDP, n_y: int) -> NDArray[np.float64]:
    values = momdp.query.values  # (Y,N)
    belief = np.zeros(momdp.n_states)
    first = momdp.start * n_y
    belief[first : first + n_y] = np.where(values, momdp.prior, 1 - momdp.prior).prod(axis=1)
    return belief
