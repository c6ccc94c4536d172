"""HTML representation of a learner in a notebook: what it learned about each attribute."""

from dataclasses import replace
from html import escape
from typing import NamedTuple

from meal_bayes.agents import Agent, Knowledge
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.datasets import PerceptTable
from meal_bayes.learner import views
from meal_bayes.learner.experience import Experience, Labels
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.look import percent, table_html
from meal_bayes.perception.confusion import percept_counts

_HEADER = (
    "attribute",
    "labels: yes, no",
    "base rate",
    "best behavior",
    "Youden's J",
    "percept right",
)
_READING = (
    "The last two columns are of percepts of an object without labels. Youden's J is the "
    "probability of a percept yes if the attribute is true, minus that if it is false. The last "
    "column is the probability that a percept is right, at the base rate."
)
NO_LABEL = "Nothing is learned yet, as there is no label. "
WITH_NOTHING = (
    'Ask, and tell what was true: `trial = learner.ask("...", robot)`, `learner.tell(trial, '
    "{{{name!r}: True}})`; or begin with recordings: `learner.fit(dataset)`."
)
WITH_RECORDINGS = (
    "Tell what is true of an object: `learner.tell(trial, {{{name!r}: True}})`, or by the object's "
    "name."
)


class JoinedRecordings(NamedTuple):
    """Number of recordings of the last data set that were added to the experience."""

    joined: int = 0
    offered: int = 0
    record_rows: int = 0  # `views.rows` at that time

    def text(self, record: Experience) -> str:
        """Return the numbers as a clause, or nothing if more was recorded since."""
        if not self.offered or self.record_rows != views.rows(record):
            return ""
        n_known = self.offered - self.joined
        return f"; of the last data set {self.joined} joined, {n_known} were known"


def next_html(attribute: str, recordings: int) -> str:
    """Return what to do next with a learner without labels; the example names an attribute."""
    way = WITH_RECORDINGS if recordings else WITH_NOTHING
    return f"<p>{escape(NO_LABEL + way.format(name=attribute))}</p>"


def table_knowledge(table: PerceptTable, agent: Agent, settings: LearnerSettings) -> Knowledge:
    """Return what is learned from a percept table, with held-out percepts of each object."""
    counts = percept_counts(table, agent.levels)
    knowledge = knowledge_of(table.domain, counts, table.labels, object_level=agent.object_level)
    if settings.posterior is None:
        return knowledge
    return replace(knowledge, posterior=settings.posterior)


def learned_html(knowledge: Knowledge, labels: Labels) -> str:
    """Return what was learned as an HTML table, a row for each attribute.

    Parameters
    ----------
    knowledge : Knowledge
        What was learned.
    labels : Labels
        (O,P) labels of the objects from which it was learned; -1 unknown.
    """
    domain = knowledge.domain
    rows = []
    for p, name in enumerate(domain.attributes):
        rate = float(knowledge.base_rates[p])
        number = f"{(labels[:, p] == 1).sum()}, {(labels[:, p] == 0).sum()}"
        best = knowledge.most_telling(p)
        cells = ["none yet", "", ""]
        if best is not None:
            behavior, youden, right = best
            cells = [escape(behavior), f"{youden:.2f}", percent(right)]
        rows.append([escape(name), number, percent(rate), *cells])
    objects = int((labels >= 0).any(axis=1).sum())
    title = f"{domain.name}: what was learned from {objects} objects with labels"
    return f"{table_html(title, _HEADER, rows)}<p>{_READING}</p>"
