"""What is seen of one trial: the entities of a moment."""

from functools import lru_cache

import numpy as np
import rerun as rr

from meal_bayes.agents.trial import Trial
from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log.words import percept_words
from meal_bayes.viewer.graphs import Diagram, Graph, search_tree
from meal_bayes.viewer.moments import Moment
from meal_bayes.viewer.palette import DIM, GRAY, ORANGE, RED, Color, level_color, series_color
from meal_bayes.viewer.pictures import Matrices, Picture, belief_bars
from meal_bayes.viewer.recorder import Recorder, Time, part
from meal_bayes.viewer.words import action_word, log_line, plain, story, why

STORY, WHY, LOG = "/story", "/why", "/log"
BARS, BELIEF, ENTROPY, COST = "/belief_now", "/belief", "/entropy", "/cost"
VALUES, DIAGRAM, TREE, CONFUSION = "/expected_reward", "/diagram", "/search_tree", "/confusion"
LANES = "/lanes"
_REPORT = "report"
_PERCEPTS = 6  # lanes
_GAP = [float("nan")]


class Scene:
    """Puts moments into a recording; names and colors are fixed when they are first met."""

    def __init__(self, recorder: Recorder) -> None:
        self._to = recorder
        self._diagrams: dict[int, tuple[MOMDP, Diagram, Matrices]] = {}
        self._attributes: dict[str, int] = {}
        self._lanes: dict[str, dict[str, Color]] = {}
        self._actions: dict[tuple[str, ...], str] = {}  # entity by names of behaviors
        self._arrows: tuple[tuple[str, str], ...] | None = None  # of the diagram as it was sent
        self._begun = False

    @property
    def attributes(self) -> tuple[str, ...]:
        """Attributes that were asked so far."""
        return tuple(self._attributes)

    def add(self, moment: Moment) -> None:
        """Put one moment into the recording."""
        self._begin()
        to, time = self._to, Time.of(moment)
        to.add(STORY, rr.TextDocument, time, text=[story(moment)])
        to.add(WHY, rr.TextDocument, time, text=[why(moment)])
        to.add(LOG, rr.TextLog, time, text=[log_line(moment)], level=[_level(moment)])
        to.add(ENTROPY, rr.Scalars, time, scalars=[moment.entropy])
        to.add(COST, rr.Scalars, time, scalars=[moment.spent])
        for name, p in zip(
            moment.trial.task.query.attributes, moment.positive.tolist(), strict=True
        ):
            to.add(self._belief(name), rr.Scalars, time, scalars=[p])
        self._values(moment, time)
        self._picture(BARS, belief_bars(moment), time)
        _, diagram, matrices = self._of(moment.trial.momdp)
        drawn = diagram.at(moment)
        self._nodes(DIAGRAM, drawn, time)
        if drawn.edges != self._arrows:
            self._arrows = drawn.edges
            self._edges(DIAGRAM, drawn, time)
        tree = search_tree(moment)
        self._nodes(TREE, tree, time)
        self._edges(TREE, tree, time)
        self._confusion(moment, matrices, time)
        self._lane_changes(moment, time)

    def close(self, trial: Trial, time: Time) -> None:
        """End a trial in the row that is free behind it: lines break, lanes get their width."""
        for name in trial.task.query.attributes:
            self._to.add(self._belief(name), rr.Scalars, time, scalars=_GAP)
        for entity in (ENTROPY, COST):
            self._to.add(entity, rr.Scalars, time, scalars=_GAP)
        actions = trial.momdp.n_behaviors + 1
        self._value_row(trial.momdp, _GAP * actions, [0.0] * actions, time)
        for lane in ("action", "x", *self._percept_lanes(trial)):
            self._to.add(f"{LANES}/{lane}", rr.StateChange, time, state=[""])

    def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        for entity in (STORY, WHY):
            self._to.fix(entity, rr.TextDocument.from_fields(media_type="text/markdown"))
        for entity in (DIAGRAM, TREE):
            directed = rr.GraphEdges.from_fields(graph_type=rr.GraphType.Directed)
            self._to.fix(f"{entity}/nodes", directed)
        for entity in (BARS, CONFUSION):
            shown = rr.Points2D.from_fields(radii=0.01, show_labels=True)
            self._to.fix(f"{entity}/labels", shown)
        self._to.fix(ENTROPY, rr.SeriesLines(names="entropy, bits", colors=ORANGE, widths=2))
        self._to.fix(COST, rr.SeriesLines(names="cost so far, s", colors=RED, widths=2))

    def _of(self, momdp: MOMDP) -> tuple[MOMDP, Diagram, Matrices]:
        """Keep what is drawn of a MOMDP; it is held, so that its id stays its own."""
        found = self._diagrams.get(id(momdp))
        if found is None:
            if len(self._diagrams) > 256:  # noqa: PLR2004  as many as a log refers back to
                self._diagrams.clear()
            found = self._diagrams[id(momdp)] = (momdp, Diagram(momdp), Matrices(momdp))
        return found

    def _belief(self, name: str) -> str:
        entity = f"{BELIEF}/{part(name)}"
        if name not in self._attributes:
            color = series_color(len(self._attributes))
            self._attributes[name] = len(self._attributes)
            self._to.fix(entity, rr.SeriesLines(names=plain(name), colors=color, widths=2))
        return entity

    def _values(self, moment: Moment, time: Time) -> None:
        if moment.step is None:
            return
        decision = moment.step.decision
        variances = np.square(np.nan_to_num(decision.value_se))
        values = np.roll(decision.values, 1).tolist()  # the report first, where a legend begins
        self._value_row(moment.trial.momdp, values, np.roll(variances, 1).tolist(), time)

    def _value_row(
        self, momdp: MOMDP, values: list[float], variances: list[float], time: Time
    ) -> None:
        """Write one row of all actions' values; every set of behaviors has an entity."""
        names = momdp.behavior_names
        entity = self._actions.get(names)
        if entity is None:
            entity = self._actions[names] = f"{VALUES}/set_{len(self._actions)}"
            colors = [GRAY, *(series_color(action) for action in range(len(names)))]
            style = rr.Measurements.from_fields(
                names=[_REPORT, *map(plain, names)],
                colors=np.array(colors, np.uint32),
                widths=2,
                interpolation_mode="StepAfter",
            )
            self._to.fix(entity, style)
        self._to.add(entity, rr.Measurements, time, values=values, variances=variances)

    def _picture(self, entity: str, picture: Picture, time: Time) -> None:
        height, width = picture.pixels.shape[:2]
        self._to.add(
            f"{entity}/image",
            rr.Image,
            time,
            buffer=[picture.pixels.tobytes()],
            format=[_format(width, height)],
        )
        labels = picture.labels
        self._to.add(
            f"{entity}/labels",
            rr.Points2D,
            time,
            positions=[(label.x, label.y) for label in labels],
            labels=[label.text for label in labels],
            colors=[label.color for label in labels],
        )

    def _nodes(self, entity: str, graph: Graph, time: Time) -> None:
        nodes = graph.nodes
        self._to.add(
            f"{entity}/nodes",
            rr.GraphNodes,
            time,
            node_ids=[node.name for node in nodes],
            labels=[node.label for node in nodes],
            positions=[(node.x, node.y) for node in nodes],
            colors=[node.color for node in nodes],
        )

    def _edges(self, entity: str, graph: Graph, time: Time) -> None:
        self._to.add(f"{entity}/nodes", rr.GraphEdges, time, edges=list(graph.edges))

    def _confusion(self, moment: Moment, matrices: Matrices, time: Time) -> None:
        """Show the behavior just done; before the first, and at a report, the one before stays."""
        step, momdp = moment.step, moment.trial.momdp
        if step is not None and step.decision.action < momdp.n_behaviors:
            self._picture(CONFUSION, matrices.of(step.decision.action), time)
        elif step is None and moment.trial.steps:
            first = moment.trial.steps[0].decision.action
            self._picture(CONFUSION, matrices.of(first if first < momdp.n_behaviors else 0), time)

    def _lane_changes(self, moment: Moment, time: Time) -> None:
        trial, step, momdp = moment.trial, moment.step, moment.trial.momdp
        self._lane("x", momdp.x_names[moment.x], (DIM, GRAY)[moment.x % 2], time)
        if step is None:
            return
        action = step.decision.action
        color = GRAY if action >= momdp.n_behaviors else series_color(action)
        self._lane("action", action_word(momdp, action), color, time)
        words = None
        if step.observation is not None:
            words = percept_words(momdp, action, step.observation)
        for i, lane in enumerate(self._percept_lanes(trial)):
            if step.observation is None or words is None:
                self._to.add(f"{LANES}/{lane}", rr.StateChange, time, state=[""])
                continue
            level = int(step.observation[i])
            text = f"{plain(trial.task.query.attributes[i])}: {words[i]}"
            self._lane(lane, text, level_color(level, momdp.levels), time)

    def _lane(self, lane: str, state: str, color: Color, time: Time) -> None:
        entity, known = f"{LANES}/{lane}", self._lanes.setdefault(lane, {})
        if state not in known:
            known[state] = color
            colors = np.array(list(known.values()), np.uint32)
            style = rr.StateConfiguration(values=list(known), colors=colors)
            self._to.fix(entity, style)
        self._to.add(entity, rr.StateChange, time, state=[state])

    @staticmethod
    def _percept_lanes(trial: Trial) -> list[str]:
        return [f"percept_{i + 1}" for i in range(min(len(trial.truth), _PERCEPTS))]


@lru_cache(maxsize=64)
def _format(width: int, height: int) -> rr.components.ImageFormat:
    return rr.components.ImageFormat(
        width=width, height=height, color_model="RGBA", channel_datatype="U8"
    )


def _level(moment: Moment) -> str:
    warned = moment.step is not None and moment.step.warning
    if warned or (moment.last and (moment.trial.ended or moment.trial.success is False)):
        return "WARN"
    return "INFO"
