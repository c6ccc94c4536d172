"""A search in messages: what is searched for, each turn, the answer; trials are in logs of theirs.

The start of each object's trial stands with it, so that those that were never explored are known.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from meal_bayes.errors import LogCorruptError
from meal_bayes.trial_log import schema
from meal_bayes.trials import Search, Trial
from meal_bayes.untrusted import name_fault


def pack_search(search: Search) -> bytes:
    """Pack what is searched for, among which objects."""
    message = schema.SearchMessage(
        question=search.question,
        objects=list(search.trials),
        none=search.none,
        turn_cost=search.turn_cost,
    )
    data: bytes = message.SerializeToString()
    return data


def pack_turn(number: int, name: str, state: str) -> bytes:
    """Pack a turn, by its number, to an object in a state."""
    data: bytes = schema.TurnMessage(turn=number, object_name=name, state=state).SerializeToString()
    return data


def pack_claim(search: Search) -> bytes:
    """Pack the answer, and what all of it cost."""
    data: bytes = schema.ClaimMessage(
        object_name=search.claim or "", cost=search.cost, ended=search.ended
    ).SerializeToString()
    return data


@dataclass
class SearchRecord:
    """What a log of a search holds, message by message.

    Attributes
    ----------
    starts : list[Trial]
        Of each object, without steps.
    turns : list[tuple[str, str]]
        Object and state.
    """

    starts: list[Trial] = field(default_factory=list)
    turns: list[tuple[str, str]] = field(default_factory=list)
    _asked: Any = None
    _claim: Any = None

    def add(self, topic: str, data: bytes) -> None:
        """Add the next message; one that does not fit those before is refused."""
        if (topic == schema.SEARCH) != (self._asked is None) or self._claim is not None:
            raise LogCorruptError(f"a message of {topic} is not in its place")
        if topic == schema.SEARCH:
            self._asked = schema.SearchMessage.FromString(data)
            names = list(self._asked.objects)
            if not 0 < len(set(names)) == len(names) <= schema.MOST_OBJECTS:
                raise LogCorruptError(f"a search among {len(names)} objects, or one twice")
            if any(map(name_fault, names)):
                raise LogCorruptError("a search among objects without a name")
            return
        if len(self.starts) != len(self._asked.objects):
            raise LogCorruptError(f"a search with {len(self.starts)} starts of trials")
        message = _MESSAGES[topic].FromString(data)
        name = message.object_name
        if name not in self._asked.objects and (name or topic == schema.TURN):
            raise LogCorruptError(f"a search turns to {name[:40]!r}, which is none of its objects")
        if topic == schema.CLAIM:
            self._claim = message
            return
        states = self.starts[0].momdp.x_names[:-1]
        if message.turn != len(self.turns) or message.state not in states:
            raise LogCorruptError(f"turn {message.turn} is not in order, or in no state")
        self.turns.append((name, message.state))

    def start(self, trial: Trial) -> None:
        """Add the start of the next object's trial."""
        if self._asked is None or len(self.starts) == len(self._asked.objects) or self.turns:
            raise LogCorruptError("the start of a trial is not in its place")
        self.starts.append(trial)

    @property
    def answered(self) -> bool:
        """Whether the answer is there."""
        return self._claim is not None

    @property
    def explored(self) -> Sequence[str]:
        """Objects that have a log, in its order: those turned to, and one claimed from afar."""
        names = [name for name, _ in self.turns]
        if self._claim is not None and self._claim.object_name:
            names.append(self._claim.object_name)
        return list(dict.fromkeys(names))

    def search(self, explored: Mapping[str, Trial], ended: str) -> Search:
        """Return the search with the trials of explored objects; `ended` holds without an answer.

        Raises
        ------
        LogCorruptError
            Trials of another search, or not all of it.
        """
        if self._asked is None or len(self.starts) != len(self._asked.objects):
            raise LogCorruptError("it ends before all objects of the search are named")
        trials = dict(zip(self._asked.objects, self.starts, strict=True))
        for name, trial in explored.items():
            if trial.task != trials[name].task:
                raise LogCorruptError(f"the trial of {name!r} beside it is of another search")
            trials[name] = trial
        claim = self._claim
        search = Search(
            question=self._asked.question,
            trials=trials,
            turns=tuple(name for name, _ in self.turns),
            claim=None if claim is None else claim.object_name or None,
            none=self._asked.none,
            turn_cost=self._asked.turn_cost,
            ended=ended if claim is None else claim.ended,
            states=tuple(state for _, state in self.turns),
        )
        if claim is not None and not math.isclose(search.cost, claim.cost, abs_tol=1e-9):
            raise LogCorruptError(
                f"the trials beside it cost {search.cost:g} s, those of the search {claim.cost:g} s"
            )
        return search


_MESSAGES: dict[str, Any] = {schema.TURN: schema.TurnMessage, schema.CLAIM: schema.ClaimMessage}
