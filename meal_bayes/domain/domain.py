"""Domains: attributes, behaviors with costs, and the transition diagram.

`learn_success` and `learn_answers` estimate how often behaviors succeed, and how often people's
answers are right.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values, plain_fields, shaped_array
from meal_bayes.domain.diagram import TransitionDiagram
from meal_bayes.domain.event import Payoffs, wrong_reward
from meal_bayes.domain.words import JOINING_WORDS, doubled, fold, unknown
from meal_bayes.errors import DataError, DomainError, QueryError
from meal_bayes.look import facts_repr, listed
from meal_bayes.untrusted import LARGEST

PRIOR_OBJECTS = 1.0  # of each value, beside those that are labeled, in every base rate (Laplace)
_PRIOR_TRIES = 2.0  # executions, or answers, at the domain's own probability
LEGAL_BUDGET = 50.0, 80.0, 80.0  # s of Random Legal, by the number of attributes asked


@dataclass(frozen=True, slots=True)
class Behavior:
    """A behavior of the robot, which senses, asks a person, or only changes the state (`reinit`).

    Attributes
    ----------
    name : str
        Name of the behavior, as in the diagram.
    cost : float
        Cost of one execution, s.
    modalities : tuple[str, ...]
        Modalities that the behavior measures (Gamma(a) in Eq. 1).
    answer_accuracy : float | None
        Probability that a person's answer about an attribute is right, if the behavior asks a
        person; otherwise None.
    """

    name: str
    cost: float
    modalities: tuple[str, ...] = ()
    answer_accuracy: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)

    @property
    def senses(self) -> bool:
        """Whether a successful execution can give a percept."""
        return bool(self.modalities) or self.asks

    @property
    def asks(self) -> bool:
        """Whether the behavior asks a person."""
        return self.answer_accuracy is not None


@dataclass(frozen=True, slots=True)
class Domain:
    """What is known before any data: attributes, behaviors with costs, and state transitions.

    Attributes
    ----------
    name : str
        Name of the domain.
    attributes : tuple[str, ...]
        (P,) attributes about which a person can ask.
    behaviors : tuple[Behavior, ...]
        (E,) behaviors of the robot.
    diagram : TransitionDiagram
        Transitions of the behaviors.
    data : str
        Name of the data set whose recordings fit this domain; by default the name of the domain.
    groups : Mapping[str, tuple[str, ...]]
        Groups of mutually exclusive attributes, from the group's name to the names of its values.
        Every object has exactly one value of each group. If no value describes some objects, add a
        value such as "other". Values are kept in the order of `attributes`.
    synonyms : Mapping[str, str]
        The attribute that each synonym stands for.
    predefined : tuple[str, ...]
        Sequence of behaviors that the agents `predefined` and `predefined_plus` execute.
    report_reward : float
        Reward r+ of a right report in Eq. 4; a wrong report gets -r+.
    legal_budget : tuple[float, ...]
        Cost in seconds that the agent `random_legal` may spend on a question about one attribute,
        two attributes, and so on. The last entry also applies to longer questions.
    payoffs : Payoffs | None
        Payoffs of the answers yes and no; r+ and r- by default.
    asked_minimum : int
        Experiments only ask about attributes that are true for more than this many objects and
        false for more than this many.
    sources : Mapping[str, Mapping[str, Any]]
        Source of each modality in a recording: topic, fields, kind of feature and its settings; see
        `meal_bayes.features`.

    Raises
    ------
    DomainError
        Names are repeated, a cost is not a time, the reward is not finite, an effect names an
        unknown behavior, a behavior is legal in no state, or a synonym names an unknown attribute.

    Examples
    --------
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> [behavior.name for behavior in domain.behaviors]
    ['look', 'lift', 'reinit']
    """

    name: str
    attributes: tuple[str, ...]
    behaviors: tuple[Behavior, ...]
    diagram: TransitionDiagram
    data: str = ""
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    synonyms: Mapping[str, str] = field(default_factory=dict)
    predefined: tuple[str, ...] = ()
    report_reward: float = 500.0
    legal_budget: tuple[float, ...] = LEGAL_BUDGET
    asked_minimum: int = 0
    payoffs: Payoffs | None = None
    sources: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    __repr__ = facts_repr

    def _facts(self) -> tuple[str, dict[str, str]]:
        costs = [f"{behavior.name} {behavior.cost:g} s" for behavior in self.behaviors]
        right = self.report_reward
        return f"Domain {self.name}", {
            "attributes": f"{len(self.attributes)}: {listed(self.attributes)}",
            "behaviors": f"{len(costs)}: {listed(costs)}",
            "states": listed(self.diagram.states),
            "a report": f"{right:g} if right, {wrong_reward(right):g} if wrong",
        }

    def __post_init__(self) -> None:
        plain_fields(self)
        if not self.data:
            object.__setattr__(self, "data", self.name)
        if fault := next(self._faults(), None):
            raise DomainError(fault)
        # In the order of the attributes, so that another order of a group's values is no other
        # problem: a planner that samples would draw other numbers for it.
        ordered = {
            name: tuple(sorted(values, key=self.attributes.index))
            for name, values in self.groups.items()
        }
        object.__setattr__(self, "groups", ordered)

    def _faults(self) -> Iterator[str]:
        if not 0 < self.report_reward <= LARGEST:
            expected = f"a number above 0, at most {LARGEST:g}"
            yield f"report_reward is {self.report_reward}; give {expected}."
        if not self.legal_budget or not all(0 <= s < math.inf for s in self.legal_budget):
            yield f"legal_budget is {self.legal_budget}; give at least one finite time >= 0 s."
        for kind, names in (("attribute", self.attributes), ("behavior", self.behavior_names)):
            if not names:
                yield f"A domain needs at least one {kind}."
            yield from filter(None, [doubled(kind, names)])
        yield from filter(None, [doubled("state", self.diagram.states)])
        for behavior in self.behaviors:
            yield from filter(None, [doubled("modality", behavior.modalities)])
            name = behavior.name
            cost = behavior.cost
            accuracy = behavior.answer_accuracy
            if not 0 <= cost <= LARGEST:
                yield f"Behavior {name!r} costs {cost}; give its seconds, 0 to {LARGEST:g}."
            if accuracy is not None and not 0 < accuracy <= 1:
                yield f"Behavior {name!r} has answer_accuracy {accuracy}; expected one in (0, 1]."
        # Names that must be in two places: the list of behaviors and the diagram.
        used = {row.behavior for row in self.diagram.effects}
        behaviors = {*self.behavior_names}
        for name in sorted(used - behaviors):
            yield f"The diagram uses behavior {name!r}, which has no entry; add one with its cost."
        for name in sorted(behaviors - used):
            yield f"Behavior {name!r} is legal in no state; add an effect or remove it."
        if not any(behavior.senses for behavior in self.behaviors):
            yield "No behavior tells anything; give one its `modalities`, or `answer_accuracy`."
        for name in sorted({*self.predefined} - behaviors):
            yield f"The predefined sequence names {name!r}, which is no behavior."
        grouped = [name for members in self.groups.values() for name in members]
        for name in sorted({*self.synonyms.values(), *grouped} - {*self.attributes}):
            yield f"Groups or synonyms name {name!r}, which is no attribute."
        for name in sorted({*self.sources} - {name for _, name in self.contexts}):
            yield f"sources names {name!r}, which is no modality."
        for group, members in self.groups.items():
            if len(members) < 2 or any(grouped.count(name) > 1 for name in members):
                values = f"The group {group!r} is {list(members)}"
                yield f"{values}; give two or more attributes, each once and in no other group."
        # Questions are read whatever the case, so words must differ in more than that.
        words = [fold(word) for word in (*self.attributes, *self.synonyms)]
        for word in words:
            if word in JOINING_WORDS:
                yield f"The word {word!r} joins or denies attributes in a question; rename it."
            if words.count(word) > 1:
                yield f"The word {word!r} stands for two attributes (case plays no part); keep one."
        for name in self.attributes:
            if "," in name:
                yield f"The attribute {name!r} holds a comma, which parts attributes."

    @property
    def words(self) -> dict[str, str]:
        """The attribute for each name and synonym; the keys are normalized by `fold`."""
        words = (*zip(self.attributes, self.attributes, strict=True), *self.synonyms.items())
        return {fold(word): name for word, name in words}

    def group_of(self, attribute: str) -> tuple[str, ...]:
        """Return the values of the group of an attribute, or () if it has no group."""
        return next((names for names in self.groups.values() if attribute in names), ())

    def can_be(self, values: Mapping[str, bool]) -> bool:
        """Return whether the values are possible: an object has exactly one value of each group."""
        try:
            self.labels(values)
        except QueryError:
            return False
        return True

    def labels(self, values: Mapping[str, Any]) -> NDArray[np.int8]:
        """Return the labels (P,) of an object from names: 1 true, 0 false, -1 unknown.

        Parameters
        ----------
        values : Mapping[str, Any]
            For each attribute True or 1, False or 0, or None; for each group the name of its value.
            Attributes that are left out are unknown. For example
            ``{"metal": False, "fill": "half"}``.

        Raises
        ------
        QueryError
            A name or a value is not in the domain, or labels contradict each other.
        DataError
            A value is not a label, such as 0.5 or "yes".

        Examples
        --------
        >>> from meal_bayes.domain import load_domain
        >>> load_domain("roc36").labels({"weight": "heavy", "blue": True})[:6]
        array([0, 0, 1, 0, 0, 1], dtype=int8)
        """
        if not isinstance(values, Mapping):
            raise DataError(f"Labels are {values!r:.60}; give {{attribute: True, False or None}}.")
        # A value names an attribute, alone or as one of its group's.
        labels = np.full(len(self.attributes), -1, np.int8)
        for name, value in values.items():
            attribute, label = self._label(name, value)
            if label < 0:
                continue
            column = self.attribute_index(attribute)
            if labels[column] == 1 - label:
                raise QueryError(f"Labels say both {attribute!r} and not {attribute!r}; give one.")
            labels[column] = label
        return self.replace(np.full_like(labels, -1), labels)

    def _label(self, name: str, value: object) -> tuple[str, int]:
        """Return the attribute of a name and its value, and its label; -1 unknown."""
        members = self.groups.get(name, ())
        # Where a gap in a column of numbers made floats of them, they are their digits.
        whole = members and isinstance(value, float | np.floating) and float(value).is_integer()
        word = str(int(value) if whole else value).strip()  # type: ignore[call-overload]
        if word in members or (members and word and isinstance(value, str)):
            return self._value(name, word), 1
        if name in self.attributes:
            return name, label_of(name, value)
        if not members:
            names = (*self.attributes, *self.groups)
            raise QueryError(unknown("attribute", str(name), names))
        if label_of(name, value) >= 0:  # True or False, of a group
            raise QueryError(unknown(f"value of {name!r}", word, members))
        return name, -1

    def _value(self, group: str, word: str) -> str:
        """Return the attribute that a word means as the value of a group."""
        members = self.groups[group]
        name = word if word in members else self.words.get(fold(word), "")
        if name not in members:
            raise QueryError(unknown(f"value of {group!r}", word, members))
        return name

    def replace(self, row: NDArray[np.int8], new: NDArray[np.int8]) -> NDArray[np.int8]:
        """Combine earlier and new labels of an object; a new label replaces an earlier one.

        If one value of a group is true, its other values become false. If all values but one are
        false, this one becomes true.

        Parameters
        ----------
        row : NDArray[np.int8]
            (P,) labels so far: 1 true, 0 false, -1 unknown.
        new : NDArray[np.int8]
            (P,) new labels, coded as `row`.

        Returns
        -------
        labels : NDArray[np.int8]
            (P,) resulting labels. At most one value of each group is true.

        Raises
        ------
        QueryError
            More than one value of a group would be true, or all would be false.
        """
        after = np.where(new >= 0, new, row).astype(np.int8)
        for group, members in self.groups.items():
            columns = self.columns(members)
            told = one_value(new[columns], group, members)
            merged = told if 1 in told else np.where(told >= 0, told, row[columns])
            after[columns] = one_value(merged, group, members)
        return after

    @property
    def behavior_names(self) -> tuple[str, ...]:
        """Names of the behaviors, (E,)."""
        return tuple(behavior.name for behavior in self.behaviors)

    @property
    def contexts(self) -> list[tuple[str, str]]:
        """Each behavior with each of its modalities."""
        return [(behavior.name, m) for behavior in self.behaviors for m in behavior.modalities]

    @property
    def recorded(self) -> list[int]:
        """Positions of the behaviors that have modalities, and therefore recordings."""
        return [e for e, behavior in enumerate(self.behaviors) if behavior.modalities]

    @property
    def default_sequence(self) -> tuple[str, ...]:
        """The predefined sequence; if there is none, that of `TransitionDiagram.cheapest_first`.

        >>> from meal_bayes.domain import load_domain
        >>> load_domain("toy").default_sequence
        ('look', 'lift')
        """
        cost = {behavior.name: behavior.cost for behavior in self.behaviors}
        wanted = {behavior.name for behavior in self.behaviors if behavior.senses}
        return self.predefined or self.diagram.cheapest_first(cost, wanted)

    def behavior_index(self, name: str) -> int:
        """Return the position of a behavior; raise `DomainError` if it is not in the domain."""
        names = self.behavior_names
        if name not in names:
            raise DomainError(unknown("behavior", name, names))
        return names.index(name)

    def attribute_index(self, name: str) -> int:
        """Return the position of an attribute; raise `QueryError` if it is not in the domain."""
        return self._position(name)

    def _position(self, attribute: str) -> int:
        if attribute not in self.attributes:
            raise QueryError(unknown("attribute", attribute, self.attributes))
        return self.attributes.index(attribute)

    def columns(self, names: Iterable[str]) -> list[int]:
        """Return the positions of attributes; raise `QueryError` if one is not in the domain."""
        return [self._position(name) for name in names]


# Labels


def label_of(name: str, value: object) -> int:
    """Return one label as 1, 0 or -1; raise a `DataError` with its name if it is not a label."""
    try:
        label = label_values(value)
        return int(label)
    except TypeError:
        raise DataError(f"{name}: Found {value!r:.60}; expected one label.") from None
    except DataError as fault:
        raise DataError(f"{name}: {fault}") from None


def one_value(labels: NDArray[np.int8], group: str, members: Sequence[str]) -> NDArray[np.int8]:
    """Return the labels (K,) of a group's values, completed because exactly one value is true.

    Raises
    ------
    QueryError
        Two values are true, or none can be true.
    """
    true = np.flatnonzero(labels == 1)
    possible = np.flatnonzero(labels != 0)
    if len(true) > 1 or not len(possible):
        values = " and ".join(members[i] for i in true.tolist()) or "none"
        raise QueryError(f"{values} of {group!r} ({', '.join(members)}); exactly one is true")
    value = true if len(true) else possible
    if len(value) > 1:
        return labels
    return np.asarray(np.arange(len(members)) == value, np.int8)


# What is learned of a domain from what happened


def learn_success(domain: Domain, attempts: NDArray[np.float64]) -> Domain:
    """Return the domain in which behaviors succeed with their posterior mean probability.

    The prior counts as two executions that succeed with the domain's probability. If a behavior has
    several outcomes, the ratios of their probabilities do not change.

    Parameters
    ----------
    attempts : NDArray[np.float64]
        (E,2) weighted number of legal executions of each behavior that failed, and that succeeded.
    """
    attempts = shaped_array("attempts", attempts, len(domain.behaviors), 2)
    diagram = domain.diagram
    effects = []
    for effect in diagram.effects:
        failed, succeeded = attempts[domain.behavior_index(effect.behavior)]
        arrow = effect.source, effect.behavior
        stated = sum(e.probability for e in diagram.effects if (e.source, e.behavior) == arrow)
        learned = float((_PRIOR_TRIES * stated + succeeded) / (_PRIOR_TRIES + failed + succeeded))
        changed = replace(effect, probability=effect.probability * learned / stated)
        effects.append(effect if learned == stated else changed)
    return replace(domain, diagram=replace(diagram, effects=tuple(effects)))


def learn_answers(domain: Domain, answers: NDArray[np.float64]) -> Domain:
    """Return the domain in which each `answer_accuracy` is its posterior mean.

    The prior counts as two answers with the domain's `answer_accuracy`.

    Parameters
    ----------
    answers : NDArray[np.float64]
        (E,2) number of wrong and of right answers that each behavior got, according to the labels
        of the objects.

    Examples
    --------
    >>> from meal_bayes import load_domain
    >>> asked = np.zeros((10, 2))
    >>> asked[9] = 10, 30
    >>> learn_answers(load_domain("ispy32"), asked).behaviors[9].answer_accuracy
    0.7476190476190476
    """
    answers = shaped_array("answers", answers, len(domain.behaviors), 2)
    behaviors = []
    for behavior, (wrong, right) in zip(domain.behaviors, answers.tolist(), strict=True):
        stated = behavior.answer_accuracy
        if stated is not None and wrong + right:
            learned = (_PRIOR_TRIES * stated + right) / (_PRIOR_TRIES + wrong + right)
            behavior = replace(behavior, answer_accuracy=learned)  # noqa: PLW2901
        behaviors.append(behavior)
    return replace(domain, behaviors=tuple(behaviors))
