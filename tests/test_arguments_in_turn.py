"""Each argument of a public function or class in turn is of another kind; the others are right."""

import collections.abc
import contextlib
import importlib
import inspect
import math
import pkgutil
import typing
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import rerun
from numpy.typing import ArrayLike
from sklearn.naive_bayes import GaussianNB

import meal_bayes as mb
from meal_bayes import (
    agents,
    datasets,
    domain,
    evaluation,
    experiments,
    gym,
    learner,
    momdp,
    perception,
    planners,
    posterior,
    robots,
    simulated_arm,
    testing,
    trial_log,
    trials,
    viewer,
)  # fmt: skip
from meal_bayes.errors import MealBayesError

TOY = domain.load_domain("toy")
QUERY = domain.Query(TOY.attributes[:2])
BEHAVIORS = len(TOY.behaviors)
CONFUSION = np.random.default_rng(0).dirichlet(np.ones(2), (2, BEHAVIORS, 2))
PROBLEM = momdp.build_momdp(TOY, QUERY, CONFUSION)
ONE = momdp.build_momdp(TOY, domain.Query(TOY.attributes[:1]), CONFUSION[:1])
BELIEF = momdp.initial_belief(PROBLEM)
TABLE = datasets.load_percepts("roc36")
TRIALS = [
    learner.ask("heavy", dataset=TABLE, object=name, agent="greedy", logs=None)
    for name in TABLE.objects[:3]
]
OUTCOMES = trials.TrialOutcomes.of(TRIALS)
DATA = datasets.make_synthetic(TOY, objects=6, recordings=3, rng=np.random.default_rng(0))
TRAINING = datasets.TrainingSet.everything(DATA)
KNOWLEDGE = agents.knowledge_without(TABLE, 0)
EVENT = domain.read_event("red and not heavy", TOY, (10, -10, 5, -5))
SOLVER = planners.OpenLoop()
RNG = np.random.default_rng(0)
POLICY = SOLVER.solve(PROBLEM, RNG)
HISTORY = planners.History(BELIEF)
PAIRS = np.zeros((2, BEHAVIORS, 2, 2))
LEARNER = learner.Learner("toy", logs=None)
USUAL = TOY.diagram.compile(TOY.behavior_names)
X = len(PROBLEM.x_names)


class Still:
    """A driver of the toy domain that stays where it is, and senses nothing."""

    def start(self):
        return "x0"

    def execute(self, behavior):
        return mb.Outcome("x0")

    def turn_to(self, name):
        return "x0"


def solve(problem):
    return SOLVER.solve(problem, RNG)


TASK = trials.Task("task", QUERY, -1, "cup", ("a", 1))
CHECKER = robots.OutcomeChecker(TOY)
PERCEIVER = perception.RecordedPercepts(TABLE)
CLAIM = momdp.build_momdp(
    TOY, domain.read_event("red", TOY, (10, -10, 5, 5)), np.full((1, BEHAVIORS, 2, 2), 0.5),
    objective=momdp.Objective(abstain=True),
)  # fmt: skip


def session(problem=PROBLEM, policy=None):
    return trials.Session(replace(TASK, query=problem.query), problem, policy, CHECKER, PERCEIVER)


def search():
    held = {name: session(CLAIM) for name in ("cup", "can")}
    values = {name: planners.Prospector(CLAIM, solve, np.ones(X, bool)) for name in held}
    rules = trials.SearchRules("x0")
    return trials.SearchSession("red", held, values, rules=rules, rng=RNG)


EXAMPLES = [  # of classes whose fields are their arguments
    TRIALS[0], TRIALS[0].task, TRIALS[0].steps[0], TRIALS[0].steps[0].decision, OUTCOMES, PROBLEM,
    BELIEF, momdp.flatten(PROBLEM), momdp.Objective(), momdp.Transition(0, BELIEF.x, None), HISTORY,
    momdp.build_momdp(TOY, EVENT, CONFUSION).reports, POLICY, SOLVER, planners.POMCP(),
    planners.Factored(), planners.Greedy(), planners.Random(), planners.RandomLegal(),
    planners.Untouched(), planners.Predefined(("look",)), planners.MemoizedPolicy(POLICY),
    planners.EMPTY, planners.Move(0, 0, np.zeros(3)), planners.GoingOn(1.0, 0.0, 1.0),
    planners.TreeEdge(0, -1, 0, (), 1, 0.0), planners.Compiling("a", "b", 1, 2),
    planners.Prospect(np.arange(3.0), np.ones((3, 1)), 0.0), KNOWLEDGE, KNOWLEDGE.posterior,
    agents.load_agent("bayes"), agents.Horizon(), agents.ITRSBonus(), agents.LearningBonus(),
    agents.NoBonus(), TABLE, DATA, TRAINING, DATA.instance(0, "look", 0), TOY, TOY.diagram,
    TOY.diagram.effects[0], TOY.behaviors[0], QUERY, EVENT.event, EVENT.payoffs,
    evaluation.clustered([1.0, 0.0], ["a", "b"]), evaluation.Interval(0.5, 0.1, 0.3, 0.7),
    evaluation.answer_rates(TRIALS), evaluation.summarize(TRIALS)[0],
    experiments.OfflineConfig("roc36", trials=1, agents=("prior",)),
    experiments.OnlineConfig("toy", trials=1, batches=1, agents=("bayes",)),
    learner.LearnerSettings(), perception.fit_and_validate(DATA, TRAINING)[0], perception.DEFAULT,
    perception.RecordedPercepts(TABLE), perception.TableSource.of(TABLE), mb.Outcome("x0"),
    perception.SampledPercepts(TOY, DATA.labels, CONFUSION[None].repeat(2, 0)[0]),
    trial_log.Feedback("cup", {"heavy": 1}), trials.SearchRules("x0"),
    trials.Search("which is heavy?", {"cup": TRIALS[0]}, ("cup",), None),
    trials.BatchOutcomes("bayes", 0, 0, 1.0, OUTCOMES),
    trial_log.Group({}, Path("a.mcap"), [0], OUTCOMES, tuple(TRIALS)),
    trial_log.LogInfo(Path("a.mcap"), "full", 1, 1, 1.0, {}),
    agents.Progress(
        KNOWLEDGE, agents.Horizon(), 100.0, 1.0, PAIRS, 0.9, 12.0, PAIRS[..., 0, 0].astype(int),
        PAIRS[..., 0, 0].astype(int), np.ones((2, BEHAVIORS), bool), np.zeros(2, bool),
    ),
    trials.FaultTolerant(PROBLEM, POLICY, solve, USUAL),
]  # fmt: skip
RIGHT = {  # by the name of an argument
    "action": 0, "alpha": 1.0, "attempts": np.zeros((BEHAVIORS, 2), int), "behavior": 0,
    "belief": BELIEF, "beta": 1.0, "candidates": ["a"], "classifier": None, "clusters": ["a", "b"],
    "confusion": CONFUSION, "data": "roc36", "dataset": DATA, "domain": TOY, "end": print,
    "estimate": lambda values: evaluation.clustered(values, ["a", "b"]),
    "experience": np.zeros((2, BEHAVIORS)), "exploration": agents.NoBonus(), "first": OUTCOMES,
    "gathered": TRAINING, "header": {}, "held_out": 0, "joint": np.full(4, 0.25), "key": ("a", 1),
    "kind": "object", "learner": LEARNER, "leave": np.ones(X, bool), "log_prob": BELIEF.log_prob,
    "measure": "reward", "momdp": PROBLEM, "n_attributes": 1, "objects": ("a", "b"), "name": "a",
    "observation": [0, 1], "outcomes": OUTCOMES, "path": "a.pomdp",
    "percept_counts": BELIEF.percept_counts, "positive": [0.5, 0.25], "prior": np.full(3, 0.5),
    "query": QUERY, "question": "red", "rates": np.full((3, BEHAVIORS, 2), 0.5), "ratio": 0.5,
    "recordings": 2, "report": np.array([True, False]), "right": True, "rng": RNG, "seed": 0,
    "second": OUTCOMES, "solve": solve, "solver": SOLVER, "table": TABLE, "to": Path("a.rrd"),
    "training_set": TRAINING, "transition": momdp.Transition(0, BELIEF.x, None), "trials": TRIALS,
    "truth": [1, 0], "value": "bayes", "values": [1.0, 0.0], "x": 0, "watching": lambda: False,
}  # fmt: skip


OFFLINE = experiments.OfflineConfig("roc36", trials=1, agents=("prior",))
EXAMPLES += [
    experiments.OfflineRun(OFFLINE, Path(), (), {}),
    experiments.OnlineRun(experiments.OnlineConfig("toy"), Path()),
    trials.TrialRecord(*(getattr(TRIALS[0], f.name) for f in fields(TRIALS[0]))),
]
RIGHT |= {
    "config": OFFLINE, "folder": "it", "object": TABLE.objects[0], "robot": Still(),
    "progress": next(each for each in EXAMPLES if isinstance(each, agents.Progress)),
    "prospects": [each for each in EXAMPLES if isinstance(each, planners.Prospect)],
    "parameters": simulated_arm.draw_object(0), "rules": trials.SearchRules("x0"),
    "sessions": {"cup": session(CLAIM)}, "checker": CHECKER, "task": TASK, "policy": POLICY,
    "prospectors": {"cup": planners.Prospector(CLAIM, solve, np.ones(X, bool))},
    "perceiver": PERCEIVER,
    "recording": "a.rrd", "robots": {"cup": Still()}, "report": np.array([True, False]),
}  # fmt: skip
LOG = str(Path(__file__).resolve().parents[1] / "logs" / "sample.mcap")
# Functions, and what they take that has the name of something else.
OWN = {
    datasets.load_dataset: {"name": "roc36"}, datasets.make_synthetic: {"objects": 4},
    datasets.load_percepts: {"name": "roc36"}, datasets.save_percepts: {"path": "a.npz"},
    domain.domain_from_table: {"table": domain.domain_table(TOY)},
    domain.load_domain: {"name": "toy"}, evaluation.compare: dict.fromkeys(
        ("first", "second"), "greedy"
    ),
    experiments.offline_tasks: {"trials": 3}, learner.ask: {"dataset": TABLE, "question": "heavy"},
    planners.batched_value_iteration: {"momdp": ONE}, agents.load_agent: {"name": "bayes"},
    learner.Learner: {"domain": "toy"}, planners.watch_compilation: {"report": print},
    trials.run_trial: {"session": session(policy=POLICY)}, trials.run_search: {"session": search()},
    viewer.Replay: {"stream": rerun.RecordingStream("a")}, trial_log.log_info: {"path": LOG},
    experiments.run_online: {"config": experiments.OnlineConfig("toy", trials=1, batches=1)},
    gym.MealEnv: {"dataset": TABLE, "logs": None}, trial_log.TrialWriter: {"path": "a.mcap"},
    trial_log.write_trials: {"path": "a.mcap"}, trial_log.read_header: {"path": LOG},
    trial_log.read_feedback: {"path": LOG}, trial_log.read_outcomes: {"path": LOG},
    trial_log.recover_log: {"path": LOG, "out": "b.mcap"}, trial_log.salvage: {"path": LOG},
    trial_log.check_log: {"path": LOG},
    trial_log.log_files: {"path": LOG}, trial_log.read_trials: {"path": LOG},
    testing.check_classifier: {"classifier": GaussianNB()}, learner.recall: {"logs": LOG},
    trial_log.Logs: {"paths": LOG}, viewer.write_recording: {"path": "a.rrd"},
    perception.with_classifier: {"classifier": GaussianNB()},
}  # fmt: skip
# What they begin is not done here: a program, physics, a run of minutes; they only refuse.
BEGINS = {
    viewer.Viewer, viewer.take_picture, viewer.follow, simulated_arm.training_recordings,
    simulated_arm.learn_live, simulated_arm.ask_new, simulated_arm.find_new, experiments.run_online,
    datasets.fetch, datasets.verify, datasets.load_dataset, testing.check_solver,
}  # fmt: skip
REFUSED = {  # by other errors of ours, before they look at all that they are given
    evaluation.compare_outcomes,  # compares two agents, and is given one
    testing.check_robot,  # its robot senses nothing
    learner.recall,  # its trial is of another domain
    trial_log.read_search,  # is given a log of trials
}
UNCHECKED = {momdp.predictive}  # arithmetic of a line, which kernels compile
# What is made at every step, or by a driver: whoever takes it looks at it; arrays at birth.
RECORDS = {
    momdp.Belief, momdp.Reports, momdp.Transition, planners.Decision, planners.GoingOn,
    planners.Hand, planners.History, planners.Move, planners.TreeEdge, robots.Outcome, trials.Step,
}  # fmt: skip
# Arguments that other checks read, as these take more than what is kept, or say more.
READ = {"learner.LearnerSettings.posterior"}


def public():
    """Yield the public functions and classes by package and name."""
    for info in pkgutil.iter_modules(mb.__path__):
        if info.ispkg and info.name != "cli":
            module = importlib.import_module(f"meal_bayes.{info.name}")
            for name in getattr(module, "__all__", ()):
                value = getattr(module, name)
                if inspect.isroutine(value) or inspect.isclass(value):
                    yield f"{info.name}.{name}", value


def arguments_of(value):
    """Return the parameters of a function or class by name."""
    return {
        name: each
        for name, each in inspect.signature(value).parameters.items()
        if each.kind is not each.VAR_KEYWORD
    }


def checked_values():
    """Yield what takes arguments that are checked, by name."""
    seen = set()
    for name, value in public():
        error = inspect.isclass(value) and issubclass(value, Exception)
        protocol = getattr(value, "_is_protocol", False)
        if not (error or protocol or value in UNCHECKED or value in seen) and arguments_of(value):
            seen.add(value)
            yield name, value


def right_arguments(value):
    """Return a right value of each argument that has to be given, or of all fields of a class."""
    for example in EXAMPLES:
        if type(example) is value:
            return {name: getattr(example, name) for name in arguments_of(value)}
    own = RIGHT | OWN.get(value, {})
    return {
        name: own[name]
        for name, each in arguments_of(value).items()
        if each.default is each.empty or name in OWN.get(value, {})
        if each.kind is not each.VAR_POSITIONAL or name in OWN.get(value, {})
    }


def call(value, arguments):
    """Call a function or class, and bring to its end what it begins."""
    given = dict(arguments)
    parameters = arguments_of(value)
    further = [name for name, each in parameters.items() if each.kind is each.VAR_POSITIONAL]
    last = [given.pop(name) for name in further if name in given]
    places = [name for name, each in parameters.items() if each.kind is each.POSITIONAL_OR_KEYWORD]
    first = [given.pop(name) for name in places] if last else []
    result = value(*first, *last, **given)
    if inspect.isgenerator(result):
        list(result)
    elif isinstance(result, contextlib.AbstractContextManager) and inspect.isroutine(value):
        with result:
            pass


WRONG = {
    "5": 5, "None": None, "text": "x", "empty": [], "nan": math.nan, "array": np.zeros((2, 3)),
    "object": object(), "list": [5], "mapping": {}, "mixed": ["x", None], "-1": -1,
    "pairs": {"x": None}, "a class": Still,
}  # fmt: skip
VALUES = dict(checked_values())
ARGUMENTS = [(name, argument) for name, value in VALUES.items() for argument in arguments_of(value)]


def hint_of(value, argument):
    """Return what an argument is annotated with."""
    made = value
    if inspect.isclass(value):
        made = value.__new__ if issubclass(value, tuple) else value.__init__
    return typing.get_type_hints(made).get(argument, object)


def is_open(hint):
    """Return whether anything may be given, of which the function itself makes what it can."""
    parts = typing.get_args(hint)
    return hint in (object, typing.Any) or all(each in parts for each in typing.get_args(ArrayLike))


def is_function(hint):
    """Return whether a function may be given: what a class raises that is called is its own."""
    return collections.abc.Callable in map(typing.get_origin, (hint, *typing.get_args(hint)))


def refusal(value, arguments):
    """Call a function; return "taken", the package's own error, or another one, as text."""
    try:
        call(value, arguments)
    except MealBayesError as error:
        return str(error)
    except Exception as error:
        return f"raw: {error!r}"
    return "taken"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", [name for name in VALUES if VALUES[name] not in BEGINS | REFUSED])
@pytest.mark.filterwarnings("ignore")
def test_the_right_arguments_are_taken(name):
    call(VALUES[name], right_arguments(VALUES[name]))


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS, ids=map(".".join, ARGUMENTS))
@pytest.mark.filterwarnings("ignore")
def test_an_argument_of_another_kind_is_the_package_s_own_error(name, argument):
    value = VALUES[name]
    hint = hint_of(value, argument)
    right = right_arguments(value)
    wrong = {"object": WRONG["object"]} if value in BEGINS else dict(WRONG)
    if argument in right:
        wrong["its class"] = type(right[argument])
    if is_function(hint):
        wrong = {kind: each for kind, each in wrong.items() if not callable(each)}
    said = {kind: refusal(value, right | {argument: each}) for kind, each in wrong.items()}
    assert {kind: text for kind, text in said.items() if text.startswith("raw")} == {}
    free = is_open(hint) or value in RECORDS or f"{name}.{argument}" in READ
    assert free or (said["object"] != "taken" and len(said["object"]) > 20)


def test_there_are_functions_and_classes_of_every_room_to_look_at():
    rooms = {name.partition(".")[0] for name in VALUES}
    assert len(rooms) == 17
    assert len(VALUES) > 150
    assert {posterior.ConfusionPosterior, domain.Query, planners.POMCP} <= set(VALUES.values())
