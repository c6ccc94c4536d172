"""The tasks of single questions."""

from meal_bayes.agents import Task
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.domain import Domain, Query


def replay_task(query: Query, table: PerceptTable, name: str) -> Task:
    """Make the task of a query about an object of a percept table."""
    index = object_index(table.objects, name)
    key = (table.domain.data, "ask", name, *query.attributes)
    return Task(_question(query), query, index, name, key)


def live_task(query: Query, domain: Domain, number: int, object_name: str | None) -> Task:
    """Make the task of a query about the object in front of a robot; `number` names its streams."""
    name = f"object {number}" if object_name is None else object_name
    key: tuple[str | int, ...] = (domain.data, "live", number, name, *query.attributes)
    return Task(_question(query), query, -1, name, key)


def _question(query: Query) -> str:
    return f"{query.report_name([True] * len(query))}?"
