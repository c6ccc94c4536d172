"""The fits that a learner keeps: what each agent that asked makes of the record."""

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.datasets import PerceptTable
from meal_bayes.learner.experience import Experience, Objects
from meal_bayes.learner.held_out import HeldOut
from meal_bayes.learner.online import Online
from meal_bayes.learner.settings import LearnerSettings


class FitCache:
    """An `Online` of each agent in use, a `HeldOut` of each object of a table.

    The second are functions of table and labels. The first are state: made by `refit`, at an
    agent's first use, and by `update` where a refit is due; nothing that is only looked at makes
    one that would not be made then, as whatever changes the record uses the agent first.

    Agents are compared, not hashed: a solver or a bonus of one's own need not be hashable. There
    are few of them.
    """

    def __init__(self, record: Experience, settings: LearnerSettings) -> None:
        self.record = record
        self.settings = settings
        self.online: list[Online] = []
        self._held_out: list[HeldOut] = []

    def of(self, agent: Agent) -> Online:
        """Return what an agent makes of the record, made when it is first used."""
        for fit in self.online:
            if fit.agent == agent:
                return fit
        fit = Online.refit(self.record, agent, self.settings)
        self.online.append(fit)
        return fit

    def has(self, agent: Agent) -> bool:
        """Return whether an agent has made anything of the record."""
        return any(fit.agent == agent for fit in self.online)

    def held_out(self, table: PerceptTable, agent: Agent, o: int, beside: Objects = ()) -> HeldOut:
        """Return what an agent makes of the objects of a table but one, and those beside it."""
        for fit in self._held_out:
            if (fit.object_index, fit.beside) == (o, beside) and fit.agent == agent:
                return fit
        fit = HeldOut(self.record, agent, self.settings, table=table, object_index=o, beside=beside)
        self._held_out.append(fit)
        return fit

    def clear(self) -> None:
        """Forget what agents made of the record."""
        self.online = []
        self._held_out = []

    def update(self, rows: NDArray[np.intp], *, refit: bool, anew: bool = False) -> None:
        """Count instances (k,) with the labels that they have now; refit, if asked, where due.

        Where executions were taken back it is due, too: all is learned `anew`.
        """
        self._held_out = []
        for number, fit in enumerate(self.online):
            if anew or (refit and fit.due):
                self.online[number] = Online.refit(self.record, fit.agent, self.settings)
            else:
                fit.update(rows)
