"""A session takes one call at a time: what two threads do at once would be logged as one trial."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Self, TypeVar

from meal_bayes.errors import SettingsError


class _Entrance:
    """Lets one call in; a copy of what holds it, in this process or another, has its own."""

    def __init__(self) -> None:
        self._held = threading.Lock()

    @contextmanager
    def taken(self, name: str) -> Iterator[None]:
        """Let a call in for a block; `SettingsError`, by the call's name, while one is inside."""
        if not self._held.acquire(blocking=False):
            raise SettingsError(
                f"{name} came while another call of this session is under way, in another thread "
                "or in a callback; it takes one at a time. Call it when that one has returned; a "
                "callback ends the session by raising."
            )
        try:
            yield
        finally:
            self._held.release()

    def __reduce__(self) -> tuple[type["_Entrance"], tuple[()]]:
        return _Entrance, ()


class OneCaller(ABC):
    """A session: its methods that are `alone` refuse a call while another is inside.

    As a context manager it ends however its block is left.
    """

    def __init__(self) -> None:
        self._entrance = _Entrance()

    @abstractmethod
    def cancel(self, why: str = "cancelled") -> None:
        """End it without an answer; one that is over stays as it is."""

    @abstractmethod
    def _end_by(self, fault: BaseException) -> None:
        """End it by an exception, unless it is over."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, fault: BaseException | None, __: object) -> None:
        if fault is None:
            self.cancel("left before the answer")
            return
        with ExitStack() as inside:
            try:
                inside.enter_context(self._entrance.taken("The end of its block"))
            except SettingsError as busy:  # what has to be told is the fault
                fault.add_note(f"the session has not ended: {busy}")
            else:
                self._end_by(fault)


_Session = TypeVar("_Session", bound=OneCaller)
_Given = ParamSpec("_Given")
_Returned = TypeVar("_Returned")


def alone(
    method: Callable[Concatenate[_Session, _Given], _Returned],
) -> Callable[Concatenate[_Session, _Given], _Returned]:
    """Make a session's method refuse to be called while another of its methods is inside."""

    @wraps(method)
    def called(
        session: _Session, /, *arguments: _Given.args, **options: _Given.kwargs
    ) -> _Returned:
        with session._entrance.taken(f"{method.__name__}()"):
            return method(session, *arguments, **options)

    return called
