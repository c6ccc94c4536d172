"""What each agent that asked makes of the record, until all is made anew."""

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.datasets import PerceptTable
from meal_bayes.learner import views
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.held_out import HeldOut
from meal_bayes.learner.online import Online
from meal_bayes.learner.settings import LearnerSettings


class Fits:
    """An `Online` of each agent that asked, or a `HeldOut` of each object, until all is made anew.

    That is when labeled instances have grown by a fraction, `refit_every`.
    """

    def __init__(self, record: Experience, settings: LearnerSettings) -> None:
        self.record = record
        self.settings = settings
        self.growth = [0, 0]  # labeled instances at the last refit, and since
        self._online: list[Online] = []
        self._held_out: list[HeldOut] = []

    def of(self, agent: Agent) -> Online:
        """Return what an agent makes of the record, made when it is first needed."""
        for fit in self._online:
            if fit.agent == agent:
                return fit
        if not self._online:
            labels = views.labels_of(self.record, slice(None), memory=agent.memory)
            self.growth = [int((labels >= 0).sum()), 0]
        self._online.append(Online.refit(self.record, agent, self.settings))
        return self._online[-1]

    def held_out(self, table: PerceptTable, agent: Agent, o: int) -> HeldOut:
        """Return what an agent makes of the objects of a table but one."""
        for fit in self._held_out:
            if fit.object_index == o and fit.agent == agent:
                return fit
        self._held_out.append(HeldOut(self.record, agent, self.settings, table, o))
        return self._held_out[-1]

    def restore(self, fit: Online, growth: list[int]) -> None:
        """Restore what an agent made of the record."""
        fit.update(np.empty(0, np.intp))
        self._online = [fit]
        self.growth = growth

    def clear(self) -> None:
        """Let everything be made anew when it is next needed."""
        self._online = []
        self._held_out = []

    def update(self, rows: NDArray[np.intp], labeled: int = 0) -> None:
        """Count instances (k,) with the labels that they have now, some new; refit where due."""
        self._held_out = []
        for fit in self._online:
            fit.update(rows)
        self.growth[1] += labeled
        before, grown = self.growth
        refit_every = self.settings.refit_every
        if refit_every is not None and grown >= max(refit_every * before, 1):
            self.clear()

    def withdraw(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) of which labels were forgotten; refit where these were used."""
        if any(fit.used(rows).any() for fit in self._online):
            self.clear()
        self.update(rows)
