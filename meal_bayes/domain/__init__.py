"""Domains: attributes, behaviors, transition diagrams and queries.

The input is a TOML table, of the package or your own. The output is a `Domain`, a
`TransitionDiagram` or a `Query`.
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
