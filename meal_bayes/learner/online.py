"""Algorithm 2: what an agent makes of the record of a robot that learns while it works.

`refit` learns everything anew: classifiers, how much objects differ, how their percepts err
together. Between refits these are constant, and a label is a conjugate update by the percepts of
objects that no classifier has seen.
"""

from dataclasses import dataclass, field, replace
from typing import Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Horizon, ITRSBonus, Knowledge, NoBonus, Progress, add_bonus
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.arrays import Rows
from meal_bayes.datasets import Instance
from meal_bayes.datasets.detections import detected_levels
from meal_bayes.datasets.levels import classifier_levels
from meal_bayes.domain import Query, learn_success
from meal_bayes.learner import views
from meal_bayes.learner.columns import Context, Labels
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fit import limits_of, problem_of, sampled, solve, votes_of
from meal_bayes.learner.refit import (
    classify,
    count_detections,
    experienced,
    fractions,
    labels_used,
    pairs_seen,
    warn_of_odd,
)
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, Perception
from meal_bayes.planners import POMCP, MemoizedPolicy, Policy
from meal_bayes.planners.pomcp.policy import POMCPPolicy
from meal_bayes.seeds import Key
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
    sizes: views.Sizes  # features of each context, at the refit
    used: NDArray[np.int8]  # (n,P) labels of instances that the refit used; -1 none
    seen: NDArray[np.bool_]  # (O,E,P) whether classifiers have seen an object
    experienced: NDArray[np.int64]  # (2,P,E) labelled instances and objects, at the refit
    unit: float  # labelled instances that make one unit of experience, then
    trials: int  # that taught, then
    told: float  # fraction of the labels beyond a first that people told, then
    percepts_at_refit: NDArray[np.float64]  # (P,E,2,2) of labeled objects, see `Progress`
    percepts: NDArray[np.float64]  # the same now
    labeled: int  # labels of instances at the refit
    levels: Rows  # (n,P) percepts of all instances; -1 unknown
    counted: Rows  # (n,P) labels that were counted since the refit; -1 none
    # Models and policies of queries, without and with a bonus: functions of what stands above.
    answering: dict[Asked, tuple[MOMDP, Policy]] = field(default_factory=dict)
    exploring: dict[Asked, POMCPPolicy] = field(default_factory=dict)

    @classmethod
    def refit(cls, record: Experience, agent: Agent, settings: LearnerSettings) -> Self:
        """Learn everything anew from the record (Alg. 2, l. 6)."""
        labels = views.labels_of(record, memory=agent.memory)
        sizes = views.sizes(record)
        warn_of_odd(record, sizes)
        detections = views.percepts_given(record, agent.levels)
        data, rows, perception, counts = classify(record, agent, settings, labels, sizes)
        counted, unit = experienced(record, agent, settings)
        count_detections(record, counts, data.objects, labels, detections)
        percepts = fractions(record, perception, counts).sum(axis=0)
        object_labels = data.labels
        if not data.objects:  # nothing is known: one object of which nothing is
            counts = np.zeros((1, *counts.shape[1:]), np.int64)
            object_labels = np.full(counts.shape[:2], -1, np.int8)
        knowledge = knowledge_of(
            record.domain, counts, object_labels, object_level=agent.object_level
        )
        if settings.posterior is not None:  # one's own, in place of what these counts say
            knowledge = replace(knowledge, posterior=settings.posterior)
        n_attributes = len(record.domain.attributes)
        fit = cls(
            record,
            agent,
            settings,
            perception=perception,
            knowledge=knowledge,
            refitted=knowledge,
            sizes=sizes,
            used=labels_used(record, settings, labels, detections, rows),
            seen=pairs_seen(record, settings, labels, detections, rows),
            experienced=counted,
            unit=unit,
            trials=views.trials_before(record, ()),
            told=views.told_fraction(record),
            percepts=percepts,
            percepts_at_refit=percepts,
            labeled=int((labels >= 0).sum()),
            levels=Rows(np.int8, n_attributes),
            counted=Rows(np.int8, n_attributes),
        )
        fit.update(np.arange(len(labels)))
        return fit

    @property
    def due(self) -> bool:
        """Whether all is to be learned anew: labels have grown, or one that was used changed."""
        labels = views.labels_of(self.record, memory=self.agent.memory)
        if ((self.used >= 0) & (labels[: len(self.used)] != self.used)).any():
            return True
        every = self.settings.refit_every
        grown = int((labels >= 0).sum()) - self.labeled
        return every is not None and grown >= max(every * self.labeled, 1)

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now, conjugately."""
        domain = self.knowledge.domain
        self._perceive_new()
        o = self.record.instances.values["object"][rows]
        labels = views.labels_of(self.record, memory=self.agent.memory)[rows]
        labels = np.where(self._uncounted(rows) | (self.levels.values[rows] < 0), -1, labels)
        # Objects are the clusters of the posterior: of each that changed, its old counts are taken
        # out and its new ones put in.
        moved = np.zeros(len(domain.attributes), np.bool_)
        for n in dict.fromkeys(o[(labels != self.counted.values[rows]).any(axis=1)].tolist()):
            before = self._counts(self.record.instances_of_object(n))
            self.counted.values[rows[o == n]] = labels[o == n]
            after = self._counts(self.record.instances_of_object(n))
            gained = fractions(self.record, self.perception, after)
            gained -= fractions(self.record, self.perception, before)
            self.percepts = self.percepts + gained
            posterior = self.knowledge.posterior.update(after, before)
            self.knowledge = replace(self.knowledge, posterior=posterior)
            moved |= (before != after).any(axis=(1, 2, 3))
        earlier = self.knowledge
        self.knowledge = earlier.with_labels(self.record.object_labels.values)
        if self.agent.base_rates:
            moved |= self.knowledge.base_rates != earlier.base_rates
        if self.agent.co_occurrence:
            moved |= self.knowledge.co_occurrence.moved(earlier.co_occurrence, len(moved))
        # Policies stay where nothing that they were solved with has moved.
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
        record = self.record
        detections = views.percepts_given(record, self.agent.levels)
        levels = detections.copy()
        for e in record.domain.recorded:
            name = record.domain.behavior_names[e]
            rows = views.sensed(record, self.sizes, name)
            rows = rows[rows >= first]
            log_odds = np.zeros((len(rows), levels.shape[1]))
            classifier = self.perception.classifiers.get(name)
            if classifier is not None and len(rows):
                features = {
                    modality: np.stack([record.features[name, modality][i] for i in rows.tolist()])
                    for modality in classifier.spaces
                }
                log_odds = classifier.log_odds(features)
            percepts = classifier_levels(log_odds, self.agent.levels)
            levels[rows] = np.where(detections[rows] >= 0, detections[rows], percepts)
        self.levels.extend(levels[first:])
        self.counted.extend(np.full_like(levels[first:], -1))

    def _counts(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Count the percepts of instances (k,) as they are labelled, (P,E,2,K)."""
        labels = self.counted.values[rows]
        levels = self.levels.values[rows]
        counts = np.zeros(self.knowledge.posterior.counts.shape, np.int64)
        k, p = np.nonzero(labels >= 0)
        e = self.record.instances.values["behavior"][rows[k]]
        np.add.at(counts, (p, e, labels[k, p], levels[k, p]), 1)
        return counts

    def _uncounted(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which labels of instances (k,) the refit used, or classifiers know too well."""
        instances = self.record.instances.values[rows]
        nothing = np.zeros_like(self.seen, shape=(1, *self.seen.shape[1:]))  # of objects met since
        o = np.minimum(instances["object"], len(self.seen))
        seen = np.concatenate([self.seen, nothing])[o, instances["behavior"]]
        seen &= views.percepts_given(self.record, self.agent.levels)[rows] < 0
        used = np.vstack([self.used, np.full((1, self.used.shape[1]), -1)])
        return np.asarray(seen | (used[np.minimum(rows, len(self.used))] >= 0))

    def perceive(self, instance: Instance) -> Labels:
        """Return the percept levels (P,) of what was sensed; -1 unknown.

        What a detector says holds; features of another size than learned from show nothing.
        """
        domain = self.record.domain
        levels = self.record.no_labels
        expected = self.expected_sizes
        fitted = {
            modality: values
            for modality, values in (instance.features or {}).items()
            if len(values) == expected.get((instance.behavior, modality), len(values))
        }
        if fitted:
            of_all = Query(domain.attributes)
            log_odds = self.perception.log_odds(replace(instance, features=fitted), of_all)
            levels = classifier_levels(log_odds, self.agent.levels)
        detected = detected_levels(instance.percepts, domain, self.agent.levels)
        return np.where(detected >= 0, detected, levels).astype(np.int8)

    @property
    def expected_sizes(self) -> dict[Context, int]:
        """Number of features of each context of which there are classifiers."""
        sizes = zip(self.record.domain.contexts, self.sizes.tolist(), strict=True)
        return {context: n for context, n in sizes if context[0] in self.perception.classifiers}

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
        """Return what has been learned so far, for a bonus; without a name, at the refit.

        At the refit the object is a new one.
        """
        e, p = self.seen.shape[1:]
        at_refit = Progress(
            knowledge=replace(self.refitted, domain=self.knowledge.domain),
            horizon=Horizon(self.trials, self.settings.horizon),
            reward=self.settings.reward,
            discount=self.agent.discount,
            percepts=self.percepts_at_refit,
            told=self.told,
            unit=self.unit,
            instances=self.experienced[0],
            objects=self.experienced[1],
            fresh=np.ones((p, e), bool),
            labeled=np.zeros(p, bool),
        )
        if object_name is None:
            return at_refit
        record = self.record
        (instances, objects), unit = experienced(record, self.agent, self.settings)
        now = replace(
            at_refit,
            knowledge=self.knowledge,
            horizon=Horizon(views.trials_before(record, task.key), self.settings.horizon),
            percepts=self.percepts,
            told=views.told_fraction(record),
            unit=unit,
            instances=instances,
            objects=objects,
        )
        if object_name not in record.objects:
            return now
        o = record.objects[object_name]
        fresh = views.labelled(record, memory=self.agent.memory)[o].T == 0
        return replace(
            now, fresh=fresh, labeled=(record.object_labels.values[o] >= 0) & self.agent.memory
        )

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task, with a bonus if it explores (Alg. 2, l. 7-10)."""
        exploration = self.agent.exploration
        shaped = explore
        if not explore and self.settings.shaped_answers:
            shaped = isinstance(exploration, ITRSBonus)
        # An object that is recognized has a prior of its own, so its problem is built anew.
        recognized = votes_of(self, task) is not None
        if shaped and (recognized or not isinstance(exploration, NoBonus)):
            return self._plan_shaped(task, streams, limit, explore=explore)
        if recognized:
            momdp = problem_of(self, task, limit)
            return momdp, solve(self, task, streams, momdp)
        key = task.query, limits_of(self, limit).tobytes()
        if key in self.answering:
            return self.answering[key]
        momdp = problem_of(self, task, limit)
        policy = solve(self, task, streams, momdp)
        if getattr(policy, "deterministic", False):
            policy = MemoizedPolicy(policy)  # until the posterior moves
            self.answering[key] = momdp, policy
        return momdp, policy

    def _plan_shaped(
        self, task: Task, streams: Key, limit: ArrayLike, *, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem with the bonus of what is learned so far.

        Searches of equal questions share a plan library, that of the problem at the refit.
        """
        query = task.query
        exploration = self.agent.exploration
        name = task.object_name if explore else ""
        momdp = add_bonus(exploration, problem_of(self, task, limit), self.progress(task, name))
        if not explore or not isinstance(self.agent.planner(self.knowledge.domain, query), POMCP):
            return momdp, solve(self, task, streams, momdp)
        key = query, limits_of(self, limit).tobytes()
        if key not in self.exploring:
            refitted = replace(self, knowledge=self.progress(task).knowledge)
            usual = problem_of(refitted, task, limit, recognize=False)
            usual = add_bonus(exploration, usual, self.progress(task))
            self.exploring[key] = cast(POMCPPolicy, solve(self, task, streams, usual))
        return momdp, self.exploring[key].sharing_plans(momdp)
