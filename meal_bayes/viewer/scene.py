"""The entities of one trial: texts, plots, graphs and pictures of each frame; the robot in space.

Of the robot there are boxes, balls, contact forces, and what its camera sees.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from meal_bayes.look import (
    DIM_GRAY,
    MID_GRAY,
    ORANGE,
    SKY,
    VERMILION,
    attribute_color,
    level_color,
    rgba,
)
from meal_bayes.robots.robot import Frame
from meal_bayes.trials import Trial, percept_labels
from meal_bayes.trials.text import YES
from meal_bayes.viewer.drawings import (
    Diagram,
    Graph,
    Label,
    Picture,
    matrices,
    search_tree,
)
from meal_bayes.viewer.labels import explain_decision, narrate, plain_text
from meal_bayes.viewer.recorder import Recorder, Time, TrialFrame

NARRATION = "/narration"
DECISION = "/decision"
BELIEF = "/belief"
ENTROPY = "/entropy"
COST = "/cost"
LINES = {ENTROPY: "entropy, bits", COST: "cost so far, s"}  # titles of the small plots
VALUES = "/expected_reward"
DIAGRAM = "/diagram"
TREE = "/search_tree"
CONFUSION = "/confusion"
LANES = "/lanes"
_OWN_LANES = ("action", "state")  # beside those of percepts
ROBOT = "/robot"
CAMERA = "/camera"
_PERCEPTS = 6  # lanes
_GAP = [float("nan")]
_BOXES = {Frame.SOLID: f"{ROBOT}/arm", Frame.SHELL: f"{ROBOT}/object"}
_BALLS = f"{ROBOT}/content"
_ARROWS = f"{ROBOT}/forces"
_METERS_PER_NEWTON = 0.008  # how long a force is drawn
_LINE = 0.0008  # m
_RED = (235, 60, 40)


class Scene:
    """The rows of all trials; names and colors of an entity are sent when it first occurs."""

    def __init__(self, recorder: Recorder) -> None:
        self._to = recorder
        self._diagram: Diagram | None = None  # of the trial under way
        self._matrices: dict[int, Picture] = {}  # by behavior, without samples
        self.attributes: list[str] = []  # that were queried
        self._lanes: dict[str, dict[str, str]] = {}
        self._explores = False  # has any decision been paid for exploring?
        for entity in (NARRATION, DECISION):
            recorder.add_static(entity, rr.TextDocument.from_fields(media_type="text/markdown"))
        for entity in (DIAGRAM, TREE):
            directed = rr.GraphEdges.from_fields(graph_type=rr.GraphType.Directed)
            recorder.add_static(f"{entity}/nodes", directed)
        points = rr.Points2D.from_fields(radii=0.01, show_labels=True)
        recorder.add_static(f"{CONFUSION}/labels", points)
        worth = rr.Measurements.from_fields(
            names="going on",
            colors=rgba(SKY),
            widths=3,
            interpolation_mode="StepAfter",
        )
        recorder.add_static(f"{VALUES}/worth", worth)
        recorder.add_line(f"{VALUES}/zero", "answering now", MID_GRAY)
        recorder.add_line(ENTROPY, LINES[ENTROPY], ORANGE)
        recorder.add_line(COST, LINES[COST], VERMILION)

    def add(self, frame: TrialFrame) -> None:
        """Add one frame."""
        to = self._to
        time = frame.time
        to.add(NARRATION, rr.TextDocument, time, text=[narrate(frame)])
        to.add(DECISION, rr.TextDocument, time, text=[explain_decision(frame)])
        to.add(ENTROPY, rr.Scalars, time, scalars=[frame.belief.entropy])
        to.add(COST, rr.Scalars, time, scalars=[frame.spent])
        names = frame.trial.task.query.value_names
        for name, p in zip(names, frame.belief.positive.tolist(), strict=True):
            to.add(self._belief(name), rr.Scalars, time, scalars=[p])
        event = frame.trial.momdp.reports.probability_now(frame.belief)
        if event is not None:
            to.add(self._belief(YES), rr.Scalars, time, scalars=[event])
        if frame.step is not None:
            worth = frame.step.decision.going_on()
            fields = {"values": [worth.value], "variances": [worth.variance]}
            to.add(f"{VALUES}/worth", rr.Measurements, time, **fields)
            # The line of later gains begins where an agent first explores; others have none.
            if frame.step.decision.explores:
                if not self._explores:
                    to.add_line(f"{VALUES}/later", "with gain of later questions", ORANGE)
                    self._explores = True
                to.add(f"{VALUES}/later", rr.Scalars, time, scalars=[worth.value + worth.bonus])
            to.add(f"{VALUES}/zero", rr.Scalars, time, scalars=[0.0])
        # Trials in a row often share a problem, whose diagram and matrices are drawn once.
        momdp = frame.trial.momdp
        if self._diagram is None or self._diagram.momdp is not momdp:
            self._diagram = Diagram(momdp)
            self._matrices = {}
        self._graph(DIAGRAM, self._diagram.at(frame), time)
        self._graph(TREE, search_tree(frame), time)
        self._confusion(frame, time)
        self._lane_changes(frame, time)

    def close(self, trial: Trial, time: Time) -> None:
        """End a trial in the free row behind it, where lines break and lanes end."""
        names = trial.task.query.value_names
        if trial.task.query.event is not None:
            names = (*names, YES)
        for entity in (*map(self._belief, names), ENTROPY, COST):
            self._to.add(entity, rr.Scalars, time, scalars=_GAP)
        self._to.add(f"{VALUES}/worth", rr.Measurements, time, values=_GAP, variances=[0.0])
        if self._explores:
            self._to.add(f"{VALUES}/later", rr.Scalars, time, scalars=_GAP)
        for lane in (*_OWN_LANES, *self._percept_lanes(trial)):
            self._lane(lane, time)

    def _belief(self, name: str) -> str:
        entity = f"{BELIEF}/{rr.escape_entity_path_part(name)}"
        if name not in self.attributes:
            self._to.add_line(entity, plain_text(name), attribute_color(len(self.attributes)))
            self.attributes.append(name)
        return entity

    def _picture(self, entity: str, picture: Picture, time: Time) -> None:
        self._to.add_image(f"{entity}/image", picture.pixels, time)
        self._labels(f"{entity}/labels", rr.Points2D, picture.labels, time)

    def _graph(self, entity: str, graph: Graph, time: Time) -> None:
        self._labels(f"{entity}/nodes", rr.GraphNodes, graph.nodes, time)
        self._to.add(f"{entity}/nodes", rr.GraphEdges, time, edges=list(graph.edges))

    def _labels(self, entity: str, archetype: type, labels: Sequence[Label], time: Time) -> None:
        texts, colors, x, y, names = map(list, zip(*labels, strict=True))
        fields = {"positions": list(zip(x, y, strict=True)), "labels": texts}
        fields["colors"] = list(map(rgba, colors))
        if archetype is rr.GraphNodes:
            fields["node_ids"] = names
        self._to.add(entity, archetype, time, **fields)

    def _confusion(self, frame: TrialFrame, time: Time) -> None:
        """Add the matrices of the behavior; at a report, those of the one before stay."""
        trial = frame.trial
        step = frame.step
        end = frame.trial.momdp.n_behaviors
        action = 0
        sampled = None
        if step is not None:
            action = step.decision.action
            sampled = step.decision.sampled_rows
        elif trial.steps and trial.steps[0].decision.action < end:
            action = trial.steps[0].decision.action
        if action < end:
            picture = None if sampled is not None else self._matrices.get(action)
            if picture is None:
                picture = matrices(trial.momdp, trial.counts, action, sampled)
            if sampled is None:
                self._matrices[action] = picture
            self._picture(CONFUSION, picture, time)

    def _lane_changes(self, frame: TrialFrame, time: Time) -> None:
        trial = frame.trial
        step = frame.step
        momdp = frame.trial.momdp
        x = frame.belief.x
        state = "end" if x == momdp.terminal else momdp.state_label(x)  # as in the diagram
        self._lane("state", time, state, (DIM_GRAY, MID_GRAY)[x % 2])
        if step is None:
            return
        action = step.decision.action
        percept = step.observation
        label = plain_text(trial.momdp.action_label(action))
        self._lane("action", time, label, (MID_GRAY, DIM_GRAY)[frame.number % 2])
        names = [] if percept is None else percept_labels(momdp, action, percept)
        for i, lane in enumerate(self._percept_lanes(trial)):
            if percept is None:
                self._lane(lane, time)
            else:
                _, indices = trial.task.query.questions[i]
                text = plain_text(names[i])
                level = max(int(percept[index]) for index in indices)
                self._lane(lane, time, text, level_color(level, momdp.levels))

    def _lane(self, lane: str, time: Time, state: str = "", color: str = MID_GRAY) -> None:
        """Begin a state of a lane; without one, end the last."""
        entity = f"{LANES}/{rr.escape_entity_path_part(lane)}"
        states = self._lanes.setdefault(lane, {})
        if state and state not in states:
            states[state] = color
            colors = np.array(list(map(rgba, states.values())), np.uint8)
            style = rr.StateConfiguration(values=list(states), colors=colors)
            self._to.add_static(entity, style)
        self._to.add(entity, rr.StateChange, time, state=[state])

    @staticmethod
    def _percept_lanes(trial: Trial) -> list[str]:
        """Return the lanes of percepts, each named by what is asked."""
        names = (name for name, _ in trial.task.query.questions[:_PERCEPTS])
        return [f"{name}_" if name in _OWN_LANES else name for name in names]


def add_robot(to: Recorder, trial: Trial, frames: Sequence[Frame], start: Time) -> None:
    """Add a robot's frames in the rows of their steps, each of which takes the s that it costs."""
    _add_static(to, frames[0])
    ends = np.cumsum([step.cost for step in trial.steps])
    for frame in frames:
        # A frame belongs to the step during which it was taken; the first, at 0 s, to none yet.
        row = int(np.searchsorted(ends, frame.seconds - 1e-6)) + (frame.seconds > 0)
        step_of_row = start.step + min(row, len(ends))
        time = Time(start.trial, step_of_row, start.sim_time + frame.seconds)
        for shape, entity in _BOXES.items():
            mask = frame.shapes == shape
            centers = frame.centers[mask].tolist()
            quaternions = frame.quaternions[mask].tolist()
            to.add(entity, rr.Boxes3D, time, centers=centers, quaternions=quaternions)
        balls = frame.shapes == Frame.BALL
        if balls.any():
            to.add(_BALLS, rr.Points3D, time, positions=frame.centers[balls].tolist())
        vectors = (_METERS_PER_NEWTON * frame.forces).tolist()
        to.add(_ARROWS, rr.Arrows3D, time, origins=frame.contacts.tolist(), vectors=vectors)
        to.add_image(CAMERA, (255 * frame.picture).astype(np.uint8), time)


def _add_static(to: Recorder, frame: Frame) -> None:
    """Add what does not change: sizes, colors and units."""
    colors = (255 * frame.colors).astype(np.uint8)
    for shape, entity in _BOXES.items():
        mask = frame.shapes == shape
        boxes = rr.Boxes3D.from_fields(
            half_sizes=frame.half_sizes[mask],
            colors=colors[mask],
            fill_mode="solid" if shape == Frame.SOLID else "majorwireframe",
            radii=_LINE,
        )
        to.add_static(entity, boxes)
    balls = frame.shapes == Frame.BALL
    if balls.any():
        points = rr.Points3D.from_fields(radii=frame.half_sizes[balls, 0], colors=colors[balls])
        to.add_static(_BALLS, points)
    to.add_static(_ARROWS, rr.Arrows3D.from_fields(colors=_RED, radii=2 * _LINE))
    to.add_static(ROBOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
