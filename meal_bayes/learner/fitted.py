"""What agents make of the record: classifiers, tables, a posterior (Alg. 2, l. 6 and 18-23).

Or of a percept table without an object (Alg. 1). `refit` learns everything anew: classifiers, how
much objects differ, how their percepts err together. Between refits these are constant, and a label
is a conjugate update by the percepts of objects that no classifier has seen.
"""

from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, Knowledge, Progress, information_value, knowledge_without
from meal_bayes.agents.knowledge import base_rates, knowledge_of
from meal_bayes.arrays import Rows
from meal_bayes.datasets import PerceptTable, TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.domain import Query, learn_success
from meal_bayes.errors import SettingsError
from meal_bayes.learner.experience import GIVEN, Experience
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import (
    Perceiver,
    Perception,
    PerceptionSettings,
    RecordedPercepts,
    SampledPercepts,
    fit_and_validate,
    fit_spaces,
    with_classifier,
)
from meal_bayes.planners import Policy
from meal_bayes.planners.pomcp.policy import POMCPPolicy
from meal_bayes.robots.recorded import replayable

_SAME = 0.05  # success probabilities that differ by less are not planned with anew
Asked = tuple[Query, bytes]  # and the percepts that a trial can have


@dataclass(eq=False)
class Fitted:
    """Knowledge of one agent from the record; made by `refit`, updated by `update`."""

    experience: Experience
    agent: Agent
    settings: LearnerSettings
    perception: Perception
    knowledge: Knowledge  # now
    refitted: Knowledge  # at the refit
    seen: NDArray[np.bool_]  # (O,E,P) whether classifiers have seen an object
    levels: Rows  # (n,P) percepts of all instances; -1 unknown
    counted: Rows  # (n,P) labels that were counted since the refit; -1 none
    # Models and policies of queries, without and with a bonus, as long as they hold.
    answering: dict[Asked, tuple[MOMDP, Policy]] = field(default_factory=dict)
    exploring: dict[Asked, POMCPPolicy] = field(default_factory=dict)
    limit = np.inf  # percepts that a trial can have; a robot may know better

    @classmethod
    def refit(cls, experience: Experience, agent: Agent, settings: LearnerSettings) -> Self:
        """Learn everything anew from the record."""
        data, rows, gathered = experience.data(memory=agent.memory)
        instances = experience.instances.values
        pretraining = instances[:, 4] == GIVEN
        training = _some(gathered, np.asarray((gathered.labels >= 0).any(axis=1)))
        perceives = PerceptionSettings(levels=agent.levels, by_object=settings.by_object)
        spaces = None
        if settings.classifier is not None:
            perceives = with_classifier(settings.classifier, levels=agent.levels)
        elif agent.whiten:
            spaces = fit_spaces(data, gathered, whiten=True)
        else:  # the spaces of what it was given hold for good
            first = pretraining[rows]
            others = ~np.isin(gathered.behavior, gathered.behavior[first])
            spaces = fit_spaces(data, _some(gathered, first | others))
        perception, counts = fit_and_validate(data, training, settings=perceives, spaces=spaces)
        labels = data.labels
        if not data.objects:  # nothing is known: one object of which nothing is
            counts = np.zeros((1, *counts.shape[1:]), np.int64)
            labels = np.full(counts.shape[:2], -1, np.int8)
        known = knowledge_of(experience.domain, counts, labels, object_level=agent.object_level)
        objects, p, e = counts.shape[:3]
        seen = np.zeros((objects, e, p), np.bool_)
        if settings.posterior is None:
            np.logical_or.at(seen, (training.object, training.behavior), training.labels >= 0)
        else:
            known = replace(known, posterior=settings.posterior)
            seen[instances[pretraining, 0]] = True
        empty = Rows(np.int8, p), Rows(np.int8, p)
        fit = cls(experience, agent, settings, perception, known, known, seen, *empty)
        fit.update(np.arange(len(instances)))
        return fit

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now, conjugately."""
        experience, domain = self.experience, self.knowledge.domain
        self._perceive_new()
        o = experience.instances.values[rows, 0]
        labels = experience.labels_of(rows, memory=self.agent.memory)
        labels = np.where(self.used(rows) | (self.levels.values[rows] < 0), -1, labels)
        moved = np.zeros(len(domain.attributes), np.bool_)
        for n in dict.fromkeys(o[(labels != self.counted.values[rows]).any(axis=1)].tolist()):
            before = self._counts(experience.gathered(n))
            self.counted.values[rows[o == n]] = labels[o == n]
            after = self._counts(experience.gathered(n))
            posterior = self.knowledge.posterior.update(after, before)
            self.knowledge = replace(self.knowledge, posterior=posterior)
            moved |= (before != after).any(axis=(1, 2, 3))
        rates = base_rates(experience.known.values)
        if self.agent.base_rates:
            moved |= rates != self.knowledge.base_rates
        self.knowledge = replace(self.knowledge, base_rates=rates)
        self.answering = {
            (query, limit): answer
            for (query, limit), answer in self.answering.items()
            if not moved[domain.columns(query.attributes)].any()
        }
        self._succeed()

    def _succeed(self) -> None:
        """Learn how often behaviors succeed, where that is now another by more than 1 in 20."""
        if not self.settings.learn_success:
            return
        domain = learn_success(self.experience.domain, self.experience.attempts)
        pairs = zip(domain.diagram.effects, self.knowledge.domain.diagram.effects, strict=True)
        if any(abs(now.probability - used.probability) > _SAME for now, used in pairs):
            self.knowledge = replace(self.knowledge, domain=domain)
            self.answering, self.exploring = {}, {}

    def _perceive_new(self) -> None:
        """Perceive the instances since the last time: those without features as they were shown."""
        experience, k = self.experience, self.agent.levels
        first, domain = len(self.levels), experience.domain
        instances = experience.instances.values[first:]
        shown = experience.levels.values[first:]
        levels = np.where(instances[:, 4:] == k, shown, -1).astype(np.int8)
        sensed, log_odds = instances[:, 3] >= 0, np.zeros(levels.shape)
        for name, classifier in self.perception.classifiers.items():
            rows = np.flatnonzero(sensed & (instances[:, 1] == domain.behavior_index(name)))
            if len(rows):
                features = {
                    modality: experience.features[name, modality].values[instances[rows, 3]]
                    for modality in classifier.spaces
                }
                log_odds[rows] = classifier.log_odds(features)
        levels[sensed] = levels_of(round_log_odds(log_odds[sensed]), BIN_EDGES, k)
        self.levels.extend(levels)
        self.counted.extend(np.full_like(levels, -1))

    def _counts(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Count the percepts of instances (k,) as they are labelled, (P,E,2,K)."""
        labels, levels = self.counted.values[rows], self.levels.values[rows]
        counts = np.zeros(self.knowledge.posterior.counts.shape, np.int64)
        k, p = np.nonzero(labels >= 0)
        e = self.experience.instances.values[rows[k], 1]
        np.add.at(counts, (p, e, labels[k, p], levels[k, p]), 1)
        return counts

    @cached_property
    def information(self) -> NDArray[np.float64]:
        """Value of information (P,E) at the refit, s a query."""
        return information_value(
            self.refitted, reward=self.settings.reward, discount=self.agent.discount
        )

    def used(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which labels of instances (k,) the last refit used, (k,P)."""
        o, e = self.experience.instances.values[rows, :2].T
        seen = np.concatenate([self.seen, np.zeros_like(self.seen[:1])])  # of those met since, none
        return np.asarray(seen[np.minimum(o, len(self.seen)), e])

    def progress(self, queries: float, object_name: str | None = None) -> Progress:
        """Return what has been learned so far, for a bonus; without a name, of a new object."""
        experience, memory = self.experience, self.agent.memory
        labelled = experience.labelled(memory=memory)
        counted = experience.labelled(memory=memory, given=self.settings.count_given)
        o = None if object_name is None else experience.objects.get(object_name)
        e, p = labelled.shape[1:]
        fresh, labeled = np.ones((p, e), bool), np.zeros(p, bool)
        if o is not None:
            fresh, labeled = labelled[o].T == 0, (experience.known.values[o] >= 0) & memory
        return Progress(
            knowledge=self.knowledge,
            valued=lambda: self.information,
            queries=queries,
            unit=self.settings.unit or max(1.0, float(counted.max(initial=0)) * len(counted)),
            instances=counted.sum(axis=0).T,
            objects=(labelled > 0).sum(axis=0).T,
            fresh=fresh,
            labeled=labeled,
        )


@dataclass(eq=False)
class HeldOut:
    """Knowledge of one agent about one object, of which neither recordings nor labels enter it."""

    table: PerceptTable  # with labels that were told of objects that had none
    agent: Agent
    settings: LearnerSettings
    object_index: int  # of the object that is left out

    @cached_property
    def knowledge(self) -> Knowledge:
        """What is learned from all objects but this one."""
        known = knowledge_without(
            self.table, self.object_index, levels=self.agent.levels,
            object_level=self.agent.object_level,
        )  # fmt: skip
        posterior = self.settings.posterior
        return known if posterior is None else replace(known, posterior=posterior)

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,)."""
        counts = replayable(self.table)[self.object_index]
        return np.where(self.settings.percepts == "recorded", counts, np.inf)

    @cached_property
    def perceiver(self) -> Perceiver:
        """What shows percepts: classifiers that never saw the object, or the model itself."""
        if self.settings.percepts == "recorded":
            return RecordedPercepts(self.table, self.agent.levels)
        return sampled(self.knowledge, self.table.labels)


class Fits:
    """A `Fitted` of each agent that asked, or a `HeldOut` of each object, until all is made anew.

    That is when labeled instances have grown by a fraction, `refit_every`.
    """

    def __init__(
        self, experience: Experience, settings: LearnerSettings, refit_every: float | None
    ) -> None:
        if refit_every is not None and not refit_every > 0:
            raise SettingsError(f"refit_every is {refit_every}; give a number above 0, or None.")
        self.experience, self.settings, self.refit_every = experience, settings, refit_every
        self.growth = [0, 0]  # labeled instances at the last refit, and since
        self._made: list[Fitted] = []
        self._held: dict[int, list[HeldOut]] = {}

    def of(self, agent: Agent) -> Fitted:
        """Return what an agent makes of the record, made when it is first needed."""
        for fit in self._made:
            if fit.agent == agent:
                return fit
        if not self._made:
            labels = self.experience.labels_of(slice(None), memory=agent.memory)
            self.growth = [int((labels >= 0).sum()), 0]
        self._made.append(Fitted.refit(self.experience, agent, self.settings))
        return self._made[-1]

    def held_out(self, table: PerceptTable, agent: Agent, o: int) -> HeldOut:
        """Return what an agent makes of the objects of a table but one.

        A label that was told of an object without one is training data of the others.
        """
        for fit in self._held.setdefault(o, []):
            if fit.agent == agent:
                return fit
        told = self.experience.labels_for(table.objects)
        labeled = replace(table, labels=np.where(table.labels < 0, told, table.labels))
        self._held[o].append(HeldOut(labeled, agent, self.settings, o))
        return self._held[o][-1]

    def restore(self, fit: Fitted, growth: list[int]) -> None:
        """Restore what an agent made of the record."""
        fit.update(np.empty(0, np.intp))
        self._made, self.growth = [fit], growth

    def clear(self) -> None:
        """Let everything be made anew when it is next needed."""
        self._made, self._held = [], {}

    def update(self, rows: NDArray[np.intp], labeled: int = 0) -> None:
        """Count instances (k,) with the labels that they have now, some new; refit where due."""
        self._held = {}
        for fit in self._made:
            fit.update(rows)
        self.growth[1] += labeled
        before, grown = self.growth
        if self.refit_every is not None and grown >= max(self.refit_every * before, 1):
            self.clear()

    def withdraw(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) of which labels were forgotten; refit where these were used."""
        if any(fit.used(rows).any() for fit in self._made):
            self.clear()
        self.update(rows)


def sampled(knowledge: Knowledge, labels: NDArray[np.int8]) -> SampledPercepts:
    """Return what draws percepts of objects with labels (O,P) from the tables that are known."""
    every = range(len(knowledge.domain.attributes))
    confusion, _ = knowledge.posterior.select(every, exact=True)
    return SampledPercepts(knowledge.domain, labels, confusion)


def _some(gathered: TrainingSet, chosen: NDArray[np.bool_]) -> TrainingSet:
    return TrainingSet(*(column[chosen] for column in astuple(gathered)))
