"""Algorithm 2: what an agent learns from the experience of a robot that learns while it works.

`refit` fits everything again: the classifiers, how much objects differ, and how errors of percepts
correlate. Between two refits these are constant, and a label leads to a conjugate update of the
posterior by the percepts of objects on which no classifier was trained. `RecordingPerceiver`
computes and records the percepts of a trial.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Horizon, ITRSBonus, Knowledge, NoBonus, Progress, add_bonus
from meal_bayes.agents.knowledge import knowledge_of
from meal_bayes.arrays import Levels, Rows, no_and_yes_of
from meal_bayes.datasets import Dataset, Instance, TrainingSet
from meal_bayes.datasets.feature_checks import warn_of_order
from meal_bayes.datasets.percepts import classifier_levels, detected_levels, scores_of
from meal_bayes.domain import Domain, Query, learn_answers, learn_success
from meal_bayes.learner import views
from meal_bayes.learner.experience import (
    FROM_DATASET,
    FROM_TRIAL,
    NONE,
    Context,
    Experience,
    Labels,
    features_digest,
    record_step,
)
from meal_bayes.learner.fit import OnStep, limits_of, problem_of, sampled, solve, told_of
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.look import listed, warn_user
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import (
    Perceiver,
    Perception,
    PerceptionSettings,
    fit_and_validate,
    fit_spaces,
    with_classifier,
)
from meal_bayes.perception.scores import (
    cut_scores,
    edges_by_rank,
    first_levels,
    object_means,
    scored_levels,
)
from meal_bayes.planners import POMCP, MemoizedPolicy, Policy
from meal_bayes.planners.search.policy import POMCPPolicy
from meal_bayes.seeds import Key
from meal_bayes.trials import Step, Task

_SAME = 0.05  # smallest change of a success probability after which plans are made again


def chances(domain: Domain) -> NDArray[np.float64]:
    """Return the learned probabilities of the domain's effects and of right answers of people."""
    effects = [effect.probability for effect in domain.diagram.effects]
    return np.array(effects + [b.answer_accuracy for b in domain.behaviors if b.asks], float)


class PlanKey(NamedTuple):
    """Key of plans: questions with equal keys can share plans between two refits."""

    query: Query
    limits: bytes  # (E,) largest number of percepts of each behavior in a trial
    bonus: bytes = b""  # (N,E,2) exploration bonus of a test, if it has one


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
    trials_at_refit: int  # number of training trials
    told_at_refit: float  # see `views.told_fraction`
    asked_at_refit: NDArray[np.int64]  # see `views.asked_before`
    percepts_at_refit: NDArray[np.float64]  # (P,E,2,2) of labeled objects, see `Progress`
    percepts: NDArray[np.float64]  # the same now
    n_labels_at_refit: NDArray[np.int64]  # (P,) labels of instances, used by the refit or not
    n_labels_pooled: int  # number of labels of objects when the pooling of base rates was learned
    edges: NDArray[np.float64]  # (P,E,K-1) between the levels of scores; NaN if there is no score
    levels: Rows  # (n,P) percepts of all instances; -1 unknown
    counted_labels: Rows  # (n,P) labels that were counted since the refit; -1 none
    # Caches of policies without and with a bonus, which are cleared if the knowledge changes.
    policies: dict[PlanKey, tuple[MOMDP, Policy]] = field(default_factory=dict)
    plan_libraries: dict[PlanKey, POMCPPolicy] = field(default_factory=dict)
    values: dict[bytes, NDArray[np.float64]] = field(default_factory=dict)  # see `Progress`
    # Levels (P,) of recordings that were replayed, by behavior, digest of the features, and P.
    perceived: dict[tuple[str, int, int], Labels] = field(default_factory=dict)

    @classmethod
    def refit(cls, record: Experience, agent: Agent, settings: LearnerSettings) -> Self:
        """Fit everything again from the experience (Algorithm 2, line 6)."""
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
        if not data.objects:  # without objects, use one object without percepts and labels
            counts = np.zeros((1, *counts.shape[1:]), np.int64)
            object_labels = np.full(counts.shape[:2], -1, np.int8)
        knowledge = knowledge_of(
            record.domain,
            counts,
            object_labels,
            object_level=agent.object_level,
            given=views.trusted_pairs(record),
            label_accuracy=settings.label_accuracy or 1.0,
        )
        if settings.posterior is not None:  # the user's posterior replaces the learned one
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
            asked_at_refit=views.asked_before(record, ()),
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
        """Whether a refit is due, because there are enough new labels or a used label changed."""
        labels = views.labels_of(self.record, memory=self.agent.memory)
        used = self.labels_at_refit
        if ((used >= 0) & (labels[: len(used)] != used)).any():
            return True
        every = self.settings.refit_every
        if every is None:
            return False
        now = (labels >= 0).sum(axis=0)
        # Labels of an added attribute are counted separately, because there are few of them.
        added = slice(self.record.first_attributes, None)
        numbers = np.append(now[added], now.sum())
        at_refit = np.append(self.n_labels_at_refit[added], self.n_labels_at_refit.sum())
        return bool((numbers - at_refit >= np.maximum(every * at_refit, 1)).any())

    def update(self, rows: NDArray[np.intp]) -> None:
        """Update the posterior conjugately by k executions with their present labels."""
        domain = self.knowledge.domain
        self._cut_anew()
        self._perceive_new()
        o = self.record.instances.values["object"][rows]
        labels = views.labels_of(self.record, memory=self.agent.memory)[rows]
        labels = np.where(self._uncounted(rows) | (self.levels.values[rows] < 0), -1, labels)
        # Objects are the clusters of the posterior: replace the counts of each changed object.
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
            believed = self.knowledge.posterior.believe(views.trusted_pairs(self.record))
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
        # Keep the policies of queries for which nothing has changed.
        self.policies = {
            key: plan
            for key, plan in self.policies.items()
            if not moved[domain.columns(key.query.attributes)].any()
        }
        self._succeed()

    def _pool(self, object_labels: Labels) -> bool:
        """Return whether to learn the pooling of base rates again, which depends only on labels.

        The rule is that of refits, but counts labels of objects, so that a robot without recordings
        learns the pooling, too.
        """
        every = self.settings.refit_every
        number = int((object_labels >= 0).sum())
        grown = number - self.n_labels_pooled
        pool = every is not None and grown >= max(every * self.n_labels_pooled, 1)
        if pool:
            self.n_labels_pooled = number
        return pool

    def _succeed(self) -> None:
        """Update success rates and the accuracy of answers if one of them has changed by .05."""
        domain = learn_answers(self.record.domain, views.answered(self.record))
        if self.settings.learn_success:
            domain = learn_success(domain, views.attempts(self.record))
        if np.abs(chances(domain) - chances(self.knowledge.domain)).max() > _SAME:
            self.knowledge = replace(self.knowledge, domain=domain)
            self.policies = {}
            self.plan_libraries = {}
            self.values = {}

    def _cut_anew(self) -> None:
        """Compute new levels of scores for pairs without counts, whose quantiles have changed."""
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
        """Compute the percepts of instances that were added since the last call.

        Instances without features and scores keep the percepts of their trial.
        """
        record = self.record
        n_levels = self.agent.levels
        first = len(self.levels)
        detections = views.percepts_given(record, n_levels, levels_by(record, self.edges))
        levels = detections.copy()
        executed = {*record.instances.values["behavior"][first:].tolist()}
        for e in record.domain.recorded:
            if e not in executed:
                continue
            name = record.domain.behavior_names[e]
            rows = views.sensed(record, self.sizes, name)
            rows = rows[rows >= first]
            # Even odds if there is no classifier for the behavior yet.
            log_odds = np.zeros((len(rows), levels.shape[1]))
            classifier = self.perception.classifiers.get(name)
            if classifier is not None and len(rows):
                features = {
                    modality: np.stack([record.features[name, modality][i] for i in rows.tolist()])
                    for modality in classifier.spaces
                }
                log_odds = classifier.log_odds(features)
            percepts = classifier_levels(log_odds, n_levels)
            given = (detections[rows] >= 0) | ~np.isnan(record.scores.values[rows])
            levels[rows] = np.where(given, detections[rows], percepts)
        self.levels.extend(levels[first:])
        self.counted_labels.extend(np.full_like(levels[first:], -1))

    def _counts(self, rows: NDArray[np.intp]) -> NDArray[np.int64]:
        """Count the percepts of instances (k,) by their labels, (P,E,2,K)."""
        labels = self.counted_labels.values[rows]
        levels = self.levels.values[rows]
        counts = np.zeros(self.knowledge.posterior.counts.shape, np.int64)
        k, p = np.nonzero(labels >= 0)
        e = self.record.instances.values["behavior"][rows[k]]
        np.add.at(counts, (p, e, labels[k, p], levels[k, p]), 1)
        return counts

    def _uncounted(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which labels of instances (k,) must not be counted by an update.

        These are labels that the refit used, and those of objects on which a classifier was
        trained.
        """
        instances = self.record.instances.values[rows]
        # One row at the end for objects and instances that are new since the refit.
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
        """Return the percept levels (P,) of an execution; -1 if there is no percept.

        Percepts of the robot's own detector have priority. Features of another size than those of
        the experience give no percept. A recording that is replayed in many trials is classified
        once.
        """
        if instance.recording < 0 or instance.percepts or instance.scores:
            return self._perceived_now(instance)
        digest = features_digest(instance.features)
        key = (instance.behavior, digest, len(self.record.domain.attributes))
        if key not in self.perceived:
            self.perceived[key] = self._perceived_now(instance)
        return self.perceived[key].copy()

    @cached_property
    def _known(self) -> Query:
        """All attributes that classifiers know; others may have been added since."""
        return Query(self.perception.domain.attributes)

    def _perceived_now(self, instance: Instance) -> Labels:
        domain = self.record.domain
        n_levels = self.agent.levels
        levels = self.record.no_labels
        expected = self.expected_sizes
        fitted = {
            modality: values
            for modality, values in (instance.features or {}).items()
            if len(values) == expected.get((instance.behavior, modality), len(values))
        }
        if fitted:
            log_odds = self.perception.log_odds(replace(instance, features=fitted), self._known)
            levels[: len(log_odds)] = classifier_levels(log_odds, n_levels)
        if not (instance.percepts or instance.scores):
            return levels
        detected = detected_levels(instance.percepts, domain, n_levels)
        scores = scores_of(instance.scores, domain)
        known = len(self.edges)  # attributes that were added since the refit have no edges
        scored = self.record.no_labels
        of_behavior = self.edges[:, domain.behavior_index(instance.behavior)]
        scored[:known] = scored_levels(scores[:known], of_behavior)
        scored = np.where(scored >= 0, scored, first_levels(scores, n_levels))
        levels = np.where(scored >= 0, scored, levels)
        return np.where(detected >= 0, detected, levels).astype(np.int8)

    @property
    def teaches(self) -> bool:
        """True, because trials with a robot become experience."""
        return True

    @property
    def expected_sizes(self) -> dict[Context, int]:
        """Number of features of each behavior and modality for which there are classifiers."""
        known = self.perception.classifiers
        by_context = zip(self.record.domain.contexts, self.sizes.tolist(), strict=True)
        return {context: n for context, n in by_context if context[0] in known}

    @property
    def limit(self) -> NDArray[np.float64]:
        """Maximum number of percepts of each behavior in a trial, (E,); robots may set another."""
        return np.full(len(self.record.domain.behaviors), np.inf)

    @property
    def perceiver(self) -> Perceiver:
        """The perceiver: classifiers, or random draws from the learned confusion matrices."""
        drawn = self.settings.drawn
        return self.perception if drawn is None else sampled(self.knowledge_at_refit, drawn)

    def perceiving(
        self,
        task: Task,
        momdp: MOMDP,
        lock: AbstractContextManager[Any],
        on_step: OnStep,
    ) -> tuple[Perceiver, OnStep]:
        """Return the perceiver of a trial, which records steps if the robot learns from it."""
        recorder = RecordingPerceiver(self, task, momdp, lock, on_step)
        return recorder, recorder.record if task.learn else on_step

    def truth(self, query: Query) -> None:
        """Return None, because the truth about a robot's object is not known."""

    def progress(self, task: Task, object_name: str | None = None) -> Progress:
        """Return what has been learned so far, from which the exploration bonus is computed.

        Without a name, the object is a new one, and the state is that of the last refit.
        """
        e, p = self.trained_cells.shape[1:]
        this = np.isin(np.arange(p), self.record.domain.columns(task.query.attributes))
        at_refit = Progress(
            knowledge=replace(self.knowledge_at_refit, domain=self.knowledge.domain),
            horizon=Horizon(self.trials_at_refit, self.settings.horizon),
            reward=self.settings.reward_in(self.record.domain),
            discount=self.agent.discount,
            percepts=self.percepts_at_refit,
            told_fraction=self.told_at_refit,
            unit=self.unit_at_refit,
            instances=self.experience_at_refit[0],
            objects=self.experience_at_refit[1],
            fresh=np.ones((p, e), bool),
            labeled=np.zeros(p, bool),
            values=self.values,
            payoffs=self.settings.payoffs or self.knowledge.domain.payoffs,
            abstain=self.agent.abstain,
            asked_about=self.asked_at_refit + this,
        )
        if object_name is None:
            return at_refit
        record = self.record
        # The steps of the trial itself do not count, so that a resumed trial has the same plan.
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
            asked_about=views.asked_before(record, task.key) + this,
        )
        if object_name not in record.objects:
            return now
        o = record.objects[object_name]
        fresh = views.labeled(record, memory=self.agent.memory, apart=own)[o].T == 0
        return replace(
            now, fresh=fresh, labeled=(record.object_labels.values[o] >= 0) & self.agent.memory
        )

    def problem(self, task: Task, limit: ArrayLike) -> MOMDP:
        """Return the MOMDP of a task in which a program commands the behaviors."""
        return problem_of(self, task, limit)

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task, with a bonus if it explores (Alg. 2, l. 7-10)."""
        exploration = self.agent.exploration
        # A recognized object has its own prior, so its problem is built again.
        recognized = told_of(self, task) is not None
        if explore and (recognized or not isinstance(exploration, NoBonus)):
            return self._plan_exploring(task, streams, limit)
        momdp = None
        if not explore and self.settings.shaped_answers and isinstance(exploration, ITRSBonus):
            momdp = add_bonus(exploration, problem_of(self, task, limit), self.progress(task, ""))
        # A bonus changes with every training trial; everything else changes with the posterior.
        bonus = b"" if momdp is None else momdp.bonus.tobytes()
        key = PlanKey(task.query, limits_of(self, limit).tobytes(), bonus)
        if key in self.policies and not recognized:
            return self.policies[key]
        if momdp is None:
            momdp = problem_of(self, task, limit)
        policy = solve(self, task, streams, momdp)
        if getattr(policy, "deterministic", False) and not recognized:
            policy = MemoizedPolicy(policy)
            self.policies[key] = momdp, policy
        return momdp, policy

    def _plan_exploring(self, task: Task, streams: Key, limit: ArrayLike) -> tuple[MOMDP, Policy]:
        """Build and solve the problem with the bonus of what is learned so far.

        Searches of equal questions share a plan library, that of the problem at the refit.
        """
        query = task.query
        exploration = self.agent.exploration
        progress = self.progress(task, task.object_name)
        momdp = add_bonus(exploration, problem_of(self, task, limit), progress)
        if not isinstance(self.agent.planner(self.knowledge.domain, query), POMCP):
            return momdp, solve(self, task, streams, momdp)
        key = PlanKey(query, limits_of(self, limit).tobytes())
        if key not in self.plan_libraries:
            refitted = replace(self, knowledge=self.progress(task).knowledge)
            usual = problem_of(refitted, task, limit, recognize=False)
            usual = add_bonus(exploration, usual, self.progress(task))
            self.plan_libraries[key] = cast(POMCPPolicy, solve(self, task, streams, usual))
        return momdp, self.plan_libraries[key].sharing_plans(momdp)


class RecordingPerceiver:
    """A perceiver that records the executions of a trial with their percepts and features."""

    def __init__(
        self,
        fit: Online,
        task: Task,
        momdp: MOMDP,
        lock: AbstractContextManager[Any],
        on_step: OnStep,
    ) -> None:
        self._fit = fit
        self._task = task
        self._momdp = momdp
        self._lock = lock
        self._on_step = on_step
        self._drawn = None if fit.settings.drawn is None else fit.perceiver
        self._last: tuple[Instance, NDArray[np.int8]] | None = None
        number = fit.record.trials.get(task.key, -1)
        recorded = fit.record.executions.values["trial"] == number
        self._n_recorded = int(recorded.sum())  # steps, before a restart

    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels | None:
        """Return percept levels of the queried attributes, (N,); -1 if there is no percept."""
        fit = self._fit
        domain = fit.record.domain
        spec = domain.behaviors[domain.behavior_index(instance.behavior)]
        if spec.answer_accuracy is None:
            # A test records nothing, so no percept is computed if percepts are drawn.
            if self._drawn is not None and not self._task.learn:
                return self._drawn.observe(instance, query, rng)
            levels = fit.perceive(instance)
        else:
            levels = fit.perception.observe(instance, fit._known, rng)
        self._last = instance, levels
        if self._drawn is not None:  # draw from the learned matrices instead
            return self._drawn.observe(instance, query, rng)
        return np.asarray(levels[domain.columns(query.attributes)], np.int8)

    def record(self, step: Step) -> None:
        """Record an executed step, unless it was recorded before a restart."""
        last = self._last
        self._last = None
        if last is None and step.sensed is not None:  # a step from before a restart
            last = step.sensed, self._fit.perceive(step.sensed)
        if self._n_recorded:
            self._n_recorded -= 1
        else:
            with self._lock:
                record_step(self._fit.record, self._task, self._momdp, step, last)
        if self._on_step is not None:
            self._on_step(step)


# The steps of a refit.


def classify(
    record: Experience,
    agent: Agent,
    settings: LearnerSettings,
    labels: Labels,
    sizes: views.Sizes,
) -> tuple[Dataset, NDArray[np.intp], Perception, NDArray[np.int64]]:
    """Fit classifiers to labeled executions, and count their percepts of held-out objects.

    Percepts of the robot's own detector are used directly, without a classifier. Labels are (n,P).

    Returns
    -------
    data : Dataset
        Recordings of the objects in the experience; see `views.in_order`.
    rows : NDArray[np.intp]
        (k,) positions of the executions in the training set.
    perception : Perception
        The classifiers.
    counts : NDArray[np.int64]
        (O,P,E,2,K) percept counts by classifiers that were not trained on the object.
    """
    bare = views.percepts_given(record, agent.levels, record.no_labels) >= 0
    detected = (bare | views.detected(record))[: len(labels)]
    learned = np.where(detected, -1, labels).astype(np.int8)
    data, rows, recorded = views.training(record, learned, sizes)
    training = _selected(recorded, np.asarray((recorded.labels >= 0).any(axis=1)))
    perceives = PerceptionSettings(levels=agent.levels, by_object=settings.by_object)
    # Scaling uses all instances, with and without labels.
    spaces = None
    if settings.classifier is not None:
        perceives = with_classifier(settings.classifier, levels=agent.levels)
    elif agent.whiten:
        spaces = fit_spaces(data, recorded, whiten=True)
    else:  # feature spaces of given recordings do not change later
        from_dataset = record.instances.values["origin"][rows] == FROM_DATASET
        not_in_dataset = ~np.isin(recorded.behavior, recorded.behavior[from_dataset])
        spaces = fit_spaces(data, _selected(recorded, from_dataset | not_in_dataset))
    perception, counts = fit_and_validate(data, training, settings=perceives, spaces=spaces)
    return data, rows, perception, counts


def count_detections(
    record: Experience,
    counts: NDArray[np.int64],
    objects: Sequence[str],
    labels: Labels,
    detections: Labels,
) -> None:
    """Add percepts of a detector, for executions with labels (n,P), to counts (O,P,E,2,K).

    They are counted directly, together with the percepts of classifiers.
    """
    rows = {name: row for row, name in enumerate(objects)}
    row_of = np.array([rows.get(name, NONE) for name in record.objects], np.intp)
    instances = record.instances.values
    i, p = np.nonzero((detections >= 0) & (labels >= 0))
    cells = (row_of[instances["object"][i]], p, instances["behavior"][i])
    np.add.at(counts, (*cells, labels[i, p], detections[i, p]), 1)


def cut_by_labels(record: Experience, labels: Labels, n_levels: int) -> NDArray[np.float64]:
    """Return edges (P,E,K-1) between score levels, learned from labels (n,P) of executions.

    If scores are lower for true than for false objects, a warning says so once.
    """
    instances = record.instances.values
    edges, falling = cut_scores(
        record.scores.values,
        labels,
        instances["behavior"],
        instances["object"],
        behaviors=len(record.domain.behaviors),
        levels=n_levels,
    )
    for p, e in np.argwhere(falling).tolist():
        behavior, attribute = record.domain.behavior_names[e], record.domain.attributes[p]
        case = f"reversed scores {behavior} {attribute}"
        if case not in record.warned_of:
            record.warned_of.add(case)
            warn_user(
                f"The scores of {attribute!r} by {behavior} are lower if it is true, but must be "
                f"higher: return their negatives."
            )
    return edges


def cut_by_rank(
    record: Experience, edges: NDArray[np.float64], pairs: NDArray[np.bool_], n_levels: int
) -> NDArray[np.float64]:
    """Return edges (P,E,K-1) in which those of some pairs (P,E) are replaced by quantiles."""
    edges = edges.copy()
    instances = record.instances.values
    scores = record.scores.values
    pairs = pairs & views.given_pairs(record)
    for e in np.flatnonzero(pairs.any(axis=0)).tolist():
        rows = instances["behavior"] == e
        if not np.isnan(scores[rows]).all():
            means = object_means(scores[rows], instances["object"][rows])
            edges[pairs[:, e], e] = edges_by_rank(means, n_levels)
    return edges


def levels_by(record: Experience, edges: NDArray[np.float64]) -> Labels:
    """Return the levels (n,P) of the scores of all executions, by edges (P,E,K-1); -1 if none."""
    of_instances = edges.swapaxes(0, 1)[record.instances.values["behavior"]]
    return scored_levels(record.scores.values, of_instances)


def labels_used(
    record: Experience,
    settings: LearnerSettings,
    labels: Labels,
    detections: Labels,
    rows: NDArray[np.intp],
) -> Labels:
    """Return the labels (n,P) of executions that a refit uses for the posterior; -1 if none.

    These are the labels of the training set (rows (k,)) and of percepts of a detector. Each label
    is used once; later labels are used by `Online.update`. A posterior of the user's own contains
    only the experience that was given to the learner.
    """
    used = np.where(detections >= 0, labels, -1)
    used[rows] = labels[rows]
    if settings.posterior is not None:
        used[record.instances.values["origin"] != FROM_DATASET] = -1
    return used.astype(np.int8)


def trained_cells(
    record: Experience,
    settings: LearnerSettings,
    labels: Labels,
    detections: Labels,
    rows: NDArray[np.intp],
) -> NDArray[np.bool_]:
    """Return for which objects, behaviors and attributes (O,E,P) classifiers were trained.

    Percepts of these are not independent evidence. A posterior of the user's own may be learned
    from everything that was given, so it is treated as if classifiers were trained on all of it.
    """
    instances = record.instances.values
    taught = np.zeros(labels.shape, np.bool_)
    taught[rows] = (detections[rows] < 0) & (labels[rows] >= 0)
    if settings.posterior is not None:
        taught[:] = (instances["origin"] == FROM_DATASET)[:, None]
    shape = (len(record.objects), len(record.domain.behaviors), labels.shape[1])
    trained = np.zeros(shape, np.bool_)
    np.logical_or.at(trained, (instances["object"], instances["behavior"]), taught)
    return trained


def experience_of(
    record: Experience, agent: Agent, settings: LearnerSettings, apart: views.Rows = views.NO_ROWS
) -> tuple[NDArray[np.int64], float]:
    """Count labeled executions and objects, (2,P,E), and the normalizer of Eq. 10.

    The executions `apart` (k,) are not counted.
    """
    labeled = views.labeled(record, memory=agent.memory, apart=apart)
    counted = views.labeled(record, memory=agent.memory, given=settings.count_given, apart=apart)
    met = record.met_without(apart)
    unit = settings.unit or max(1.0, float(counted.max(initial=0)) * len(met))
    return np.stack([counted.sum(axis=0).T, (labeled > 0).sum(axis=0).T]), unit


def fractions(
    record: Experience, perception: Perception, counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the fractions (...,P,E,2,2) of no and yes among an object's percepts (...,P,E,2,K).

    They are zero if there are no percepts, and one half each if the classifier is undecided.
    """
    sides = no_and_yes_of(counts)
    total = sides.sum(axis=-1, keepdims=True)
    silent = np.ones(counts.shape[-4:-2], np.bool_)  # (P,E)
    for name, classifier in perception.classifiers.items():
        silent[:, perception.domain.behavior_index(name)] = ~classifier.used
    i, p = np.nonzero(views.detected(record))
    silent[p, record.instances.values["behavior"][i]] = False
    # One half each, so that uninformative percepts do not move the rates.
    even = silent[..., None, None] & (total > 0)
    return np.asarray(np.where(even, 0.5, sides / np.maximum(total, 1)))


def warn_of_odd(record: Experience, sizes: views.Sizes) -> None:
    """Warn once of recordings whose size differs from that of most others."""
    odd = [text for text in views.odd_recordings(record, sizes) if text not in record.warned_of]
    if odd:
        record.warned_of.update(odd)
        warn_user(f"Not used for learning: {listed(odd, 5)}.")


def warn_of_clocks(record: Experience, sizes: views.Sizes) -> None:
    """Warn once per modality of features whose values only increase from trial to trial.

    Features of recordings were checked when the recordings were read.
    """
    rows = record.instances.values
    for (behavior, modality), size in zip(record.domain.contexts, sizes.tolist(), strict=True):
        what = f"The robot's {modality} of {behavior}"
        features = record.features[behavior, modality]
        sensed = [
            i for i, v in features.items() if rows["origin"][i] == FROM_TRIAL and len(v) == size
        ]
        if sensed and what not in record.warned_of:
            values = np.stack([features[i] for i in sensed])
            if warn_of_order(what, values, rows["object"][sensed]):
                record.warned_of.add(what)


def _selected(training: TrainingSet, rows: NDArray[np.bool_]) -> TrainingSet:
    return TrainingSet(*(column[rows] for column in astuple(training)))
