"""`ask`: one question about one object, answered by one agent."""

from collections.abc import Callable, Sequence
from pathlib import Path

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.morc import Morc
from meal_bayes.agents.recipes import load_agent
from meal_bayes.agents.trial import Step, Task, Trial
from meal_bayes.datasets import PerceptTable, load_percepts, object_index
from meal_bayes.domain import read_query
from meal_bayes.errors import SettingsError


def ask(
    question: str | Sequence[str],
    *,
    dataset: str | Path | PerceptTable,
    object: str,
    agent: str | Agent = "bayes",
    seed: int = 0,
    percepts: str = "recorded",
    reward: float | None = None,
    on_step: Callable[[Step], None] | None = None,
) -> Trial:
    """Answer a question about an object that was left out of everything the agent learned.

    Equal arguments give equal trials.

    Parameters
    ----------
    question : a sentence ("Is it heavy?"), a comma list, or a list of attribute names.
    dataset : a shipped data set (roc36, ispy32, cy101), the path of an .npz of one's own made by
        `save_percepts`, or a percept table.
    object : the object's name.
    agent : a named agent, or a recipe.
    seed : of failures, of the recordings' order, and of planning.
    percepts : "recorded", or "model": drawn from the learned confusion matrices.
    reward : r+ = -r-, the domain's by default.
    on_step : called after every step.

    Raises
    ------
    SettingsError : an unknown data set, object or agent.
    QueryError : a question that names no attribute, an unknown one, or one twice.
    """
    table = dataset if isinstance(dataset, PerceptTable) else load_percepts(dataset)
    task = question_task(question, table, object)
    recipe = agent if isinstance(agent, Agent) else load_agent(agent)
    if seed < 0:
        raise SettingsError(f"seed is {seed}; give a whole number, 0 or more.")
    return Morc(table, recipe, seed, percepts, reward).run(task, on_step=on_step)


def question_task(question: str | Sequence[str], table: PerceptTable, name: str) -> Task:
    """Make the task of a question about the object called `name`; raises as `ask` does."""
    query = read_query(question, table.domain)
    index = object_index(table.objects, name)
    key = (table.domain.data, "ask", name, *query.attributes)
    return Task(f"{query.report_name([True] * len(query))}?", query, index, name, key)
