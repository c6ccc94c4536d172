"""What agents make of one record, or of a percept table without an object (Alg. 1)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent
from meal_bayes.datasets import PerceptTable
from meal_bayes.errors import SettingsError
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fitted import Fitted, HeldOut
from meal_bayes.learner.settings import LearnerSettings


class Fits:
    """A `Fitted` of each agent that asked, or a `HeldOut` of each object, until all is made anew.

    That is when labeled instances have grown by a fraction, `refit_every`.
    """

    def __init__(
        self, experience: Experience, settings: LearnerSettings, refit_every: float | None
    ) -> None:
        if refit_every is not None and not refit_every > 0:
            raise SettingsError(f"refit_every is {refit_every}; give a number above 0, or None.")
        self.experience, self.settings, self.refit_every = experience, settings, refit_every
        self.table: PerceptTable | None = None  # that is replayed, in place of the record
        self.growth = [0, 0]  # labeled instances at the last refit, and since
        self._made: list[Fitted] = []
        self._held: dict[int, list[HeldOut]] = {}

    def of(self, agent: Agent) -> Fitted:
        """Return what an agent makes of the record, made when it is first needed."""
        for fit in self._made:
            if fit.agent == agent:
                return fit
        if not self._made:
            rows = np.arange(len(self.experience.instances))
            labels = self.experience.labels_of(rows, memory=agent.memory)
            self.growth = [int((labels >= 0).sum()), 0]
        fit = Fitted(self.experience, agent, self.settings)
        fit.refit()
        self._made.append(fit)
        return fit

    def held_out(self, agent: Agent, o: int) -> HeldOut:
        """Return what an agent makes of the objects of the table but one.

        A label that was told of an object without one is training data of the others.
        """
        table = self.table
        assert table is not None
        for fit in self._held.setdefault(o, []):
            if fit.agent == agent:
                return fit
        told = self.experience.labels_for(table.objects)
        labeled = replace(table, labels=np.where(table.labels < 0, told, table.labels))
        fit = HeldOut(labeled, agent, self.settings, o, told[o])
        self._held[o].append(fit)
        return fit

    def restore(self, agent: Agent, state: Mapping[str, Any], growth: list[int]) -> None:
        """Restore what an agent made of the record."""
        fit = Fitted(self.experience, agent, self.settings)
        fit.restore(state)
        self._made, self.growth = [fit], growth

    def clear(self) -> None:
        """Let everything be made anew when it is next needed."""
        self._made, self._held = [], {}

    def update(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) with the labels that they have now."""
        for fit in self._made:
            fit.update(rows)

    def withdraw(self, rows: NDArray[np.intp]) -> None:
        """Count instances (k,) of which labels were forgotten; refit where these were used."""
        if any(fit.used(rows) for fit in self._made):
            self.clear()
        self.update(rows)

    def grow(self, labeled: int) -> None:
        """Note what was labeled, and let everything be made anew where that is due."""
        self.growth[1] += labeled
        before, grown = self.growth
        if self.refit_every is not None and grown >= max(self.refit_every * before, 1):
            self.clear()
