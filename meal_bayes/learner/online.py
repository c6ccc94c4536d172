"""Algorithm 2: what an agent makes of the record of a robot that learns while it works.

`refit` learns everything anew: classifiers, how much objects differ, how their percepts err
together. Between refits these are constant, and a label is a conjugate update by the percepts of
objects that no classifier has seen.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Horizon, ITRSBonus, Knowledge, NoBonus, Progress, add_bonus
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.arrays import Rows
from meal_bayes.datasets import Instance
from meal_bayes.domain import Domain, Query, learn_answers, learn_success
from meal_bayes.learner import views
from meal_bayes.learner.experience import Context, Experience, Labels
from meal_bayes.learner.fit import OnStep, limits_of, problem_of, sampled, solve, told_of
from meal_bayes.learner.perceived import (
    classify,
    count_detections,
    cut_by_labels,
    cut_by_rank,
    expected_sizes,
    experience_of,
    fractions,
    labels_used,
    levels_by,
    levels_of,
    levels_since,
    trained_cells,
    warn_of_clocks,
    warn_of_odd,
)
from meal_bayes.learner.recording import RecordingPerceiver
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, Perception
from meal_bayes.planners import POMCP, MemoizedPolicy, Policy
from meal_bayes.planners.search.policy import POMCPPolicy
from meal_bayes.seeds import Key
from meal_bayes.trials import Task

_SAME = 0.05  # success probabilities that differ by less are not planned with anew


def chances(domain: Domain) -> NDArray[np.float64]:
    """Return what is learned of a domain: probabilities of its effects, and of right answers."""
    effects = [effect.probability for effect in domain.diagram.effects]
    return np.array(effects + [b.answer_accuracy for b in domain.behaviors if b.asks], float)


class PlanKey(NamedTuple):
    """What plans of equal questions have in common, beside what was learned."""

    query: Query
    limits: bytes  # (E,) percepts of each behavior that a trial can have


@dataclass(eq=False)
class Online:
    """Knowledge of one agent from the record; made by `refit`, updated by `update`."""

    record: Experience
    agent: Agent
    settings: LearnerSettings
    perception: Perception
    knowledge: Knowledge  # now
    knowledge_at_refit: Knowledge
    sizes: views.Sizes  # features of each context, at the refit
    labels_at_refit: NDArray[np.int8]  # (n,P) labels of instances that the refit used; -1 none
    trained_cells: NDArray[np.bool_]  # (O,E,P) whether a classifier has seen a label of the object
    experience_at_refit: NDArray[np.int64]  # (2,P,E) labeled instances and objects
    unit_at_refit: float  # labeled instances that make one unit of experience
    trials_at_refit: int  # that taught
    told_at_refit: float  # fraction of the labels beyond a first that people told
    percepts_at_refit: NDArray[np.float64]  # (P,E,2,2) of labeled objects, see `Progress`
    percepts: NDArray[np.float64]  # the same now
    n_labels_at_refit: NDArray[np.int64]  # (P,) of instances, whether the refit used them or not
    n_labels_pooled: int  # of objects, when it was learned how far base rates are pooled
    edges: NDArray[np.float64]  # (P,E,K-1) between the levels of scores; NaN where none came
    levels: Rows  # (n,P) percepts of all instances; -1 unknown
    counted_labels: Rows  # (n,P) labels that were counted since the refit; -1 none
    # Without a bonus, and with one: functions of what stands above, kept until that moves.
    policies: dict[PlanKey, tuple[MOMDP, Policy]] = field(default_factory=dict)
    plan_libraries: dict[PlanKey, POMCPPolicy] = field(default_factory=dict)
    values: dict[bytes, NDArray[np.float64]] = field(default_factory=dict)  # see `Progress`

    @classmethod
    def refit(cls, record: Experience, agent: Agent, settings: LearnerSettings) -> Self:
        """Learn everything anew from the record (Alg. 2, l. 6)."""
        labels = views.labels_of(record, memory=agent.memory)
        sizes = views.sizes(record)
        warn_of_odd(record, sizes)
        warn_of_clocks(record, sizes)
        edges = cut_by_labels(record, labels, agent.levels)
        detections = views.percepts_given(record, agent.levels, levels_by(record, edges))
        data, rows, perception, counts = classify(record, agent, settings, labels, sizes)
        experience, unit = experience_of(record, agent, settings)
        count_detections(record, counts, data.objects, labels, detections)
        percepts = fractions(record, perception, counts).sum(axis=0)
        object_labels = data.labels
        if not data.objects:  # nothing is known: one object of which nothing is
            counts = np.zeros((1, *counts.shape[1:]), np.int64)
            object_labels = np.full(counts.shape[:2], -1, np.int8)
        knowledge = knowledge_of(
            record.domain,
            counts,
            object_labels,
            object_level=agent.object_level,
            given=views.given_pairs(record),
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
            knowledge_at_refit=knowledge,
            sizes=sizes,
            labels_at_refit=labels_used(record, settings, labels, detections, rows),
            trained_cells=trained_cells(record, settings, labels, detections, rows),
            experience_at_refit=experience,
            unit_at_refit=unit,
            trials_at_refit=views.trials_before(record, ()),
            told_at_refit=views.told_fraction(record),
            percepts=percepts,
            percepts_at_refit=percepts,
            n_labels_at_refit=(labels >= 0).sum(axis=0),
            n_labels_pooled=int((record.object_labels.values >= 0).sum()),
            edges=edges,
            levels=Rows(np.int8, n_attributes),
            counted_labels=Rows(np.int8, n_attributes),
        )
        fit.update(np.arange(len(labels)))
        return fit

    @property
    def due(self) -> bool:
        """Whether all is to be learned anew: labels have grown, or one that was used changed."""
        labels = views.labels_of(self.record, memory=self.agent.memory)
        used = self.labels_at_refit
        if ((used >= 0) & (labels[: len(used)] != used)).any():
            return True
        every = self.settings.refit_every
        if every is None:
            return False
        now = (labels >= 0).sum(axis=0)
        # Of an attribute that was added, few labels stand beside many of the others.
        added = slice(self.record.first_attributes, None)
        numbers = np.append(now[added], now.sum())
        at_refit = np.append(self.n_labels_at_refit[added], self.n_labels_at_refit.sum())
        return bool((numbers - at_refit >= np.maximum(every * at_refit, 1)).any())

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now, conjugately."""
        domain = self.knowledge.domain
        self._cut_anew()
        self._perceive_new()
        o = self.record.instances.values["object"][rows]
        labels = views.labels_of(self.record, memory=self.agent.memory)[rows]
        labels = np.where(self._uncounted(rows) | (self.levels.values[rows] < 0), -1, labels)
        # Objects are the clusters of the posterior: of each that changed, its old counts are taken
        # out and its new ones put in.
        moved = np.zeros(len(domain.attributes), np.bool_)
        changed = (labels != self.counted_labels.values[rows]).any(axis=1)
        for n in dict.fromkeys(o[changed].tolist()):
            counts_before = self._counts(self.record.instances_of_object(n))
            self.counted_labels.values[rows[o == n]] = labels[o == n]
            counts = self._counts(self.record.instances_of_object(n))
            gained = fractions(self.record, self.perception, counts)
            gained -= fractions(self.record, self.perception, counts_before)
            self.percepts = self.percepts + gained
            posterior = self.knowledge.posterior.update(counts, counts_before)
            self.knowledge = replace(self.knowledge, posterior=posterior)
            moved |= (counts_before != counts).any(axis=(1, 2, 3))
        if self.agent.object_level:
            believed = self.knowledge.posterior.believe(views.given_pairs(self.record))
            moved |= (believed.given & ~self.knowledge.posterior.given).any(axis=1)
            self.knowledge = replace(self.knowledge, posterior=believed)
        earlier = self.knowledge
        object_labels = self.record.object_labels.values
        self.knowledge = earlier.with_labels(object_labels, pool=self._pool(object_labels))
        if self.agent.base_rates:
            moved |= self.knowledge.base_rates != earlier.base_rates
            n = min(len(object_labels), len(earlier.labels))
            moved |= (object_labels[:n] != earlier.labels[:n]).any(axis=0)
            moved |= (object_labels[n:] >= 0).any(axis=0)
        # Policies stay where nothing that they were solved with has moved.
        self.policies = {
            key: plan
            for key, plan in self.policies.items()
            if not moved[domain.columns(key.query.attributes)].any()
        }
        self._succeed()

    def _pool(self, object_labels: Labels) -> bool:
        """Return whether to learn anew how far rates are pooled: as often as all else, by labels.

        It takes no recordings, so that a robot that only is told things learns it without a refit.
        """
        every = self.settings.refit_every
        number = int((object_labels >= 0).sum())
        grown = number - self.n_labels_pooled
        pool = every is not None and grown >= max(every * self.n_labels_pooled, 1)
        if pool:
            self.n_labels_pooled = number
        return pool

    def _succeed(self) -> None:
        """Learn how often behaviors succeed and answers are right, once that moved by 1 in 20."""
        domain = learn_answers(self.record.domain, views.answered(self.record))
        if self.settings.learn_success:
            domain = learn_success(domain, views.attempts(self.record))
        if np.abs(chances(domain) - chances(self.knowledge.domain)).max() > _SAME:
            self.knowledge = replace(self.knowledge, domain=domain)
            self.policies = {}
            self.plan_libraries = {}
            self.values = {}

    def _cut_anew(self) -> None:
        """Cut the scores of pairs anew of which nothing was counted yet: their ranks have moved."""
        scores = self.record.scores.values
        if np.isnan(scores).all():
            return
        counted = self.knowledge.posterior.counts.any(axis=(2, 3))
        untold = np.asarray(~counted | np.isnan(self.edges).all(axis=-1))
        self.edges = cut_by_rank(self.record, self.edges, untold, self.agent.levels)
        first = slice(len(self.levels))
        moved = untold.T[self.record.instances.values["behavior"][first]] & ~np.isnan(scores[first])
        self.levels.values[moved] = levels_by(self.record, self.edges)[first][moved]

    def _perceive_new(self) -> None:
        """Perceive the instances since the last time."""
        levels = levels_since(
            self.record,
            self.perception,
            self.sizes,
            self.agent.levels,
            levels_by(self.record, self.edges),
            first=len(self.levels),
        )
        self.levels.extend(levels)
        self.counted_labels.extend(np.full_like(levels, -1))

    def _counts(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Count the percepts of instances (k,) as they are labeled, (P,E,2,K)."""
        labels = self.counted_labels.values[rows]
        levels = self.levels.values[rows]
        counts = np.zeros(self.knowledge.posterior.counts.shape, np.int64)
        k, p = np.nonzero(labels >= 0)
        e = self.record.instances.values["behavior"][rows[k]]
        np.add.at(counts, (p, e, labels[k, p], levels[k, p]), 1)
        return counts

    def _uncounted(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which labels of instances (k,) the refit used, or classifiers know too well."""
        instances = self.record.instances.values[rows]
        # What the refit did not know yet stands at the end: no label used, no classifier trained.
        new_object = np.zeros_like(self.trained_cells, shape=(1, *self.trained_cells.shape[1:]))
        trained = np.concatenate([self.trained_cells, new_object])
        new_instance = np.full((1, self.labels_at_refit.shape[1]), -1)
        used = np.vstack([self.labels_at_refit, new_instance]) >= 0
        o = np.minimum(instances["object"], len(self.trained_cells))
        is_trained = trained[o, instances["behavior"]]
        scored = levels_by(self.record, self.edges)
        is_trained &= views.percepts_given(self.record, self.agent.levels, scored)[rows] < 0
        return np.asarray(is_trained | used[np.minimum(rows, len(self.labels_at_refit))])

    def perceive(self, instance: Instance) -> Labels:
        """Return the percept levels (P,) of what was sensed; -1 unknown."""
        return levels_of(
            self.record, self.perception, self.sizes, self.agent.levels, instance, self.edges
        )

    @property
    def teaches(self) -> bool:
        """Yes: trials with a robot become experience."""
        return True

    @property
    def expected_sizes(self) -> dict[Context, int]:
        """Number of features of each context of which there are classifiers."""
        return expected_sizes(self.record, self.perception, self.sizes)

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,): a robot may know better."""
        return np.full(len(self.record.domain.behaviors), np.inf)

    @property
    def perceiver(self) -> Perceiver:
        """The classifiers, or draws from the learned tables in place of what came."""
        drawn = self.settings.drawn
        return self.perception if drawn is None else sampled(self.knowledge_at_refit, drawn)

    def perceiving(
        self,
        task: Task,
        momdp: MOMDP,
        lock: AbstractContextManager[Any],
        on_step: OnStep,
    ) -> tuple[Perceiver, OnStep]:
        """Return what perceives a trial, and records its steps where it is to be learned from."""
        recorder = RecordingPerceiver(self, task, momdp, lock, on_step)
        return recorder, recorder.record if task.learn else on_step

    def truth(self, query: Query) -> None:
        """Return nothing: of a robot's object it is not known."""

    def progress(self, task: Task, object_name: str | None = None) -> Progress:
        """Return what has been learned so far, for a bonus; without a name, at the refit.

        At the refit the object is a new one.
        """
        e, p = self.trained_cells.shape[1:]
        at_refit = Progress(
            knowledge=replace(self.knowledge_at_refit, domain=self.knowledge.domain),
            horizon=Horizon(self.trials_at_refit, self.settings.horizon),
            reward=self.settings.reward,
            discount=self.agent.discount,
            percepts=self.percepts_at_refit,
            told_fraction=self.told_at_refit,
            unit=self.unit_at_refit,
            instances=self.experience_at_refit[0],
            objects=self.experience_at_refit[1],
            fresh=np.ones((p, e), bool),
            labeled=np.zeros(p, bool),
            values=self.values,
        )
        if object_name is None:
            return at_refit
        record = self.record
        # A trial that is resumed is planned as it was when it began: its own steps do not count.
        own = record.instances_of_trial(task.key)
        (instances, objects), unit = experience_of(record, self.agent, self.settings, own)
        now = replace(
            at_refit,
            knowledge=self.knowledge,
            horizon=Horizon(views.trials_before(record, task.key), self.settings.horizon),
            percepts=self.percepts,
            told_fraction=views.told_fraction(record),
            unit=unit,
            instances=instances,
            objects=objects,
        )
        if object_name not in record.objects:
            return now
        o = record.objects[object_name]
        fresh = views.labeled(record, memory=self.agent.memory, apart=own)[o].T == 0
        return replace(
            now, fresh=fresh, labeled=(record.object_labels.values[o] >= 0) & self.agent.memory
        )

    def problem(self, task: Task, limit: ArrayLike) -> MOMDP:
        """Return the MOMDP of a task that somebody commands."""
        return problem_of(self, task, limit)

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task, with a bonus if it explores (Alg. 2, l. 7-10)."""
        exploration = self.agent.exploration
        shaped = explore
        if not explore and self.settings.shaped_answers:
            shaped = isinstance(exploration, ITRSBonus)
        # An object that is recognized has a prior of its own, so its problem is built anew.
        recognized = told_of(self, task) is not None
        if shaped and (recognized or not isinstance(exploration, NoBonus)):
            return self._plan_shaped(task, streams, limit, explore=explore)
        if recognized:
            momdp = problem_of(self, task, limit)
            return momdp, solve(self, task, streams, momdp)
        # A bonus moves with every trial; without one a plan holds until the posterior moves.
        key = PlanKey(task.query, limits_of(self, limit).tobytes())
        if key in self.policies:
            return self.policies[key]
        momdp = problem_of(self, task, limit)
        policy = solve(self, task, streams, momdp)
        if getattr(policy, "deterministic", False):
            policy = MemoizedPolicy(policy)
            self.policies[key] = momdp, policy
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
        key = PlanKey(query, limits_of(self, limit).tobytes())
        if key not in self.plan_libraries:
            refitted = replace(self, knowledge=self.progress(task).knowledge)
            usual = problem_of(refitted, task, limit, recognize=False)
            usual = add_bonus(exploration, usual, self.progress(task))
            self.plan_libraries[key] = cast(POMCPPolicy, solve(self, task, streams, usual))
        return momdp, self.plan_libraries[key].sharing_plans(momdp)
