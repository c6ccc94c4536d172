"""The (x, y) POMDP as dense arrays, for generic solvers: small queries only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.momdp.exchange import (
    check_flat,
    legal_transition,
    percept_probabilities,
    prior_of,
    rewards,
)
from meal_bayes.momdp.model import MOMDP

_LARGEST = 20_000_000  # entries of O, 160 MB


@dataclass(frozen=True, slots=True)
class FlatPOMDP:
    """A POMDP of dense arrays; of a MOMDP: state x * Y + y, then `term`; "none" is the last z.

    What generic solvers cannot hold is left out: percepts never run out (`limit`). They know no
    legality either: illegal behaviors end the trial at a price below every report.

    Attributes
    ----------
    state_names : tuple[str, ...]
        (S,).
    action_names : tuple[str, ...]
        (A,).
    observation_names : tuple[str, ...]
        (Z,) percept levels by attribute, such as "1-0".
    transition : NDArray[np.float64]
        (A,S,S) Pr(s' | s, a).
    observation : NDArray[np.float64]
        (A,S,S,Z) Pr(z | a, s, s'); it depends on s where a behavior that keeps x fails.
    reward : NDArray[np.float64]
        (S,A).
    start : NDArray[np.float64]
        (S,) belief before the trial.
    discount : float
        Factor a step.
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


def flatten(momdp: MOMDP) -> FlatPOMDP:
    """Convert a MOMDP to dense arrays.

    Raises
    ------
    SettingsError
        Finite precision, whose state would have to carry the percept counts; several latent
        classes a truth; or too many attributes for dense arrays.
    """
    n_y, n_z = momdp.query.n_values, momdp.levels ** len(momdp.query) + 1
    n_a, end = momdp.n_actions, momdp.terminal
    living = end * n_y  # states but `term`
    check_flat(momdp, n_a * momdp.n_states**2 * n_z, _LARGEST)
    transition = np.zeros((n_a, momdp.n_states, momdp.n_states))
    transition[:, :, -1] = 1.0  # reports, and `term` itself
    observation = np.zeros((n_a, momdp.n_states, momdp.n_states, n_z))
    observation[..., -1] = 1.0
    for e, moves in enumerate(legal_transition(momdp)[:, :end]):
        # y stays: Pr(x', y' | x, y) = Pr(x' | x) [y' = y]
        transition[e, :living, :living] = np.kron(moves[:, :end], np.eye(n_y))
        transition[e, :living, -1] = np.repeat(moves[:, end], n_y)
        comes = momdp.observation_probability[e, :end, :end]
        block = observation[e, :living, :living].reshape(end, n_y, end, n_y, n_z).copy()
        for y, row in enumerate(percept_probabilities(momdp, e)):
            block[:, y, :, y, :-1] = comes[..., None] * row
            block[:, y, :, y, -1] = 1.0 - comes
        observation[e, :living, :living] = block.reshape(living, living, n_z)
    start = np.zeros((end + 1, n_y))
    start[momdp.start] = prior_of(momdp)
    levels = np.ndindex((momdp.levels,) * len(momdp.query))
    values = momdp.query.report_names
    return FlatPOMDP(
        (*(f"{x}, {v}" for x in momdp.x_names[:-1] for v in values), momdp.x_names[-1]),
        tuple(momdp.action_name(a) for a in range(n_a)),
        (*("-".join(map(str, index)) for index in levels), "none"),
        transition,
        observation,
        rewards(momdp).reshape(-1, n_a)[: momdp.n_states],
        start.ravel()[: momdp.n_states],
        momdp.discount,
    )
