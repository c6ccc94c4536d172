"""Algorithm 2: what an agent makes of the record of a robot that learns while it works.

`refit` learns everything anew: classifiers, how much objects differ, how their percepts err
together. Between refits these are constant, and a label is a conjugate update by the percepts of
objects that no classifier has seen.
"""

from dataclasses import astuple, dataclass, field, replace
from typing import Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Horizon, ITRSBonus, Knowledge, NoBonus, Progress
from meal_bayes.agents.knowledge import base_rates, knowledge_of
from meal_bayes.arrays import Rows
from meal_bayes.datasets import TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.domain import Query, learn_success
from meal_bayes.learner import views
from meal_bayes.learner.experience import GIVEN, NONE, Experience, Key
from meal_bayes.learner.fit import limits_of, problem_of, recognized_labels, sampled, solve
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import (
    Perceiver,
    Perception,
    PerceptionSettings,
    fit_and_validate,
    fit_spaces,
    with_classifier,
)
from meal_bayes.planners import POMCP, Policy, Remembering
from meal_bayes.planners.pomcp.policy import POMCPPolicy
from meal_bayes.trials import Task

_SAME = 0.05  # success probabilities that differ by less are not planned with anew
Asked = tuple[Query, bytes]  # and the percepts that a trial can have


@dataclass(eq=False)
class Online:
    """Knowledge of one agent from the record; made by `refit`, updated by `update`."""

    record: Experience
    agent: Agent
    settings: LearnerSettings
    perception: Perception
    knowledge: Knowledge  # now
    refitted: Knowledge  # at the refit
    percepts: NDArray[np.float64]  # (P,E,2,2) of labeled objects, see `Progress`
    seen: NDArray[np.bool_]  # (O,E,P) whether classifiers have seen an object
    levels: Rows  # (n,P) percepts of all instances; -1 unknown
    counted: Rows  # (n,P) labels that were counted since the refit; -1 none
    # Models and policies of queries, without and with a bonus, as long as they hold.
    answering: dict[Asked, tuple[MOMDP, Policy]] = field(default_factory=dict)
    exploring: dict[Asked, POMCPPolicy] = field(default_factory=dict)

    @classmethod
    def refit(cls, record: Experience, agent: Agent, settings: LearnerSettings) -> Self:
        """Learn everything anew from the record (Alg. 2, l. 6)."""
        data, rows, gathered = views.training(record, memory=agent.memory)
        instances = record.instances.values
        pretraining = instances["origin"] == GIVEN
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
        known = knowledge_of(record.domain, counts, labels, object_level=agent.object_level)
        objects, p, e = counts.shape[:3]
        seen = np.zeros((objects, e, p), np.bool_)
        if settings.posterior is None:
            np.logical_or.at(seen, (training.object, training.behavior), training.labels >= 0)
        else:
            known = replace(known, posterior=settings.posterior)
            seen[instances["object"][pretraining]] = True
        fit = cls(
            record, agent, settings, perception=perception, knowledge=known, refitted=known,
            percepts=_fractions(counts, perception).sum(axis=0), seen=seen,
            levels=Rows(np.int8, p), counted=Rows(np.int8, p),
        )  # fmt: skip
        fit.update(np.arange(len(instances)))
        return fit

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now, conjugately."""
        domain = self.knowledge.domain
        self._perceive_new()
        o = self.record.instances.values["object"][rows]
        labels = views.labels_of(self.record, rows, memory=self.agent.memory)
        labels = np.where(self.used(rows) | (self.levels.values[rows] < 0), -1, labels)
        moved = np.zeros(len(domain.attributes), np.bool_)
        for n in dict.fromkeys(o[(labels != self.counted.values[rows]).any(axis=1)].tolist()):
            before = self._counts(self.record.gathered(n))
            self.counted.values[rows[o == n]] = labels[o == n]
            after = self._counts(self.record.gathered(n))
            gained = _fractions(after, self.perception) - _fractions(before, self.perception)
            self.percepts = self.percepts + gained
            posterior = self.knowledge.posterior.update(after, before)
            self.knowledge = replace(self.knowledge, posterior=posterior)
            moved |= (before != after).any(axis=(1, 2, 3))
        rates = base_rates(self.record.known.values)
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
        domain = learn_success(self.record.domain, views.attempts(self.record))
        pairs = zip(domain.diagram.effects, self.knowledge.domain.diagram.effects, strict=True)
        if any(abs(now.probability - used.probability) > _SAME for now, used in pairs):
            self.knowledge = replace(self.knowledge, domain=domain)
            self.answering = {}
            self.exploring = {}

    def _perceive_new(self) -> None:
        """Perceive the instances since the last time: those without features as they were shown."""
        first = len(self.levels)
        k = self.agent.levels
        instances = self.record.instances.values[first:]
        shown = self.record.levels.values[first:]
        same_scale = (instances["scale"] == k)[:, None]
        levels = np.where(same_scale, shown, -1).astype(np.int8)
        sensed = instances["features"] != NONE
        log_odds = np.zeros(levels.shape)
        for name, classifier in self.perception.classifiers.items():
            e = self.record.domain.behavior_index(name)
            rows = np.flatnonzero(sensed & (instances["behavior"] == e))
            if len(rows):
                features = {
                    modality: self.record.features[name, modality].values[
                        instances["features"][rows]
                    ]
                    for modality in classifier.spaces
                }
                log_odds[rows] = classifier.log_odds(features)
        levels[sensed] = levels_of(round_log_odds(log_odds[sensed]), BIN_EDGES, k)
        self.levels.extend(levels)
        self.counted.extend(np.full_like(levels, -1))

    def _counts(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Count the percepts of instances (k,) as they are labelled, (P,E,2,K)."""
        labels = self.counted.values[rows]
        levels = self.levels.values[rows]
        counts = np.zeros(self.knowledge.posterior.counts.shape, np.int64)
        k, p = np.nonzero(labels >= 0)
        e = self.record.instances.values["behavior"][rows[k]]
        np.add.at(counts, (p, e, labels[k, p], levels[k, p]), 1)
        return counts

    def used(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which labels of instances (k,) the last refit used, (k,P)."""
        instances = self.record.instances.values[rows]
        nothing = np.zeros_like(self.seen[:1])  # of objects met since
        seen = np.concatenate([self.seen, nothing])
        o = np.minimum(instances["object"], len(self.seen))
        return np.asarray(seen[o, instances["behavior"]])

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,): a robot may know better."""
        return np.full(len(self.record.domain.behaviors), np.inf)

    @property
    def perceiver(self) -> Perceiver:
        """The classifiers, or draws from the learned tables in place of what came."""
        drawn = self.settings.drawn
        return self.perception if drawn is None else sampled(self.refitted, drawn)

    def truth(self, query: Query) -> None:
        """Return nothing: of a robot's object it is not known."""

    def progress(self, task: Task, object_name: str | None = None) -> Progress:
        """Return what has been learned so far, for a bonus; without a name, of a new object."""
        memory = self.agent.memory
        labelled = views.labelled(self.record, memory=memory)
        counted = views.labelled(self.record, memory=memory, given=self.settings.count_given)
        o = None if object_name is None else self.record.objects.get(object_name)
        e, p = labelled.shape[1:]
        fresh = np.ones((p, e), bool)
        labeled = np.zeros(p, bool)
        if o is not None:
            fresh = labelled[o].T == 0
            labeled = (self.record.known.values[o] >= 0) & memory
        return Progress(
            knowledge=self.knowledge,
            horizon=Horizon(views.trials_before(self.record, task.key), self.settings.horizon),
            reward=self.settings.reward,
            discount=self.agent.discount,
            percepts=self.percepts,
            told=views.told_fraction(self.record),
            unit=self.settings.unit or max(1.0, float(counted.max(initial=0)) * len(counted)),
            instances=counted.sum(axis=0).T,
            objects=(labelled > 0).sum(axis=0).T,
            fresh=fresh,
            labeled=labeled,
        )

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task, with a bonus if it explores (Alg. 2, l. 7-10)."""
        query = task.query
        exploration = self.agent.exploration
        known = recognized_labels(self, task) is not None
        if not explore or (isinstance(exploration, NoBonus) and not known):
            return self._answer(task, streams, limit)
        momdp = problem_of(self, task, limit)
        momdp = exploration.shape(momdp, self.progress(task, task.object_name))
        if not isinstance(self.agent.solver(self.knowledge.domain, query), POMCP):
            return momdp, solve(self, task, streams, momdp)
        key = query, limits_of(self, limit).tobytes()
        if key not in self.exploring:  # searches of equal queries share a plan library
            usual = problem_of(self, task, limit, recognize=False)
            shaped = exploration.shape(usual, self.progress(task))
            self.exploring[key] = cast(POMCPPolicy, solve(self, task, streams, shaped))
        return momdp, self.exploring[key].sharing_plans(momdp)

    def _answer(self, task: Task, streams: Key, limit: ArrayLike) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task that explores nothing, or return it as it was."""
        exploration = self.agent.exploration
        known = recognized_labels(self, task) is not None
        key = task.query, limits_of(self, limit).tobytes()
        if known or key not in self.answering:
            momdp = problem_of(self, task, limit)
            if self.settings.shaped_answers and isinstance(exploration, ITRSBonus):
                momdp = exploration.shape(momdp, self.progress(task))
            policy = solve(self, task, streams, momdp)
            if known or not getattr(policy, "deterministic", False):
                return momdp, policy
            self.answering[key] = momdp, Remembering(policy)  # until the posterior moves
        return self.answering[key]


def _some(gathered: TrainingSet, chosen: NDArray[np.bool_]) -> TrainingSet:
    return TrainingSet(*(column[chosen] for column in astuple(gathered)))


def _fractions(counts: NDArray[np.int64], perception: Perception) -> NDArray[np.float64]:
    """Return the fractions (...,P,E,2,2) of no and yes among an object's percepts (...,P,E,2,K).

    Zeros where there are none; half of each where the classifier cannot tell yet.
    """
    half = counts.shape[-1] // 2
    sides = np.stack([counts[..., :half].sum(axis=-1), counts[..., half:].sum(axis=-1)], axis=-1)
    total = sides.sum(axis=-1, keepdims=True)
    silent = np.ones(counts.shape[-4:-2], np.bool_)  # (P,E)
    for name, classifier in perception.classifiers.items():
        silent[:, perception.domain.behavior_index(name)] = ~classifier.used
    even = silent[..., None, None] & (total > 0)
    return np.asarray(np.where(even, 0.5, sides / np.maximum(total, 1)))
