"""The tasks of single questions."""

from meal_bayes.agents import Task
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import Domain, Query


def replay_task(query: Query, table: PerceptTable, name: str, key: str | int | None = None) -> Task:
    """Build the task of a query about an object of a percept table; `key` names other streams."""
    index = object_index(table.objects, name)
    streams: tuple[str | int, ...] = (table.domain.data, "ask", name, *query.attributes)
    if key is not None:
        streams = (*streams, "key", key)
    return Task(_question(query), query, index, name, streams)


def live_task(query: Query, domain: Domain, key: str | int, object_name: str | None) -> Task:
    """Build the task of a query about the object in front of a robot; `key` names its streams."""
    name = f"object {key}" if object_name is None else object_name
    streams: tuple[str | int, ...] = (domain.data, "live", key, name, *query.attributes)
    return Task(_question(query), query, -1, name, streams)


def _question(query: Query) -> str:
    return f"{query.report_name([True] * len(query))}?"
