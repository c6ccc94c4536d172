"""The task lists of the offline protocol: which object, which query; the same for every agent."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError
from meal_bayes.seeds import stream
from meal_bayes.trials import Task

_LISTED = 200_000  # (object, query) pairs up to which all are listed and shuffled

_Pair = tuple[int, tuple[str, ...]]


def askable(table: PerceptTable) -> tuple[str, ...]:
    """Return the attributes with enough positive and negative objects for the domain."""
    positive, negative = (table.labels == 1).sum(axis=0), (table.labels == 0).sum(axis=0)
    enough = np.minimum(positive, negative) > table.domain.asked_minimum
    return tuple(name for name, ok in zip(table.domain.attributes, enough, strict=True) if ok)


def offline_tasks(table: PerceptTable, n_attributes: int, trials: int, seed: int) -> list[Task]:
    """Draw the tasks of an offline run.

    Objects are uniform; attributes are distinct and uniform among the askable ones. Where the
    domain has groups (ROC36), a query takes one attribute of each of N groups, and in half of the
    trials the values named are the object's own. Each (object, attribute set) comes once, in
    seeded order, before any comes twice.

    Raises
    ------
    SettingsError
        More attributes than can be asked or than any object has labels of, no trials.
    """
    names = askable(table)
    if not 1 <= n_attributes <= len(names):
        raise SettingsError(
            f"{n_attributes} attributes asked; {table.domain.name} has {len(names)} to ask, "
            f"give a number from 1 to {len(names)}."
        )
    if trials < 1:
        raise SettingsError(f"{trials} trials asked; give at least 1.")
    columns = table.domain.columns(names)
    labelled = int((table.labels[:, columns] >= 0).sum(axis=1).max())
    if n_attributes > labelled:
        raise SettingsError(
            f"{n_attributes} attributes asked, but no object has labels of more than {labelled} "
            "of those that can be asked; ask fewer, or label more."
        )
    rng = stream(seed, "tasks", table.domain.data, n_attributes)
    groups, objects = list(table.domain.groups.values()), range(len(table.objects))
    count = len(objects) * math.comb(len(names), n_attributes)
    if groups and n_attributes <= len(groups):
        pairs = _grouped(table, groups, n_attributes, rng)
    elif count > _LISTED:
        pairs = _draws(len(objects), names, n_attributes, count, rng)
    else:
        queries = itertools.combinations(names, n_attributes)
        pairs = _rounds(list(itertools.product(objects, queries)), rng)
    known = dict(zip(table.domain.attributes, (table.labels >= 0).T, strict=True))
    labelled_pairs = (pair for pair in pairs if all(known[name][pair[0]] for name in pair[1]))
    tasks = []
    for index, (o, attributes) in enumerate(itertools.islice(labelled_pairs, trials)):
        name = table.objects[o]
        key: tuple[str | int, ...] = (table.domain.data, index, name, *attributes)
        tasks.append(Task(f"{index:05d} {name}", Query(attributes), o, name, key))
    return tasks


def _draws(
    n_objects: int, names: tuple[str, ...], n: int, pairs: int, rng: np.random.Generator
) -> Iterator[_Pair]:
    """Draw pairs one by one, none twice before all have come."""
    drawn: set[_Pair] = set()
    while True:
        chosen = sorted(rng.choice(len(names), size=n, replace=False))
        pair = int(rng.integers(n_objects)), tuple(names[i] for i in chosen)
        if pair in drawn:
            continue
        drawn.add(pair)
        yield pair
        if len(drawn) == pairs:
            drawn.clear()


def _grouped(
    table: PerceptTable, groups: list[tuple[str, ...]], n: int, rng: np.random.Generator
) -> Iterator[_Pair]:
    """Yield queries that describe the object and queries that do not, in turn (ROC36)."""
    true, false = list[_Pair](), list[_Pair]()
    labels = dict(zip(table.domain.attributes, table.labels.T, strict=True))
    for o in range(len(table.objects)):
        for chosen in itertools.combinations(groups, n):
            for attributes in itertools.product(*chosen):
                values = [int(labels[name][o]) for name in attributes]
                if min(values) >= 0:
                    (true if all(values) else false).append((o, attributes))
    if not true and not false:
        raise SettingsError(
            f"No object has labels of an attribute of each of {n} groups; label more."
        )
    if not true or not false:
        return _rounds(true + false, rng)
    both = zip(_rounds(true, rng), _rounds(false, rng), strict=True)
    return itertools.chain.from_iterable(both)


def _rounds(pairs: list[_Pair], rng: np.random.Generator) -> Iterator[_Pair]:
    """Repeat all pairs without end, each time in another random order."""
    while pairs:
        for i in rng.permutation(len(pairs)):
            yield pairs[i]
