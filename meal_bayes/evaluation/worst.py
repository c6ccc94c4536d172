"""The part of a report that shows single trials: those with the lowest reward."""

from html import escape

from meal_bayes.agents.trial import Trial
from meal_bayes.display import percent
from meal_bayes.domain import Query
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.page import figure, figures, fold, section, table, verdict
from meal_bayes.evaluation.tally import Bad, Tally
from meal_bayes.trial_log.words import percept_words, truth_words


def worst_trials(tally: Tally) -> str:
    """Write the section of a report that shows trials with the lowest reward."""
    folded = [_folded(rank, bad) for rank, bad in enumerate(tally.worst)]
    text = "Those with the lowest reward; among equals, where the robot was surest."
    return section("The worst trials", text, *folded)


def _folded(rank: int, bad: Bad) -> str:
    place, outcome, trial = bad
    query = Query(tuple(filter(None, outcome.attribute[0])))
    answered, right = bool(outcome.answered[0]), bool(outcome.success[0])
    report = query.report_name(outcome.report[0][: len(query)] == 1) if answered else "no answer"
    word = ("right" if right else "wrong") if answered else "no answer"
    summary = (
        f"{verdict(right=right, text=word)} <b>trial {place.number}</b>"
        f"{escape(', '.join(query.attributes))}? "
        f"{escape(outcome.object_name[0])}, {escape(outcome.agent[0])}: {escape(report)}; "
        f"{outcome.cost[0]:.1f} s, reward {outcome.reward[0]:.1f}"
    )
    truth = escape(f"truth: {truth_words(query.attributes, outcome.truth[0][: len(query)])}")
    if trial is None:
        note = f"<p class='note'>{truth}<br>{escape(str(place.file))} holds no steps</p>"
        return fold(summary, note)
    drawn = figure(
        plots.svg(plots.belief_trace(trial)),
        "Belief after each step; the circles at the end are the truth.",
    )
    see = escape(f"meal-bayes view {place.file} --trial {place.number}")
    note = f"<p class='note'>{truth}<br>see it: <code>{see}</code></p>"
    body = figures(drawn, f"<div>{note}{_steps(trial)}</div>")
    return fold(summary, body, opened=rank < 3)


def _steps(trial: Trial) -> str:
    momdp = trial.momdp
    cells = []
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        report = action >= momdp.n_behaviors
        name = "report" if report else momdp.behavior_names[action]
        percept = "-"
        if step.observation is not None:
            percept = ", ".join(percept_words(momdp, action, step.observation))
        belief = ", ".join(percent(p) for p in step.belief.positive.tolist())
        cells.append([str(number), name, f"{step.cost:g}", "" if report else percept, belief])
    return table(["", "behavior", "s", "percept", "belief"], cells, texts=(1, 3, 4))
