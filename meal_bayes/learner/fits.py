"""What agents make of one record, or of a percept table without an object (Alg. 1)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, Knowledge, knowledge_without
from meal_bayes.datasets import PerceptTable
from meal_bayes.errors import SettingsError
from meal_bayes.learner.experience import Experience
from meal_bayes.learner.fitted import Fitted, sampled
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.perception import Perceiver, RecordedPercepts
from meal_bayes.robots.recorded import replayable


@dataclass(eq=False)
class HeldOut:
    """Knowledge of one agent about one object, of which neither recordings nor labels enter it."""

    table: PerceptTable  # with labels that were told of objects that had none
    agent: Agent
    settings: LearnerSettings
    object_index: int  # of the object that is left out

    @cached_property
    def knowledge(self) -> Knowledge:
        """What is learned from all objects but this one."""
        known = knowledge_without(
            self.table, self.object_index, levels=self.agent.levels,
            object_level=self.agent.object_level,
        )  # fmt: skip
        posterior = self.settings.posterior
        return known if posterior is None else replace(known, posterior=posterior)

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,)."""
        counts = replayable(self.table)[self.object_index]
        return np.where(self.settings.percepts == "recorded", counts, np.inf)

    @cached_property
    def perceiver(self) -> Perceiver:
        """What shows percepts: classifiers that never saw the object, or the model itself."""
        if self.settings.percepts == "recorded":
            return RecordedPercepts(self.table, self.agent.levels)
        return sampled(self.knowledge, self.table.labels)


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
            labels = self.experience.labels_of(slice(None), memory=agent.memory)
            self.growth = [int((labels >= 0).sum()), 0]
        fit = Fitted.refit(self.experience, agent, self.settings)
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
        fit = HeldOut(labeled, agent, self.settings, o)
        self._held[o].append(fit)
        return fit

    def restore(self, fit: Fitted, growth: list[int]) -> None:
        """Restore what an agent made of the record."""
        fit.update(np.empty(0, np.intp))
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
