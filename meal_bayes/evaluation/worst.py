"""The part of a report that shows single trials: those with the lowest reward."""

from html import escape

from meal_bayes.agents.trial import Trial
from meal_bayes.display import percent
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.page import figure, figures, fold, section, table, verdict
from meal_bayes.evaluation.tally import Tally
from meal_bayes.trial_log.words import percept_words, truth_words, verdict_word


def worst_trials(tally: Tally) -> str:
    """Write the section of a report that shows trials with the lowest reward."""
    folded = []
    for rank, (place, trial) in enumerate(tally.worst):
        drawn = figure(
            plots.svg(plots.belief_trace(trial)),
            "Belief after each step; the circles at the end are the truth.",
        )
        said = "no answer"
        if trial.report is not None:
            said = trial.task.query.report_name(trial.report)
        judged = verdict(right=bool(trial.success), text=verdict_word(trial))
        summary = (
            f"{judged} <b>trial {place.number}</b>"
            f"{escape(', '.join(trial.task.query.attributes))}? "
            f"{escape(trial.task.object_name)}, {escape(trial.agent)}: {escape(said)}; "
            f"{trial.cost:.1f} s, reward {trial.reward:.1f}"
        )
        truth = escape(f"truth: {truth_words(trial)}")
        see = escape(f"meal-bayes view {place.file} --trial {place.number}")
        note = f"<p class='note'>{truth}<br>see it: <code>{see}</code></p>"
        body = figures(drawn, f"<div>{note}{_steps(trial)}</div>")
        folded.append(fold(summary, body, opened=rank < 3))  # noqa: PLR2004
    text = "Those with the lowest reward; among equals, where the robot was surest."
    return section("The worst trials", text, *folded)


def _steps(trial: Trial) -> str:
    momdp = trial.momdp
    cells = []
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        report = action >= momdp.n_behaviors
        name = "report" if report else momdp.behavior_names[action]
        seen = "-"
        if step.observation is not None:
            seen = ", ".join(percept_words(momdp, action, step.observation))
        belief = ", ".join(percent(p) for p in step.belief.positive.tolist())
        cells.append([str(number), name, f"{step.cost:g}", "" if report else seen, belief])
    return table(["", "behavior", "s", "percept", "belief"], cells, texts=(1, 3, 4))
