"""What agents make of one record, and when it is made anew."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.errors import SettingsError
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fitted import Fitted, LearnerSettings


class Fits:
    """A `Fitted` of each agent that asked, until all are made anew.

    Parameters
    ----------
    experience : Experience
        The record.
    settings : LearnerSettings
        Of the learner.
    refit_every : int or float, optional
        Labels, or (below 1) a fraction by which labeled instances grow; None: never.

    Attributes
    ----------
    growth : list of int
        Labeled instances at the last refit; since; and labels since.
    """

    def __init__(
        self, experience: Experience, settings: LearnerSettings, refit_every: float | None
    ) -> None:
        if refit_every is not None and not refit_every > 0:
            raise SettingsError(f"refit_every is {refit_every}; give a number above 0, or None.")
        self.experience, self.settings, self.refit_every = experience, settings, refit_every
        self.growth = [0, 0, 0]
        self._made: list[tuple[Agent, Fitted]] = []

    def of(self, agent: Agent) -> Fitted:
        """Return what an agent makes of the record, made when it is first needed."""
        for other, fit in self._made:
            if other == agent:
                return fit
        if not self._made:
            rows = np.arange(len(self.experience.instances))
            labels = self.experience.labels_of(rows, memory=agent.memory)
            self.growth = [int((labels >= 0).sum()), 0, 0]
        fit = Fitted(self.experience, agent, self.settings)
        fit.refit()
        self._made.append((agent, fit))
        return fit

    def restore(self, agent: Agent, state: Mapping[str, Any], growth: list[int]) -> None:
        """Restore what an agent made of the record."""
        fit = Fitted(self.experience, agent, self.settings)
        fit.restore(state)
        self._made, self.growth = [(agent, fit)], growth

    def clear(self) -> None:
        """Let everything be made anew when it is next needed."""
        self._made = []

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now."""
        for _, fit in self._made:
            fit.update(rows)

    def withdraw(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) of which labels were forgotten; refit where these were used."""
        if any(fit.used(rows) for _, fit in self._made):
            self.clear()
        self.update(rows)

    def grow(self, instances: int, labels: int) -> None:
        """Note what was labeled, and let everything be made anew where that is due."""
        self.growth[1] += instances * labels
        self.growth[2] += labels
        before, grown, told = self.growth
        if self.refit_every is None:
            return
        fraction = self.refit_every < 1
        if told >= self.refit_every if not fraction else grown >= max(self.refit_every * before, 1):
            self.clear()
