"""The layout: a tab for the trial at the time cursor, for its confusion matrices, for the run."""

import rerun as rr
import rerun.blueprint as rrb

from meal_bayes.look import ERROR_TEXT
from meal_bayes.viewer import run_view, scene
from meal_bayes.viewer.drawings import MATRICES

_CROWD = 4  # attributes, of more a legend would hide its plot
_AROUND = 8  # rows shown before and behind the cursor
_LANES = "action, state, percepts"
_NO_LEGEND = rrb.PlotLegend(visible=False)


def blueprint(*, single: bool, attributes: int, live: bool, robot: bool) -> rrb.Blueprint:
    """Return the layout of a recording.

    Plots show all of a `single` trial, else the rows around the cursor. The trials have a tab of
    their own if beliefs in `attributes` are shown, with the `robot` in its own time, and a legend
    unless these are many; `live`, the newest row is followed.
    """
    crowded = attributes > _CROWD
    trial = list[rrb.Container | rrb.View]()
    if attributes:
        trial = [_trial(single=single, crowded=crowded, robot=robot), _matrices()]
    return rrb.Blueprint(
        rrb.Tabs(*trial, _run(), active_tab=0),
        rrb.TopPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="sim_time" if robot else "step",
            play_state="following" if live else "paused",
        ),
        auto_layout=False,
        auto_views=False,
    )


def _trial(*, single: bool, crowded: bool, robot: bool) -> rrb.Horizontal:
    over = None
    if not single:  # the rows around the cursor
        start, end = (rr.TimeRangeBoundary.cursor_relative(seq=n) for n in (-_AROUND, _AROUND))
        over = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
    text = rrb.Vertical(
        rrb.TextDocumentView(origin=scene.NARRATION, name="question and answer"),
        rrb.TextDocumentView(origin=scene.DECISION, name="why this action"),
        row_shares=[3, 2],
    )
    belief = rrb.TimeSeriesView(
        origin=scene.BELIEF,
        name="belief over steps",
        axis_x=over,
        axis_y=rrb.ScalarAxis(range=(-0.02, 1.02), zoom_lock=False),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=not crowded),
    )
    values = rrb.TimeSeriesView(
        origin=scene.VALUES,
        name="value of going on less answering now",
        axis_x=over,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftBottom),  # a trial begins above, on the left
        interaction=rrb.PlotInteraction(points_display="Always"),
    )
    small = rrb.Vertical(
        *(
            rrb.TimeSeriesView(origin=entity, name=name, axis_x=over, plot_legend=_NO_LEGEND)
            for entity, name in scene.LINES.items()
        )
    )
    upper = rrb.Horizontal(belief, values, small, column_shares=[3, 4, 2])
    graphs = rrb.Horizontal(
        rrb.GraphView(origin=scene.DIAGRAM, name="where the robot is, what it just did"),
        rrb.GraphView(origin=scene.TREE, name="search tree: action, percepts → next action"),
    )
    lanes = rrb.StateTimelineView(origin=scene.LANES, name=_LANES, time_view=over)
    of_trial = rrb.Vertical(upper, graphs, lanes, row_shares=[4, 3, 3])
    if robot:
        return rrb.Horizontal(text, _robot(), of_trial, column_shares=[3, 3, 6], name="the trial")
    return rrb.Horizontal(text, of_trial, column_shares=[3, 7], name="the trial")


def _matrices() -> rrb.Spatial2DView:
    left, top, right, bottom = MATRICES
    bounds = rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom])
    return rrb.Spatial2DView(
        origin=scene.CONFUSION, name="what this behavior tells", visual_bounds=bounds
    )


def _robot() -> rrb.Vertical:
    eye = rrb.EyeControls3D(position=(0.30, -0.42, 0.30), look_target=(0.0, 0.0, 0.10))
    return rrb.Vertical(
        rrb.Spatial3DView(
            origin=scene.ROBOT,
            name="the robot (red: contact forces)",
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=eye,
        ),
        rrb.Spatial2DView(origin=scene.CAMERA, name="the robot's camera"),
        row_shares=[3, 1],
    )


def _run() -> rrb.Vertical:
    accuracy = rrb.TimeSeriesView(
        origin=run_view.ACCURACY,
        name=f"accuracy so far, band {ERROR_TEXT}",
        axis_y=rrb.ScalarAxis(range=(0.0, 1.02)),
    )
    cost = rrb.TimeSeriesView(origin=run_view.COST, name=f"mean cost so far, s, band {ERROR_TEXT}")
    texts = rrb.Horizontal(
        rrb.TextDocumentView(origin=run_view.TABLE, name="agents and worst trials"),
        rrb.TextDocumentView(origin=run_view.FACTS, name="run facts"),
        column_shares=[3, 2],
    )
    return rrb.Vertical(rrb.Horizontal(accuracy, cost), texts, name="the run")
