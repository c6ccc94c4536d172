"""The tasks of single questions."""

import secrets
from collections.abc import Sequence

from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import Domain, Query
from meal_bayes.learner.experience import Key
from meal_bayes.trials import Task

Question = str | Sequence[str] | Query | Task


def replay_task(query: Query, table: PerceptTable, name: str, key: str | int | None = None) -> Task:
    """Build the task of a query about an object of a percept table; `key` names other streams."""
    index = object_index(table.objects, name)
    streams: Key = (table.domain.data, "ask", name, *query.attributes)
    if key is not None:
        streams = (*streams, "key", key)
    return Task(_question(query), query, index, name, streams)


def live_task(
    query: Query, domain: Domain, key: str | int, object_name: str | None
) -> tuple[Task, Key]:
    """Build the task of a query about the object in front of a robot, and the key of its streams.

    The task's own key has an identity that no other trial has, of whatever session, nor has an
    object without a name. What is drawn does not depend on it, but on `key`.
    """
    identity = secrets.token_hex(8)
    name = f"object {identity}" if object_name is None else object_name
    streams = f"object {key}" if object_name is None else object_name
    task = Task(
        _question(query), query, -1, name, (domain.data, "live", identity, *query.attributes)
    )
    return task, (domain.data, "live", key, streams, *query.attributes)


def _question(query: Query) -> str:
    return f"{query.report_name([True] * len(query))}?"
