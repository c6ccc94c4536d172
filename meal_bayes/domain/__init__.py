"""The vocabulary: attributes, behaviors, transition diagrams, queries.

In: TOML tables (shipped or one's own). Out: `Domain`, `TransitionDiagram`, `Query`.
"""

from meal_bayes.domain.diagram import TERMINAL, Effect, TransitionDiagram
from meal_bayes.domain.domain import Behavior, Domain, learn_answers, learn_success
from meal_bayes.domain.event import Event, Payoffs
from meal_bayes.domain.query import Query
from meal_bayes.domain.reading import read_event, read_query, read_question
from meal_bayes.domain.tables import (
    domain_from_table,
    domain_names,
    domain_table,
    load_domain,
    with_attribute,
)
from meal_bayes.domain.words import unknown

__all__ = [
    "TERMINAL", "Behavior", "Domain", "Effect", "Event", "Payoffs", "Query", "TransitionDiagram",
    "domain_from_table", "domain_names", "domain_table", "learn_answers", "learn_success",
    "load_domain", "read_event", "read_query", "read_question", "unknown", "with_attribute",
]  # fmt: skip
