"""Tests of replayed objects that share what equal questions have in common.

Between two changes of what a learner knows, the tests of one question have one problem and one
policy, and what they do depends on what they perceived alone. So each history is decided, and each
recording perceived, once for all tests; a test only draws what its robot does. Trials are those of
`Learner.ask`, in every value.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from meal_bayes.arrays import Floats, tiny_is_zero
from meal_bayes.datasets import Dataset
from meal_bayes.learner.experience import Labels
from meal_bayes.learner.fit import told_of
from meal_bayes.learner.online import Online
from meal_bayes.learner.perceived import levels_of_recordings
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.momdp.belief import initial_belief
from meal_bayes.planners import Decision, History
from meal_bayes.planners.solver import MAX_STEPS, MemoizedPolicy, decide
from meal_bayes.robots import Outcome, OutcomeChecker
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.seeds import Streams
from meal_bayes.trials import Step, Task, Trial, truth_of
from meal_bayes.trials.perceiving import PerceptReader
from meal_bayes.trials.record import answer_step
from meal_bayes.trials.session import Limits, executed_step, within

_LIMITS = Limits(MAX_STEPS)
_NO_RNG = np.random.default_rng(0)  # which a remembered policy does not read


@dataclass(slots=True)
class _Node:
    """A history of a question's tests, what is decided after it, and where that leads."""

    history: History
    decision: Decision
    warning: str  # which limit brought the answer
    after: dict[tuple[int, bytes | None, str], tuple[Step, "_Node"]] = field(default_factory=dict)
    answers: dict[bytes, Step] = field(default_factory=dict)  # by the right report


@dataclass(slots=True)
class _Question:
    """The problem of a question, its policy, and the histories so far."""

    momdp: MOMDP
    policy: MemoizedPolicy
    belief: Belief  # before the trial begins
    counts: Floats  # (N,E,2,K)
    columns: list[int]
    roots: dict[str, _Node] = field(default_factory=dict)  # by the state at the start


class SharedTests:
    """Runs the tests of one agent from its fit, while that does not change.

    Parameters
    ----------
    fit : Online
        What the agent knows.
    dataset : Dataset
        Recordings that the robots replay.
    ask : Callable[[Task, RecordedRobot, Labels], Trial]
        Runs a test that shares nothing: of an agent that decides by chance or recognizes the
        object, or whose percepts are drawn.
    """

    def __init__(
        self, fit: Online, dataset: Dataset, ask: Callable[[Task, RecordedRobot, Labels], Trial]
    ) -> None:
        self._fit = fit
        self._dataset = dataset
        self._ask = ask
        self._questions: dict[tuple[object, bytes], _Question | None] = {}
        self._perceived: dict[str, dict[tuple[int, int], Labels]] = {}  # by behavior
        self._checkers: dict[int, OutcomeChecker] = {}

    @tiny_is_zero
    def run(self, task: Task, robot: RecordedRobot, truth: Labels) -> Trial:
        """Run a test on a replayed object whose truth (N,) is known."""
        question = self._question(task, robot)
        if question is None:
            return self._ask(task, robot, truth)
        momdp = question.momdp
        node = self._root(question, task, robot.start())
        streams = Streams(self._fit.settings.seed, task.key)
        steps = []
        while node.decision.action < momdp.n_behaviors:
            outcome = robot.execute(momdp.behavior_names[node.decision.action])
            step, node = self._follow(question, task, node, outcome, streams)
            steps.append(step)
        known = truth_of(task.query, truth)
        right = task.query.report_truth(known)
        key = right.tobytes()
        if key not in node.answers:
            belief = node.history.belief
            node.answers[key] = answer_step(momdp, belief, node.decision, right, node.warning)
        return Trial(
            task=task,
            agent=self._fit.agent.name,
            momdp=momdp,
            first_belief=question.belief,
            steps=(*steps, node.answers[key]),
            truth=known,
            report=momdp.reported(node.decision.action),
            ended="",
            counts=question.counts,
        )

    def _question(self, task: Task, robot: RecordedRobot) -> _Question | None:
        """Return what tests of a question share; None where they share nothing."""
        fit = self._fit
        if fit.settings.drawn is not None or told_of(fit, task) is not None:
            return None
        limit = robot.limit
        key = task.query, limit.tobytes()
        if key not in self._questions:
            momdp, policy = fit.plan(task, task.key, limit=limit, explore=False)
            self._questions[key] = None
            if isinstance(policy, MemoizedPolicy):
                columns = fit.record.domain.columns(task.query.attributes)
                counts = fit.knowledge.posterior.counts[columns]
                belief = initial_belief(momdp)
                self._questions[key] = _Question(momdp, policy, belief, counts, columns)
        return self._questions[key]

    def _root(self, question: _Question, task: Task, state: str) -> _Node:
        if state not in question.roots:
            x = self._checker(task.object_index).start(state)
            question.roots[state] = _decided(question, History(question.belief.at(x)))
        return question.roots[state]

    def _follow(
        self, question: _Question, task: Task, node: _Node, outcome: Outcome, streams: Streams
    ) -> tuple[Step, _Node]:
        """Return the step that an outcome makes of a decision, and what is decided after it."""
        momdp = question.momdp
        history = node.history
        action = node.decision.action
        next_x = momdp.x_names.index(outcome.state)
        levels, warning = self._percept(question, task, node, outcome, streams)
        key = next_x, None if levels is None else levels.tobytes(), warning
        if key not in node.after:
            step = executed_step(
                momdp, history.belief, node.decision, next_x, levels, warning=warning
            )
            after = history.after(
                step.belief,
                action,
                perceived=levels is not None,
                cost=step.cost,
                unread=step.unread,
            )
            node.after[key] = step, _decided(question, after)
        return node.after[key]

    def _percept(
        self,
        question: _Question,
        task: Task,
        node: _Node,
        outcome: Outcome,
        streams: Streams,
    ) -> tuple[Labels | None, str]:
        """Return the percept levels (N,) of an outcome, or None, and a warning."""
        momdp = question.momdp
        action = node.decision.action
        x = node.history.belief.x
        # By the model nothing comes of a failure, see `Session.observe`.
        silent = (
            outcome.state == momdp.x_names[x] and not momdp.observation_probability[action, x, x]
        )
        recording = outcome.recording
        if outcome.features is not None and recording is not None and not silent:
            known = self._levels_of(momdp.behavior_names[action])
            if (task.object_index, recording) in known:
                return known[task.object_index, recording][question.columns], ""
        checker = self._checker(task.object_index)
        execution = checker.execute(action, outcome)
        execution = execution.failure() if silent else execution
        perceiver, _ = self._fit.perceiving(task, momdp, contextlib.nullcontext(), lambda _: None)
        reader = PerceptReader(task, momdp, checker, perceiver, rng=streams.of("percepts"))
        return reader.read(execution, action, node.history)

    def _levels_of(self, behavior: str) -> dict[tuple[int, int], Labels]:
        """Return the percept levels (P,) of a behavior's whole recordings."""
        if behavior not in self._perceived:
            fit = self._fit
            self._perceived[behavior] = levels_of_recordings(
                fit.perception, self._dataset, behavior, fit.expected_sizes, fit.agent.levels
            )
        return self._perceived[behavior]

    def _checker(self, o: int) -> OutcomeChecker:
        """Return what checks the outcomes of an object."""
        if o not in self._checkers:
            domain = self._fit.record.domain
            sizes = self._fit.expected_sizes
            self._checkers[o] = OutcomeChecker(domain, object_index=o, sizes=sizes)
        return self._checkers[o]


def _decided(question: _Question, history: History) -> _Node:
    """Decide after a history, and return its node."""
    momdp = question.momdp
    decision = decide(question.policy, history, _NO_RNG)
    decision, warning = within(_LIMITS, momdp, history, decision)
    momdp.check_action(history.belief.x, decision.action)
    return _Node(history, replace(decision, momdp=momdp), warning)
