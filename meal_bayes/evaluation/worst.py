"""The section of a report that shows single trials: those with the lowest reward."""

from meal_bayes.display import percent
from meal_bayes.domain import Query
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.collect import Collected, Worst
from meal_bayes.evaluation.page import Block, Figure, Table
from meal_bayes.trials import Trial, percept_labels, truth_text

_OPENED = 3  # trials that are not folded


def worst_trials(data: Collected) -> Block:
    """Return the trials with the lowest reward; a single trial with its own title."""
    parts = [_trial(worst, opened=rank < _OPENED) for rank, worst in enumerate(data.worst)]
    if data.trials == 1:
        return Block(title="The trial", parts=parts)
    text = "Those with the lowest reward; among equals, where the belief was nearest to certain."
    return Block(title="The worst trials", text=text, parts=parts)


def _trial(worst: Worst, *, opened: bool) -> Block:
    file, number, outcome, trial = worst
    query = Query(tuple(filter(None, outcome.attribute[0])))
    verdict = report = "abstained"
    if outcome.answered[0]:
        report = query.report_name(outcome.report[0][: len(query)] == 1)
        verdict = "right" if outcome.success[0] else "wrong"
    truth = truth_text(query.attributes, outcome.truth[0][: len(query)])
    title = (
        f"trial {number}: {', '.join(query.attributes)}? {outcome.object_name[0]}, "
        f"{outcome.agent[0]}: {report}; {outcome.cost[0]:.1f} s, reward {outcome.reward[0]:.1f}"
    )
    if trial is None:
        text = f"truth: {truth}; {file} holds no steps"
        return Block(title=title, verdict=verdict, text=text)
    caption = "Belief after each step; the circles at the end are the truth."
    return Block(
        title=title,
        verdict=verdict,
        text=f"truth: {truth}",
        command=f"meal-bayes view {file} --trial {number}",
        tables=[_steps(trial)],
        figures=[Figure(plots.belief_trace(trial), caption)] if len(trial.steps) > 1 else [],
        opened=opened,
    )


def _steps(trial: Trial) -> Table:
    momdp = trial.momdp
    rows = []
    for number, step in enumerate(trial.steps, start=1):
        action, percept = step.decision.action, "-"
        if action >= momdp.n_behaviors:
            percept = ""
        elif step.observation is not None:
            percept = ", ".join(percept_labels(momdp, action, step.observation))
        elif step.warning:
            percept = step.warning
        name = momdp.action_label(action)
        belief = ", ".join(map(percent, step.belief.positive.tolist()))
        rows.append([str(number), name, f"{step.cost:g}", percept, belief])
    return Table(["", "behavior", "s", "percept", "belief"], rows, texts=(1, 3, 4))
