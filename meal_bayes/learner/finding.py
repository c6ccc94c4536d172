"""`Learner.find`: claim one of several objects, or none."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from meal_bayes.arrays import check_seconds
from meal_bayes.datasets import object_index
from meal_bayes.domain import Query, read_question
from meal_bayes.domain.event import wrong_reward
from meal_bayes.errors import SettingsError
from meal_bayes.learner.answering import Answerer
from meal_bayes.learner.columns import Objects
from meal_bayes.learner.experienced_agent import NO_TABLE
from meal_bayes.learner.fit import solve
from meal_bayes.learner.search_input import (
    SearchOptions,
    check_others,
    checked_objects,
    claim_payoffs,
)
from meal_bayes.learner.trial import NO_CLASSIFIERS, TrialOptions
from meal_bayes.learner.views import labeled_table
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Policy, Prospector, SharedPlans
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.robots.several import RobotPerObject
from meal_bayes.seeds import Key, stream
from meal_bayes.trial_log.live import InterruptedSearch, SearchLog, resuming
from meal_bayes.trial_log.schema import FIND
from meal_bayes.trial_log.searches import search_of
from meal_bayes.trials import (
    FaultTolerant,
    Search,
    SearchingRobot,
    SearchRules,
    SearchSession,
    Session,
    Step,
    Task,
    run_search,
)
from meal_bayes.untrusted import LARGEST

# Arguments whose errors say more than of which kind they should be.
_READ_HERE = ("question", "robot", "objects", "payoffs", "none", "truth")


class Finder(Answerer):
    """Finds one of several objects by the questions of yes or no about each."""

    def find(
        self,
        question: str | Sequence[str] | Query,
        objects: Sequence[str] | int,
        robot: SearchingRobot | None = None,
        **options: Unpack[SearchOptions],
    ) -> Search:
        """Find the object of which the answer is yes ("Which one is full and red?"), or none.

        Every object's steps are a trial of its own, logged step by step; nothing is explored for
        later questions.

        Parameters
        ----------
        question : str | Sequence[str] | Query
            As of yes or no: attributes joined by *and* or *or*, perhaps with *not*.
        objects : Sequence[str] | int
            Their names, by which an agent with `memory` recognizes them, or how many new ones
            there are, which are then called "1", "2" and so on.
        robot : SearchingRobot, optional
            Has the methods `turn_to(name)` and `execute(behavior)`; without one, objects of the
            percept table are replayed.
        **options : Unpack[SearchOptions]
            As for `begin_find`.

        Returns
        -------
        search : Search
            The claim, and the trials.

        Raises
        ------
        QueryError
            A question that cannot be understood; payoffs that are none.
        SettingsError
            No objects, or one twice; an agent that compares no values; no data of the kind that the
            robot needs.
        RobotError
            The robot came to a state that it cannot be in.

        Examples
        --------
        >>> from meal_bayes import Learner, load_percepts
        >>> learner = Learner("roc36", logs=None).fit(load_percepts("roc36"))
        >>> boxes = ["light_blue_beans", "medium_brown_rice", "heavy_green_glass"]
        >>> learner.find("Which one is heavy?", boxes).claim
        'heavy_green_glass'
        """
        driver: Any = robot  # users give anything
        if not (driver is None or (hasattr(driver, "turn_to") and hasattr(driver, "execute"))):
            raise SettingsError(
                "A robot that finds has the methods turn_to(name) and execute(behavior); found "
                f"{driver!r:.60}. Where there is a robot for each object, give "
                "RobotPerObject({name: robot})."
            )
        if (robot is None) == (self.table is None):
            raise SettingsError(NO_TABLE if robot is None else NO_CLASSIFIERS)
        session = self.begin_find(question, objects, **options)
        return run_search(session, self.replays(session) if robot is None else robot)

    def replays(self, session: SearchSession) -> RobotPerObject:
        """Return the robot that replays the objects of a search, each where the search left it.

        What was executed before a restart is executed again, and fails and senses as it did.
        """
        robots = {}
        states = {}
        for name, explored in session.sessions.items():
            robots[name] = robot = self.replay(explored.task)
            if not explored.begun:
                continue
            states[name] = robot.start()
            for step in explored.steps:
                if step.decision.action < explored.momdp.n_behaviors:
                    behavior = explored.momdp.behavior_names[step.decision.action]
                    states[name] = robot.execute(behavior).state
        return RobotPerObject(robots, states)

    def begin_find(
        self,
        question: str | Sequence[str] | Query,
        objects: Sequence[str] | int,
        *,
        truth: Mapping[str, Mapping[str, bool]] | None = None,
        payoffs: Sequence[float] | None = None,
        none: float = 0.0,
        turn_cost: float = 0.0,
        learn: bool = True,
        log: str | Path | None = None,
        key: str | int | None = None,
        max_steps: int = MAX_STEPS,
        max_cost: float | None = None,
        on_step: Callable[[Step], None] | None = None,
    ) -> SearchSession:
        """Begin a search that somebody else drives; see `SearchSession` for what to do with it.

        Parameters
        ----------
        question, objects : Any
            As for `find`.
        truth : mapping, optional
            {object: {attribute: True or False}} of what is known; compared with the claim only.
        payoffs : Sequence[float], optional
            What a right and a wrong claim earn; by default what the learner's yes does.
        none : float
            What "none of them" earns.
        turn_cost : float
            s, of turning to an object.
        learn, key, max_steps, max_cost, on_step : Any
            As for `ask`; limits are of the whole search.
        log : str or Path, optional
            A folder, for a log of each object; a new one in the folder of logs by default.
        """
        names = checked_objects(objects)
        query = self._query_of_each(question, payoffs, none)
        check_seconds("turn_cost", turn_cost, LARGEST)
        check_seconds("max_cost", max_cost, or_none=True)
        if not isinstance(truth, Mapping | None):
            raise SettingsError(f"truth is {truth!r:.60}; give {{object: {{attribute: True}}}}.")
        for name in truth or ():
            if name not in names:
                raise SettingsError(f"truth is of {name!r:.60}, which is none of the objects.")
        folder = self._logs.search_folder(log)
        asked: Mapping[str, object] = {}
        with self._lock:
            if self.table is None:
                number = self._questions.next_key(learn=learn)
                asked = self._questions.count(learn=learn, key=key)
                key = number if key is None else key
        tasks = dict[str, tuple[Task, Key]]()
        for name in names:
            # Objects without a name share the key of the question: their numbers part its streams.
            object_name = None if isinstance(objects, int) else name
            tasks[name] = self._task(query, object_name, key if object_name else f"{key}, {name}")
        if self.table is not None:
            check_others(labeled_table(self.experience, self.table), names, query)
        text = question if isinstance(question, str) else query.text
        options = TrialOptions(learn=learn, max_steps=max_steps, max_cost=max_cost, on_step=on_step)
        session = self._search(text, tasks, truth or {}, options, float(turn_cost))
        if folder is not None:
            begun = {"turn_cost": float(turn_cost), **options.begun(self.domain.diagram.start)}
            config = {
                "command": FIND,
                "question": text,
                "agent": self.agent.name,
                "objects": names,
            }
            self._record_search(session, folder, {"config": config, "begun": begun, **asked})
        return session

    def resume_find(self, log: str | Path | None = None) -> SearchSession:
        """Go on with a search whose process ended in the middle of it, from its folder.

        The learner is the one that began it, or has been saved before and loaded since; it plans
        again what it had planned. The robot is where the last step, or the last turn, of the logs
        led (`replays` brings one there that replays recordings). What it sensed until then is in
        the logs, and is learned from. `run_search` goes on with the session.

        Parameters
        ----------
        log : str or Path, optional
            The folder of the search, or one of logs where one search was broken off; by default
            this learner's.

        Raises
        ------
        LogError
            There is no search that was broken off, or several; it is another learner's, or another
            process drives the robot.
        """
        path = self._logs.interrupted(log, "give resume_find() the search's folder")
        log_file = search_of(path)
        with resuming(path if log_file is None else log_file, InterruptedSearch) as broken:
            return self._resumed_search(broken)

    def _resumed_search(self, broken: InterruptedSearch) -> SearchSession:
        """Return the session of a search that was broken off, where it was."""
        search = broken.search
        header = broken.header
        begun = dict(header["begun"])
        turn_cost = begun.pop("turn_cost")
        begun.pop("state")
        tasks = {
            name: (trial.task, tuple(header["streams"][name]))
            for name, trial in search.trials.items()
        }
        truth = {name: trial.truth for name, trial in search.trials.items()}
        options = TrialOptions(**begun)
        session = self._search(search.question, tasks, truth, options, turn_cost)
        session.repeat(search)
        self.note_question(header)
        self._record_search(session, broken.path.parent, header, broken)
        return session

    def _record_search(
        self,
        session: SearchSession,
        folder: Path,
        header: Mapping[str, Any],
        resumed: InterruptedSearch | None = None,
    ) -> None:
        """Log a search from now on, in a folder with the logs of the objects that it explores."""

        def explore(name: str, explored: Session, path: Path) -> None:
            config = {**header["config"], "object": name}
            asked = {"asked": header["asked"]} if "asked" in header else {}
            self._record(explored, path, {"config": config, **asked})

        streams = {
            name: list(trial_session.key) for name, trial_session in session.sessions.items()
        }
        drawn = {"seed": self.settings.seed, "streams": streams, "data": self.domain.data}
        session.record(SearchLog(folder, {**drawn, **header}, explore, resumed=resumed))

    def _search(
        self,
        question: str,
        tasks: Mapping[str, tuple[Task, Key]],
        truth: Mapping[str, Any],
        options: TrialOptions,
        turn_cost: float,
    ) -> SearchSession:
        """Return the session of a search, by the task of each object and the key of its streams."""
        names = list(tasks)
        sessions = dict[str, Session]()
        prospectors = dict[str, Prospector]()
        diagram = self.domain.diagram
        leave = np.isin(diagram.states, self.domain.leave or (diagram.start,))
        shared: SharedPlans | None = None
        for name, (task, streams) in tasks.items():
            # Each object has a trial; the search commands it by what its prospector values.
            beside = self._others(names, name)
            settled = replace(options, truth=truth.get(name), commanded=True, abstain=True)
            sessions[name] = session = self._session(task, streams, settled, beside)
            with self._lock:
                fit = self._fit(task, learn=False, beside=beside)
            if shared is None:
                shared = SharedPlans(partial(solve, fit, task, (*names, *task.query.attributes)))
            planned = partial(self._planned, shared, task)
            prospectors[name] = Prospector(session.momdp, planned, leave)
        return SearchSession(
            question,
            sessions,
            prospectors,
            rules=SearchRules(diagram.start, turn_cost, options.max_steps, options.max_cost),
            rng=stream(self.settings.seed, "search", *names),
        )

    def _others(self, names: Sequence[str], name: str) -> Objects:
        """Return the rows of the other objects of a search in the table, if there is one."""
        if self.table is None:
            return ()
        return tuple(object_index(self.table.objects, other) for other in names if other != name)

    def _query_of_each(self, question: Any, payoffs: Any, none: float) -> Query:
        """Return the question of each object: claims earn as they do, and "no" what none earns."""
        query = question
        if not isinstance(question, Query):
            query = read_question(question, self.domain, "yes or no")
        reward = self.settings.reward
        usual = self.settings.payoffs or self.domain.payoffs
        usual_claim = (
            (reward, wrong_reward(reward)) if usual is None else (usual.right_yes, usual.wrong_yes)
        )
        earned = claim_payoffs(usual_claim, payoffs, none)
        return Query(query.attributes, query.groups, query.group_names, query.event, earned)

    def _planned(self, shared: SharedPlans, task: Task, momdp: MOMDP) -> Policy:
        """Return who values a problem of an object; of a robot's without behaviors that fail."""
        policy = shared(momdp)
        if task.object_index >= 0:
            return policy
        usual = self.domain.diagram.compile(self.domain.behavior_names)
        return FaultTolerant(momdp, policy, shared, usual)
