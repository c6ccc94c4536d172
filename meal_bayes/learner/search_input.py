"""What a search is given, checked: options, objects, payoffs, and who is left to learn from."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from meal_bayes.arrays import is_number
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.display import warn_caller
from meal_bayes.domain import Payoffs, Query
from meal_bayes.domain.words import denied, doubled
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.trial_log.schema import MOST_OBJECTS
from meal_bayes.trials import Step
from meal_bayes.untrusted import LARGEST, name_fault


class SearchOptions(TypedDict, total=False):
    """What `Learner.find` takes besides; `Learner.begin_find` says what each means."""

    truth: Mapping[str, Mapping[str, bool]] | None
    payoffs: Sequence[float] | None
    none: float
    turn_cost: float
    learn: bool
    log: str | Path | None
    key: str | int | None
    max_steps: int
    max_cost: float | None
    on_step: Callable[[Step], None] | None


def checked_objects(objects: Any) -> list[str]:
    """Return the names of objects, or numbers for names."""
    if isinstance(objects, int) and not isinstance(objects, bool):
        if not 1 <= objects <= MOST_OBJECTS:
            raise SettingsError(f"objects is {objects}; expected 1 to {MOST_OBJECTS}.")
        return [str(number) for number in range(1, objects + 1)]
    sequence = isinstance(objects, Sequence) and not isinstance(objects, str)
    if not sequence or not all(isinstance(name, str) for name in objects):
        raise SettingsError(f"objects is {objects!r:.60}; give names, or how many there are.")
    if not 1 <= len(objects) <= MOST_OBJECTS:
        raise SettingsError(f"{len(objects)} objects; give 1 to {MOST_OBJECTS} of them.")
    for name in objects:
        if bad := name_fault(name):
            raise SettingsError(f"The object's name {name!a:.60} {bad}; give another.")
    if fault := doubled("object", objects):
        raise SettingsError(fault)
    return list(objects)


def claim_payoffs(usual_claim: tuple[float, float], payoffs: Any, none: Any) -> Payoffs:
    """Return what yes and no about an object earn: as a claim of it, and as none of them.

    Parameters
    ----------
    usual_claim : tuple[float, float]
        What a right and a wrong claim earn where nobody says it.
    payoffs : Any
        What they earn; None: as usual.
    none : Any
        What "none of them" earns.

    Raises
    ------
    QueryError
        What are no numbers, or by which nothing would be searched.
    """
    if payoffs is None:
        right_claim, wrong_claim = usual_claim
    elif isinstance(payoffs, Sequence) and not isinstance(payoffs, str) and len(payoffs) == 2:
        right_claim, wrong_claim = payoffs
    else:
        raise QueryError(
            f"payoffs are {payoffs!r:.60}; give two numbers: of a right and a wrong claim."
        )
    numbers = (right_claim, wrong_claim, none)
    in_range = all(is_number(value) and abs(value) <= LARGEST for value in numbers)
    if not in_range or none < wrong_claim:
        earned = ", ".join(f"{value!r:.20}" for value in numbers)
        raise QueryError(
            f"A right claim, a wrong one and none of them earn {earned}; give numbers up to "
            f"{LARGEST:g}, of which a wrong claim has the least."
        )
    if not none < right_claim:
        raise QueryError(
            f"None of them earns {none:g}, a right claim {right_claim:g}: nothing would be "
            "searched; give `none` less."
        )
    return Payoffs.of((right_claim, wrong_claim, none, none))


def check_others(table: PerceptTable, names: Sequence[str], query: Query) -> None:
    """Refuse a search that leaves no object of a table to learn an attribute from.

    It is warned of where those that are left are all true, or all false.
    """
    rows = [object_index(table.objects, name) for name in names]
    labels = np.delete(table.labels, rows, axis=0)
    for name, column in zip(query.attributes, table.domain.columns(query.attributes), strict=True):
        lacking = f"Beside these {len(names)} objects the table has none"
        if not (labels[:, column] >= 0).any():
            raise SettingsError(
                f"{lacking} of which it is known whether it is {name}: nobody is left to "
                "learn from. Search fewer of its objects."
            )
        for value, such in ((1, name), (0, denied(name))):
            if not (labels[:, column] == value).any():
                warn_caller(
                    f"{lacking} that is {such}: how such an object is perceived is a guess."
                )
