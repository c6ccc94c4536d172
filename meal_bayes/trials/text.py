"""Trials as text: percepts, truths, outcomes and verdicts by name; and as a data frame.

All surfaces (terminal, notebook, viewer, report) take their words from here.
"""

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import check_place, label_values, lowest_yes, whole_array
from meal_bayes.domain import Query
from meal_bayes.domain.query import DO_NOT_KNOW
from meal_bayes.domain.words import denied
from meal_bayes.errors import QueryError
from meal_bayes.look import AMOUNT, best_options, error_text, level_names, percent
from meal_bayes.momdp import MOMDP, Belief, best_answer
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.planners import Decision
from meal_bayes.trials.outcomes import TrialOutcomes, check_trials
from meal_bayes.trials.record import Step, TrialRecord

if TYPE_CHECKING:
    import pandas as pd

SILENT = "says nothing"  # of a percept without information
_SAME = 1e-9  # probabilities that differ by less are equal


def percept_labels(momdp: MOMDP, behavior: int, observation: ArrayLike) -> list[str]:
    """Return the percept of each attribute in words; for a group, the value that it favors.

    A percept "says nothing" if true and false objects have the same probability of each level.

    Parameters
    ----------
    momdp : MOMDP
        Decision problem. Its confusion matrices show which percepts carry information.
    behavior : int
        Index of the behavior that gave the percepts.
    observation : ArrayLike
        (N,) percept level of each attribute, from 0 to K - 1, or -1 if there is no percept.
    """
    check_place("behavior", behavior, momdp.n_behaviors)
    percept = whole_array("observation", observation, len(momdp.query)).tolist()
    for level in percept:
        if level != -1:
            check_place("level", level, momdp.levels)
    names = level_names(momdp.levels)
    rows = momdp.rows[:, behavior]  # (N,2,K)
    informed = np.abs(rows[:, 1] - rows[:, 0]).max(axis=-1) > _SAME
    labels = []
    for _, indices in momdp.query.questions:
        informative = [i for i in indices if informed[i] and percept[i] >= 0]
        levels = [percept[i] for i in informative]
        if not informative:
            labels.append(SILENT)
        elif len(indices) == 1:
            labels.append(names[levels[0]])
        else:
            members = [momdp.query.attributes[i] for i in informative]
            labels.append(_spoken_for(names, members, levels))
    return labels


def attribute_labels(momdp: MOMDP, behavior: int, observation: ArrayLike) -> list[str]:
    """Return the percept of each attribute by name, (N,); all of a group have the group's."""
    labels = [""] * len(momdp.query)
    words = percept_labels(momdp, behavior, observation)
    for (_, indices), word in zip(momdp.query.questions, words, strict=True):
        for i in indices:
            labels[i] = word
    return labels


def _spoken_for(names: Sequence[str], members: Sequence[str], levels: Sequence[int]) -> str:
    """Return what percept levels of a group's members say, as in "surely half"."""
    top = max(levels)
    likeliest = " or ".join(m for m, z in zip(members, levels, strict=True) if z == top)
    if top >= lowest_yes(len(names)):
        return _said(likeliest, names[top], "yes")
    least = min(levels)
    ruled_out = " or ".join(m for m, z in zip(members, levels, strict=True) if z == least < top)
    return _said(denied(ruled_out), names[least], "no") if ruled_out else "none of them"


def _said(value: str, level: str, word: str) -> str:
    """Return a value with how sure a percept is: "surely half"; of nameless levels their number.

    >>> _said("half", "surely yes", "yes"), _said("half", "level 5", "yes")
    ('surely half', 'half (level 5)')
    """
    if level.endswith(word):
        return f"{level.removesuffix(word)}{value}"
    return f"{value} ({level})"


RIGHT = "right"
WRONG = "wrong"
UNKNOWN = "truth unknown"
YES = "yes"  # what Pr(yes is right) stands beside, as an attribute's name beside its belief
UNFINISHED = "the log ends here"  # why a trial without an outcome was broken off
_UNLIKE = 0.01  # difference of a joint prior from independence that is named,
_PAIRS = 3  # of so many pairs at most


class ComparedAction(NamedTuple):
    """One action that a decision compared with others: a behavior, or the answer.

    Its name is that of the behavior or of the answer; its value what this trial is expected to
    bring, with the standard error as text, "±0.4", empty where it would be 0.0; its bonus what
    exploring is paid on the way, None where nothing is paid or it is part of the value; visits are
    those of a search, None of other decisions and of the answer; the cost is in s.
    """

    name: str
    value: float
    bonus: float | None
    error: str
    visits: int | None
    cost: float
    chosen: bool
    is_answer: bool


def verdict_word(success: bool | None) -> str:
    """Return what is said of an answer: that it is right, that it is wrong, or that nobody knows.

    >>> verdict_word(True), verdict_word(None)
    ('right', 'truth unknown')
    """
    return UNKNOWN if success is None else RIGHT if success else WRONG


def believed(trial: TrialRecord, belief: Belief) -> list[tuple[str, float]]:
    """Return Pr(yes), where that is asked, and of each attribute Pr(it is true), named."""
    probability = trial.momdp.reports.probability_now(belief)
    event = [] if probability is None else [(YES, probability)]
    names = trial.task.query.value_names
    return [*event, *zip(names, belief.positive.tolist(), strict=True)]


def belief_before(trial: TrialRecord, number: int) -> Belief:
    """Return the belief that the step of a number, from 1, was chosen at."""
    return trial.steps[number - 2].belief if number > 1 else trial.first_belief


def answer_text(momdp: MOMDP, answer: int) -> str:
    """Return an answer by its values, or "I do not know"."""
    return momdp.query.report_name(momdp.reported(answer))


def compared_actions(
    momdp: MOMDP, decision: Decision, belief: Belief, most: int
) -> list[ComparedAction]:
    """Return the best actions that a decision compared, the best first, the chosen one among them.

    `belief` is that at which it was made, whose best answer is one of the actions. There is none
    where the agent follows a rule (`RULE` says so).
    """
    end = momdp.n_behaviors
    chosen = min(decision.action, end)
    answer = decision.action if decision.action >= end else best_answer(momdp, belief)
    bonus = decision.bonus if decision.explores else None
    compared = []
    for option in best_options(decision.total, chosen, most):
        is_answer = option == end
        searched = decision.simulations > 0 and not is_answer
        compared.append(
            ComparedAction(
                name=answer_text(momdp, answer) if is_answer else momdp.behavior_names[option],
                value=float(decision.values[option]),
                bonus=None if bonus is None else float(bonus[option]),
                error=error_text(decision.value_se[option]),
                visits=int(decision.visits[option]) if searched else None,
                cost=0.0 if is_answer else momdp.charged(option, failed=False),
                chosen=option == chosen,
                is_answer=is_answer,
            )
        )
    return compared


def together_text(momdp: MOMDP) -> str:
    """Return how attributes exclude or imply each other a priori; empty where none do.

    Of the pairs, those are named of which both being true is most unlike independence.
    """
    if momdp.joint is None:
        return ""
    query = momdp.query
    # Attributes of one variable exclude each other by definition: pairs are of two variables.
    pairs = list[tuple[int, int]]()
    for variable, other in combinations(query.variables, 2):
        pairs += product(variable, other)
    joint = {pair: float(momdp.joint @ query.values[:, pair].all(axis=1)) for pair in pairs}
    independent = {pair: float(momdp.prior[list(pair)].prod()) for pair in pairs}
    unlike = sorted(pairs, key=lambda pair: -abs(joint[pair] - independent[pair]))
    return "; ".join(
        f"both {query.attributes[i]} and {query.attributes[j]} {percent(joint[i, j])}, "
        f"if independent {percent(independent[i, j])}"
        for i, j in unlike[:_PAIRS]
        if abs(joint[i, j] - independent[i, j]) >= _UNLIKE
    )


def truth_text(query: Query, truth: Sequence[int] | NDArray[np.int8]) -> str:
    """Return the known truths (N,) in words, with "unknown" if any truth is unknown.

    If the true value of a group is known, only this value of the group is named.
    """
    truth = label_values(truth)
    if truth.shape != (len(query),):
        raise QueryError(f"truth is {truth}; give 1, 0 or -1 for each of {list(query.attributes)}.")
    implied = set[int]()  # members of a group whose true value is known
    for group in query.groups:
        if any(truth[i] == 1 for i in group):
            implied.update(group)
    names = list[str]()
    for i, (name, value) in enumerate(zip(query.attributes, truth, strict=True)):
        if value == 1:
            names.append(name)
        elif value == 0 and i not in implied:
            names.append(denied(name))
    return ", ".join([*names, "unknown"] if min(truth, default=0) < 0 else names)


def came_to_nothing(momdp: MOMDP, step: Step) -> bool:
    """Return whether a behavior yielded no percept; of one that only moves, whether it moved none.

    So people are shown it, whatever the reason; when it is not counted on any more is told by
    `trials.faults.nothing_came`, and what is learned of its success by
    `learner.experience.record_step`.
    """
    senses = bool(momdp.observation_probability[step.decision.action].max() > 0)
    return step.observation is None and (senses or step.x == step.next_x)


def outcome_text(momdp: MOMDP, step: Step) -> str:
    """Return what a behavior led to: whether it succeeded, the states, and why nothing came."""
    action = step.decision.action
    path = f"{momdp.state_label(step.x)} → {momdp.state_label(step.next_x)}"
    if step.observation is not None:
        return f"succeeded, {path}"
    if step.warning:
        return f"{path}; no percept"
    if not came_to_nothing(momdp, step):
        return f"succeeded, {path}; it shows nothing"
    if momdp.observation_probability[action].max() <= 0:
        return f"failed, {path}"
    if percepts_left(momdp, step.belief)[action] <= 0:
        return f"{path}, but no recording is left to replay"
    return f"failed, {path}; nothing perceived"


def gap_text(decision: Decision) -> str:
    """Return how far a decision may be from the best one; empty where no bound is known."""
    return "" if decision.gap is None else f"at most {decision.gap:{AMOUNT}} below the best"


def trial_reward_text(reward: float) -> str:
    """Return the reward of a trial, which is unknown where the truth is."""
    return "unknown" if np.isnan(reward) else f"{reward:{AMOUNT}}"


def cost_text(cost: float, reward: float) -> str:
    """Return cost and reward of a trial.

    >>> cost_text(2.5, float("nan"))
    '2.5 s, reward unknown'
    """
    return f"{cost:{AMOUNT}} s, reward {trial_reward_text(reward)}"


def verdict_text(trial: TrialRecord) -> str:
    """Return the answer of a trial and whether it is right, in one line."""
    if trial.ended:
        return f"no answer: {trial.ended}"
    if trial.report is None:
        return DO_NOT_KNOW
    return f"{trial.task.query.report_name(trial.report)} ({verdict_word(trial.success)})"


def end_word(trial: TrialRecord) -> str:
    """Return how a trial ends: it answers, abstains, or is broken off."""
    if trial.ended:
        return "broken off"
    return "answers" if trial.report is not None else "abstains"


def final_facts(trial: TrialRecord) -> dict[str, str]:
    """Return the answer of a trial, its truth, the verdict where there is one, and the cost."""
    query = trial.task.query
    answer = DO_NOT_KNOW
    if trial.ended:
        answer = f"none; {trial.ended}"
    truth = truth_text(query, trial.truth)
    right = query.report_truth(trial.truth)
    if query.event is not None and right[0] >= 0:
        truth = f"{query.report_name(right == 1)}: {truth}"
    facts = {"answer": answer, "truth": truth}
    if trial.report is not None:
        facts["answer"] = query.report_name(trial.report)
        if query.event is not None and trial.probability is not None:
            sure = trial.probability if trial.report[0] else 1.0 - trial.probability
            facts["answer"] += f" ({percent(sure)})"
        if trial.success is not None:
            facts["verdict"] = verdict_word(trial.success)
    return {**facts, "cost": cost_text(trial.cost, trial.reward)}


def outcome_facts(outcomes: TrialOutcomes, row: int) -> dict[str, str]:
    """Return question, object, agent, answer, truth and cost of one trial of many."""
    query = Query.named([name for name in outcomes.attribute[row] if name])
    report = outcomes.report[row][: len(query)]
    truth = outcomes.truth[row][: len(query)]
    unanswered = "none" if outcomes.ended[row] else DO_NOT_KNOW
    return {
        "question": query.text,
        "object": outcomes.object_name[row],
        "agent": outcomes.agent[row],
        "answer": truth_text(query, report) if report[0] >= 0 else unanswered,
        "truth": truth_text(query, truth),
        "cost": cost_text(float(outcomes.cost[row]), float(outcomes.reward[row])),
    }


def trials_frame(trials: Iterable[TrialRecord]) -> "pd.DataFrame":
    """Return trials as a pandas data frame, a row for each trial.

    Columns are agent, task, object, query, report, truth and success (missing if the truth is not
    known), abstained, cost_s (in seconds), reward, steps, certainty (the probability of the most
    probable values) and warnings.
    """
    import pandas as pd  # noqa: PLC0415  takes half a second

    check_trials(trials)
    rows = []
    for trial in trials:
        query = trial.task.query
        right = query.report_truth(trial.truth)
        rows.append(
            {
                "agent": trial.agent,
                "task": trial.task.name,
                "object": trial.task.object_name,
                "query": query.text.removesuffix("?"),
                "report": None if trial.report is None else query.report_name(trial.report),
                "truth": query.report_name(right == 1) if (right >= 0).all() else None,
                "success": trial.success,
                "abstained": trial.report is None,
                "cost_s": trial.cost,
                "reward": trial.reward,
                "steps": len(trial.steps),
                "certainty": trial.certainty,
                "warnings": "; ".join(trial.warnings),
            }
        )
    frame = pd.DataFrame(rows)
    return frame.astype({"success": "boolean"}) if rows else frame
