"""A search under way; what comes next is chosen by all objects (`planners.several_objects`)."""

from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.errors import SettingsError
from meal_bayes.planners import EMPTY, Decision, Prospect, Prospector, best_move
from meal_bayes.robots.robot import Outcome, state_index
from meal_bayes.trials.limits import Limits
from meal_bayes.trials.one_caller import OneCaller, alone
from meal_bayes.trials.record import Step
from meal_bayes.trials.recorder import breaking, noted, otherwise
from meal_bayes.trials.search import Search, SearchRules
from meal_bayes.trials.session import Session


@runtime_checkable
class SearchRecorder(Protocol):
    """Writes a search as it happens: each turn before what comes next is named."""

    def begin_search(self, search: Search) -> None:
        """Record what is searched for, among which objects."""

    def turn(self, number: int, name: str, state: str) -> None:
        """Record the next turn, to an object in a state."""

    def explore(self, name: str, session: Session) -> None:
        """Record the trial of an object from now on."""

    def end_search(self, search: Search) -> None:
        """Record the answer."""


class SearchSession(OneCaller):
    """A search under way: it names an object to turn to, or a behavior, and is given the outcome.

    Whoever drives turns to `turn` where it is not None, and says so by `turned`; else executes
    `behavior` on the `object` in front, and gives its outcome to `observe`; until it is `over`.

    Parameters
    ----------
    question : str
        What is searched for.
    sessions : Mapping[str, Session]
        A trial of each object, not begun, that is commanded and may abstain.
    prospectors : Mapping[str, Prospector]
        What values each object.
    rules : SearchRules
        Costs and limits.
    rng : np.random.Generator
        Of the planner.

    Attributes
    ----------
    turn : str | None
        The object to turn to next; None where none is.
    object : str | None
        The object in front, to which the robot turned last; None before the first turn.
    """

    def __init__(
        self,
        question: str,
        sessions: Mapping[str, Session],
        prospectors: Mapping[str, Prospector],
        *,
        rules: SearchRules,
        rng: np.random.Generator,
    ) -> None:
        super().__init__()
        if not sessions or set(sessions) - set(prospectors):
            raise SettingsError(
                f"sessions are of {[*sessions]}; give one, and a prospector of each."
            )
        self.question = question
        self.sessions = dict(sessions)
        self.object: str | None = None
        self.turn: str | None = None
        self._prospectors = prospectors
        self._rules = rules
        self._rng = rng
        self._recorder: SearchRecorder | None = None
        self._prospects = {name: self._prospect(name) for name in self.sessions}
        self._none = next(iter(self.sessions.values())).momdp.reports.payoffs.right_no
        self._turns: list[tuple[str, str]] = []  # object, and the state that it was found in
        self._claim: str | None = None
        self._ended: str | None = None
        self._decide()

    def __repr__(self) -> str:
        """Return the search so far."""
        return repr(self.search)

    @property
    def search(self) -> Search:
        """The search so far."""
        trials = {name: session.trial for name, session in self.sessions.items()}
        return Search(
            question=self.question,
            trials=trials,
            turns=tuple(name for name, _ in self._turns),
            claim=self._claim,
            none=self._none,
            turn_cost=self._rules.turn_cost,
            ended="under way" if self._ended is None else self._ended,
            states=tuple(state for _, state in self._turns),
        )

    @alone
    def record(self, recorder: SearchRecorder) -> None:
        """Record what there is of the search, and all that follows as it happens."""
        recorder.begin_search(self.search)
        for number, (name, state) in enumerate(self._turns):
            recorder.turn(number, name, state)
        begun = [name for name, session in self.sessions.items() if session.begun]
        for name in dict.fromkeys((*self.search.turns, *begun)):
            recorder.explore(name, self.sessions[name])
        self._recorder = recorder
        if self.over:
            recorder.end_search(self.search)

    @alone
    def repeat(self, before: Search) -> None:
        """Repeat what was done before a restart; the robot does not move.

        All is decided again, so that the random stream stands where it stood.

        Raises
        ------
        LogError
            It is decided otherwise than it was then.
        """
        turns = deque(zip(before.turns, before.states, strict=True))
        steps = dict[str, deque[Step]]()
        for name, trial in before.trials.items():
            behaviors = trial.momdp.n_behaviors
            steps[name] = deque(step for step in trial.steps if step.decision.action < behaviors)
        while not self.over:
            if self.turn is not None:
                if not turns or turns[0][0] != self.turn:
                    break
                self._turned(turns.popleft()[1])
            else:
                name = self._explored
                if not steps[name]:
                    break
                self.sessions[name].repeat([steps[name].popleft()])
                self._go_on(name)
        unmatched = [*(name for name, _ in turns), *(name for name in steps if steps[name])]
        if unmatched:
            now = self.turn or self.behavior or "the answer"
            raise otherwise(f"The search went on with {unmatched[0]}", now)

    @property
    def over(self) -> bool:
        """Whether the search has ended."""
        return self._ended is not None

    @property
    def behavior(self) -> str | None:
        """Name of the behavior to execute next; None while a turn is waited for, or it is over."""
        if self.object is None or self.turn is not None:
            return None
        return self.sessions[self.object].behavior

    @alone
    def turned(self, state: str) -> None:
        """Note that the robot has turned to the object `turn`, which is in a state.

        Raises
        ------
        SettingsError
            No turn is under way.
        RobotError
            A state that a robot cannot be in.
        """
        self._turned(state)

    def _turned(self, state: str) -> None:
        name = self.turn
        if name is None:
            raise SettingsError("No turn is under way: execute `behavior`, or the search is over.")
        session = self.sessions[name]
        x = state_index(session.momdp.x_names, state, f"turn_to({name!r})")
        if self._recorder is not None:
            self._recorder.turn(len(self._turns), name, state)
        # An object that was left is found where it stood; what was perceived of it holds.
        if session.begun:
            session.belief = session.belief.at(x)
            session.history = replace(session.history, belief=session.belief)
        else:
            self._begin(name, state)
        self.object = name
        self.turn = None
        self._turns.append((name, state))
        self._go_on(name)

    @alone
    def observe(self, outcome: Outcome) -> None:
        """Perceive the outcome of `behavior`, update the belief of its object, and decide again.

        Raises
        ------
        SettingsError
            No behavior is under way.
        RobotError
            A state that a robot cannot be in.
        """
        self._observe(outcome)

    def _observe(self, outcome: Outcome) -> None:
        name = self._explored
        with breaking(self._break):
            self.sessions[name].observe(outcome)
        self._go_on(name)

    @property
    def _explored(self) -> str:
        """The object whose behavior is under way; `SettingsError` where none is."""
        if self.object is None or self.behavior is None:
            raise SettingsError("No behavior is under way: a turn is, or the search is over.")
        return self.object

    @alone
    def fail(self) -> None:
        """Note that `behavior` failed: the state is as it was, and nothing was perceived."""
        session = self.sessions[self._explored]
        self._observe(Outcome(session.momdp.x_names[session.belief.x]))

    @alone
    def cancel(self, why: str = "cancelled") -> None:
        """End the search without an answer; one that is over stays as it is."""
        self._cancel(why)

    def _cancel(self, why: str) -> None:
        if not self.over:
            try:
                for session in self.sessions.values():
                    if session.begun:
                        session.cancel(why)
            finally:  # also where their ends cannot be logged
                self._end(why)

    def _prospect(self, name: str) -> Prospect:
        return self._prospectors[name].prospect(self.sessions[name].history, self._rng)

    def _go_on(self, name: str) -> None:
        """Value anew the object of which something is new, and decide."""
        with breaking(self._break):
            self._prospects[name] = self._prospect(name)
            self._decide()

    def _break(self, fault: BaseException) -> None:
        """End the search by an exception, unless a turn or a behavior is waited for still."""
        if self.turn is None and self.behavior is None:
            self._end_by(fault)

    def _end_by(self, fault: BaseException) -> None:
        with noted(fault, None):
            self._cancel(f"error: {type(fault).__name__}: {fault}".removesuffix(": "))

    def _decide(self) -> None:
        """Carry out what `best_move` chooses: a behavior, another object, or the answer."""
        names = list(self.sessions)
        turning = self._rules.turn_cost
        prospects = [
            replace(self._prospects[name], turning=0.0 if name == self.object else turning)
            for name in names
        ]
        front = -1
        hand = EMPTY
        if self.object is not None:
            front = names.index(self.object)
            hand = self._prospectors[self.object].hand(self.sessions[self.object].belief)
        move = best_move(prospects, front, hand)
        if move.behavior < 0:
            self._answer(names[move.object] if move.object >= 0 else None)
        elif move.object == front:
            self._execute(move.behavior, move.values, prospects[front].claim_value)
        elif self._within_limits(turning):
            self.turn = names[move.object]

    def _execute(self, action: int, values: Floats, claim_value: float) -> None:
        """Command a behavior of the object in front, unless a limit is reached."""
        session = self.sessions[self.object or ""]
        if self._within_limits(session.momdp.charged(action, failed=False)):
            compared = np.where(np.isinf(values), np.nan, values)
            session.command(Decision.exact(action, np.append(compared, claim_value)))

    def _within_limits(self, cost: float) -> bool:
        """Return whether so many seconds may still be spent; else give the best answer."""
        search = self.search
        steps = sum(len(trial.steps) for trial in search.trials.values())
        limits = Limits(self._rules.max_steps, self._rules.max_cost)
        if not limits.reached(steps, search.cost + cost):
            return True
        # At a limit: the object of the largest value, or none where that is worth more.
        claims = {name: prospect.claim_value for name, prospect in self._prospects.items()}
        best = max(claims, key=lambda name: claims[name])
        self._answer(best if claims[best] > self._none else None)
        return False

    def _answer(self, name: str | None) -> None:
        """Claim an object, or none; what was explored besides is left without a report."""
        self._claim = name
        if name is not None and not self.sessions[name].begun:
            self._begin(name, self._rules.start)
        # Each trial ends in its own words: yes (E + 1) of the claimed one, others abstain.
        for other, session in self.sessions.items():
            if session.begun:
                e = session.momdp.n_behaviors
                values = np.full(e + 1, np.nan)
                values[-1] = self._prospects[other].claim_value
                action = e + 1 if other == name else session.momdp.abstention
                session.command(Decision.exact(action, values))
        self._end("")

    def _begin(self, name: str, state: str) -> None:
        if self._recorder is not None:
            self._recorder.explore(name, self.sessions[name])
        self.sessions[name].start(state)

    def _end(self, why: str) -> None:
        self._ended = why
        self.turn = None
        if self._recorder is not None:
            self._recorder.end_search(self.search)
