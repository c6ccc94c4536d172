"""Public methods refuse arguments of another kind before they do anything, as functions do."""

import collections.abc
import importlib
import inspect
import pkgutil
import types
import typing
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import meal_bayes
from meal_bayes import momdp, planners, robots, trials
from meal_bayes.errors import SettingsError

# What is made at every step, or by a driver: whoever takes it looks at it.
RECORDS = {
    momdp.Belief, momdp.Reports, momdp.Transition, planners.Decision, planners.GoingOn,
    planners.Hand, planners.History, planners.Move, planners.TreeEdge, robots.Outcome, trials.Step,
}  # fmt: skip
# Read by the methods themselves, which take more than they name, or say more of what is wrong.
READ = {
    "Payoffs.of": {"values"}, "Dataset.from_frames": {"features"},
    "Dataset.instance": {"object_index", "behavior", "recording"},
    "TrainingSet.everything": {"objects"},
    "MealEnv.reset": {"options"}, "MealEnv.step": {"action"},
    "Session.start": {"state"}, "Session.observe": {"outcome"}, "Session.command": {"decision"},
    "SearchSession.turned": {"state"}, "SearchSession.observe": {"outcome"},
    "ExperiencedAgent.task": {"question"}, "ExperiencedAgent.problem": {"question"},
    "ExperiencedAgent.policy": {"question"}, "ExperiencedAgent.replay": {"question"},
    "Answerer.ask": {"robot", "question"}, "Answerer.begin": {"state", "question"},
    "Answerer.resume": {"state"},
    "Learner.tell": {"values"}, "Finder.find": {"question", "robot", "objects"},
    "Finder.begin_find": {"question", "objects", "payoffs", "none", "truth"},
}  # fmt: skip


def public_classes():
    """Return the public classes of all rooms, by name."""
    classes = {}
    for room in pkgutil.iter_modules(meal_bayes.__path__):
        if not room.ispkg or room.name == "cli":
            continue
        module = importlib.import_module(f"meal_bayes.{room.name}")
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            if inspect.isclass(value):
                classes[f"{room.name}.{name}"] = value
    return classes


def methods():
    """Yield the public methods with arguments of public classes, each once, and their classes."""
    seen = set()
    for cls in public_classes().values():
        error = issubclass(cls, Exception)
        if error or cls in RECORDS or getattr(cls, "_is_protocol", False):
            continue
        for owner in cls.__mro__:
            for name, member in vars(owner).items():
                function = getattr(member, "__func__", member)
                ours = owner.__module__.startswith("meal_bayes") and inspect.isfunction(function)
                if name.startswith("_") or not ours or function in seen:
                    continue
                seen.add(function)
                if arguments_of(function, member):
                    yield f"{owner.__name__}.{name}", function, member


def arguments_of(function, member):
    """Return the parameters of a method that can be given one value each, by name."""
    parameters = list(inspect.signature(function).parameters.values())
    bound = not isinstance(member, staticmethod)
    several = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return {each.name: each for each in parameters[bound:] if each.kind not in several}


def hints_of(function, arguments):
    """Return what arguments are annotated with; the result's class may not be loaded."""
    inner = inspect.unwrap(function)
    named = types.SimpleNamespace(
        __annotations__={name: inner.__annotations__.get(name, object) for name in arguments}
    )
    return typing.get_type_hints(named, inner.__globals__)


SAMPLES = {
    bool: True, int: 0, float: 1.0, str: "a", type(None): None, Path: Path("a"),
    np.ndarray: np.zeros(2), collections.abc.Callable: print, Exception: Exception(),
    np.random.Generator: np.random.default_rng(0), bytes: b"", tuple: (),
    NDArray: np.zeros(2),  # is its own origin from numpy 2.5 on
}  # fmt: skip


def sample(hint):
    """Return a value of the kind that an annotation names; of a class an empty shell."""
    origin = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return sample(parts[0])
    if origin is tuple and parts and parts[-1] is not Ellipsis:
        return tuple(map(sample, parts))
    if is_open(hint) or getattr(origin, "_is_protocol", False):
        return Mock()
    if origin in SAMPLES:
        return SAMPLES[origin]
    empty = next((each for each in ({}, [], set(), iter(())) if isinstance(each, origin)), None)
    shell = tuple if issubclass(origin, tuple) else object
    return shell.__new__(origin) if empty is None else empty


def is_open(hint):
    """Return whether anything may be given, of which the method itself makes what it can."""
    parts = typing.get_args(hint)
    array_like = typing.get_args(ArrayLike) or (ArrayLike,)
    return hint in (object, typing.Any, ArrayLike) or all(each in parts for each in array_like)


METHODS = {name: (function, member) for name, function, member in methods()}
ARGUMENTS = [
    (name, argument)
    for name, (function, member) in METHODS.items()
    for argument, hint in hints_of(function, arguments_of(function, member)).items()
    if not is_open(hint) and argument not in READ.get(name, ())
]


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS, ids=map(".".join, ARGUMENTS))
def test_an_argument_of_another_kind_is_refused_before_anything_is_done(name, argument):
    """There is not even an instance whose method this could be."""
    function, member = METHODS[name]
    arguments = arguments_of(function, member)
    hints = hints_of(function, arguments)
    hint = hints[argument]
    given = {each: sample(other) for each, other in hints.items()}
    owner = () if isinstance(member, staticmethod) else (None,)
    is_function = collections.abc.Callable in map(typing.get_origin, (hint, *typing.get_args(hint)))
    for wrong in [object()] if is_function else [object(), dict]:
        with pytest.raises(SettingsError) as caught:
            function(*owner, **(given | {argument: wrong}))
        assert str(caught.value).startswith(f"{name}(): {argument} is ")
        assert "; give " in str(caught.value)


def test_a_method_is_told_by_the_class_that_it_was_called_of():
    class Own(meal_bayes.Learner):
        pass

    for cls in (meal_bayes.Learner, Own):
        learner = cls("toy", logs=None)
        for call in (learner.knowledge, cls.load):
            with pytest.raises(SettingsError, match=rf"^{cls.__name__}\.{call.__name__}\(\): "):
                call(7)


def test_there_are_methods_of_many_classes_to_look_at():
    assert len({name.partition(".")[0] for name in METHODS}) > 30
    assert {"Learner.tell", "Session.repeat", "Domain.columns", "Experience.forget"} <= {*METHODS}
    assert len(ARGUMENTS) > 150
    assert all(READ[name] <= {*arguments_of(*METHODS[name])} for name in READ)
