"""What a learner is made of: a source of knowledge for each kind of data, and a given posterior."""

from typing import TYPE_CHECKING

from meal_bayes.agents import Agent
from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError
from meal_bayes.learner.fitted import Fitted
from meal_bayes.learner.replayed import Replayed
from meal_bayes.posterior import ConfusionPosterior

if TYPE_CHECKING:
    from meal_bayes.learner.learner import Learner


def source_of(learner: "Learner", data: Dataset | PerceptTable) -> Replayed | Fitted:
    """Return what learns from recordings, or from a percept table; nothing is fitted yet.

    Raises
    ------
    SettingsError : data of another domain.
    """
    found, domain = data.domain, learner.domain
    if (found.attributes, found.behaviors) != (domain.attributes, domain.behaviors):
        raise SettingsError(
            f"Attributes or behaviors of the data's domain {found.name!r} differ from those of "
            f"{domain.name!r}; load the data for this domain."
        )
    agent, seed, reward, own = learner.agent, learner.seed, learner.reward, learner.posterior
    if isinstance(data, PerceptTable):
        return Replayed(data, agent, seed, learner.percepts, reward, own)
    return Fitted(data, agent, learner.classifier, seed, reward, own)


def own_posterior(posterior: object, domain: Domain, agent: Agent) -> ConfusionPosterior | None:
    """Return a posterior of one's own, laid out for a domain; None where none is given.

    Raises
    ------
    SettingsError : one of another shape than the agent plans with.
    DataError : draws that do not fit the domain.
    """
    if posterior is None:
        return None
    if not isinstance(posterior, ConfusionPosterior):
        posterior = ConfusionPosterior.from_idata(posterior, domain)
    shape = posterior.counts.shape
    expected = (len(domain.attributes), len(domain.behaviors), 2, agent.levels)
    if shape != expected:
        raise SettingsError(
            f"The posterior has shape {shape}, expected {expected}: attributes and behaviors of "
            f"the domain, truths, and the {agent.levels} levels of the agent {agent.name!r}."
        )
    return posterior
