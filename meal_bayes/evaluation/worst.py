"""Trials as sections of a page: the worst of each agent, a robot's lab, searches."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.display import AMOUNT, percent
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.logged import LogPart
from meal_bayes.evaluation.page import Section, Table
from meal_bayes.evaluation.statistics import MASS_TEXT
from meal_bayes.evaluation.summary import estimate_mean
from meal_bayes.files import command_line
from meal_bayes.trial_log import Group
from meal_bayes.trial_log.names import begun_text
from meal_bayes.trial_log.schema import ASK
from meal_bayes.trial_log.searches import unfinished_text
from meal_bayes.trials import Search, Trial, TrialOutcomes
from meal_bayes.trials.percept_text import attribute_labels
from meal_bayes.trials.search import EXPLORED, as_left, explored_rows, search_facts
from meal_bayes.trials.text import last_label, outcome_facts, verdict_word

WORST = 3  # trials of each agent that are kept whole
_OPENED = 3  # of a lab's trials
_LISTED = 200  # trials of a lab in the table
_BLOCK = 5  # least trials of a block of the curve
_BLOCKS = 10  # of them at most


class AgentPart(NamedTuple):
    """An agent's trials in one part of a batch, training or tests; `batch` is -1 of no batch."""

    agent: str
    batch: int
    part: str


class ShownTrial(NamedTuple):
    """A trial that is shown, its number in its file, its outcome as one row.

    `trial` is None of a compact log.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None

    @property
    def badness(self) -> float:
        """By what the worst trials are ranked."""
        return float(_badness(self.outcome)[0])


def _badness(outcomes: TrialOutcomes) -> Floats:
    """Return by what the worst trials are ranked, (n,): little reward; of equals, a sure belief."""
    return np.asarray(outcomes.certainty - outcomes.reward)


def worst_first(outcomes: TrialOutcomes) -> Ints:
    """Return the trials whose truth is known, the worst first, (n,).

    They are those with the lowest reward; of equals, those that were surest come first, then the
    earliest.
    """
    order = np.argsort(-_badness(outcomes), kind="stable")
    return order[outcomes.judged[order]]


def worst_of(
    worst: Mapping[AgentPart, Sequence[ShownTrial]], group: Group
) -> dict[AgentPart, Sequence[ShownTrial]]:
    """Return the worst trials of each agent, batch and part, of those so far and of a group.

    A report shows the worst of an agent's tests over all of these: `report._worst`.
    """
    ranking = dict(worst)
    log_part = LogPart.of(group.header)
    outcomes = group.outcomes
    order = worst_first(outcomes)
    for agent in outcomes.agents:
        rows = order[outcomes.agent[order] == agent][:WORST].tolist()
        key = AgentPart(agent, log_part.batch, log_part.part)
        entries = [*ranking.get(key, ()), *shown_rows(group, rows)]
        ranking[key] = sorted(entries, key=lambda entry: -entry.badness)[:WORST]
    return ranking


def live_trials(group: Group) -> list[ShownTrial]:
    """Return the trials of a group of a robot's lab, in order; none of another run."""
    config = group.header.get("config")
    if not isinstance(config, dict) or config.get("command") != ASK:
        return []
    return list(shown_rows(group, range(len(group.outcomes))))


def shown_rows(group: Group, rows: Sequence[int]) -> Iterator[ShownTrial]:
    """Yield some trials of a group."""
    for row in rows:
        trial = group.trials[row] if group.trials else None
        yield ShownTrial(group.file, group.numbers[row], group.outcomes.rows([row]), trial)


def worst_section(worst: Sequence[tuple[str, Sequence[ShownTrial]]]) -> Section:
    """Return the worst trials of each agent, of which the first is not folded."""
    parts = list[Section]()
    compact = False
    for number, (agent, trials) in enumerate(worst):
        compact |= any(shown_trial.trial is None for shown_trial in trials)
        sections: list[Section] = [
            {**trial_section(shown_trial), "opened": rank == 0}
            for rank, shown_trial in enumerate(trials)
        ]
        parts.append({"title": agent or "agent", "parts": sections, "opened": number == 0})
    section: Section = {
        "title": "The worst trials",
        "says": "Of each agent those with the lowest reward, the best agent first; of equals, "
        "where the belief was nearest to certain.",
        "parts": parts,
        "measures": True,
    }
    if compact:
        section["text"] = "A compact log holds no steps; of its trials there is the outcome."
    return section


def lab_sections(trials: Sequence[ShownTrial]) -> Iterator[Section]:
    """Yield the trials of a lab, newest first, and how right and how long they were."""
    # Names of a lab's logs begin with the time, so that their order is that of the trials.
    newest = sorted(
        trials, key=lambda shown_trial: (shown_trial.file.name, shown_trial.number), reverse=True
    )
    rows = []
    for shown_trial in newest[:_LISTED]:
        facts = _facts(shown_trial)
        belief = percent(float(shown_trial.outcome.certainty[0]))
        rows.append(
            [
                begun_text(shown_trial.file) or "-",
                facts["object"],
                facts["question"],
                facts["answer"],
                belief,
                f"{shown_trial.outcome.cost[0]:{AMOUNT}}",
                facts["truth"],
            ]
        )
    head = ["time (UTC)", "object", "question", "answer", "belief", "cost, s", "truth"]
    note = "The truth is what was given with the question, or told since."
    if len(newest) > _LISTED:
        note = f"The newest {_LISTED} of {len(newest):,} trials. {note}"
    table: Table = {"head": head, "rows": rows, "texts": (1, 2, 3, 6), "note": note}
    parts: list[Section] = [
        {**trial_section(shown_trial), "opened": number < _OPENED}
        for number, shown_trial in enumerate(newest[: 2 * _OPENED])
    ]
    yield {"title": "The trials", "tables": [table], "parts": parts}
    yield from _progress(newest[::-1])


def searches_section(searches: Sequence[tuple[Path, Search]]) -> Section:
    """Return the searches of a page, by folder: what each turned to, and claimed."""
    rows = []
    parts = list[Section]()
    for file, search in searches[-_LISTED:]:
        folder = file.parent
        facts = search_facts(search)
        turned = facts["turns"]
        unexplored = [name for name in search.trials if name not in search.turns]
        if unexplored:
            turned += f"; not to {', '.join(unexplored)}"
        words = [facts[name] for name in ("question", "answer", "verdict")]
        rows.append([folder.name, *words, turned, f"{search.cost:{AMOUNT}}"])
        explored = list[Section]()
        for number, name in enumerate(dict.fromkeys(search.turns)):
            trial = as_left(search.trials[name])
            shown_trial = ShownTrial(folder, number, TrialOutcomes.of([trial]), trial)
            verdict = verdict_of(shown_trial) if trial.report is not None else ""
            explored.append({**trial_section(shown_trial), "verdict": verdict})
        objects: Table = {
            "head": list(EXPLORED),
            "rows": list(map(list, explored_rows(search))),
            "texts": (EXPLORED.index(EXPLORED.behaviors),),
            "note": "" if search.answered else f"{unfinished_text(folder)}.",
        }
        title = f"{folder.name}: {search.question}"
        parts.append({"title": title, "parts": explored, "tables": [objects]})
    table: Table = {
        "head": ["folder", "question", "answer", "verdict", "turned to", "cost, s"],
        "rows": rows,
        "texts": (1, 2, 3, 4),
        "note": "A search turns from one object to another, and claims one, or none. Each that it "
        "explored has a trial; those that it left end without a report.",
    }
    command = command_line("meal-bayes log show", searches[-1][0].parent)
    newest = parts[-_OPENED:]
    return {"title": "Searches", "tables": [table], "command": command, "parts": newest}


def search_finding(searches: Sequence[tuple[Path, Search]]) -> str:
    """Say how many searches were right, of those of which that is known, and what one cost."""
    verdicts = [search.success for _, search in searches if search.success is not None]
    cost = sum(search.cost for _, search in searches) / len(searches)
    text = f"{sum(verdicts)} of {len(verdicts)} searches whose truth is known were right"
    broken = sum(bool(search.ended) for _, search in searches)
    if not verdicts:
        text = "Of no search that gave an answer is the truth known"
    off = f"; {broken} without an answer" if broken else ""
    return f"{text}, at {cost:{AMOUNT}} s a search{off}."


def _progress(trials: Sequence[ShownTrial]) -> Iterator[Section]:
    """Yield accuracy over the number of the trial, in blocks, where enough truths are known."""
    outcomes = TrialOutcomes.join([shown_trial.outcome for shown_trial in trials])
    judged = np.flatnonzero(outcomes.judged)
    blocks = min(len(judged) // _BLOCK, _BLOCKS)
    if blocks < 2:
        return
    points = []
    # Blocks follow each other and do not overlap: their errors are independent but for objects.
    for rows in np.array_split(judged, blocks):
        accuracy = estimate_mean(outcomes.rows(rows), "success").interval()
        points.append((rows.mean() + 1, accuracy.estimate, accuracy.low, accuracy.high))
    series = plots.Series(outcomes.agents[-1] or "agent", *np.transpose(points))
    drawn = plots.lines([series], x_label="trial", y_label="accuracy")
    drawn.set_ylim(-0.02, 1.02)
    text = (
        f"Accuracy of {blocks} blocks of trials whose truth is known, {MASS_TEXT} band, objects "
        "drawn as wholes."
    )
    yield {"title": "Trial by trial", "figures": [(drawn, text)]}


def _facts(shown_trial: ShownTrial) -> dict[str, str]:
    facts = outcome_facts(shown_trial.outcome, 0)
    if shown_trial.trial is not None:
        facts["question"] = shown_trial.trial.task.question
    return facts


def verdict_of(shown_trial: ShownTrial) -> str:
    """Return whether a trial's answer is right, that it abstained, or "" where nobody knows."""
    if not shown_trial.outcome.answered[0]:
        return "" if shown_trial.outcome.ended[0] else "abstained"
    if not shown_trial.outcome.judged[0]:
        return ""
    return verdict_word(bool(shown_trial.outcome.success[0]))


def trial_section(shown_trial: ShownTrial) -> Section:
    """Return a trial as a part of a section, its verdict before its title."""
    file, number, _, trial = shown_trial
    facts = _facts(shown_trial)
    title = "{question} {object}, {agent}: {answer}; {cost}".format(**facts)
    right = bool(shown_trial.outcome.success[0] == 1)
    section: Section = {"title": title, "verdict": verdict_of(shown_trial), "right": right}
    if trial is None:
        return {**section, "text": f"trial {number} of {file}; truth: {facts['truth']}"}
    return {**section, **trial_content(shown_trial, trial)}


def trial_content(shown_trial: ShownTrial, trial: Trial) -> Section:
    """Return the picture of a trial and the table of its steps."""
    caption = (
        "What it did and believed, and what going on was worth over answering now; circles are "
        "the truth."
    )
    gaps = any(step.decision.gap is not None for step in trial.steps)
    names = trial.task.query.value_names
    head = ["", "behavior", "s", *names, *(["gap"] if gaps else [])]
    table: Table = {
        "head": head,
        "rows": list(_steps(trial, gaps=gaps)),
        "texts": (1, *range(3, 3 + len(names))),
        "note": "Of each attribute: what the percept said, and the belief after it."
        + (" A gap is the reward that the best action may be worth more, at most." if gaps else ""),
    }
    facts = _facts(shown_trial)
    return {
        "text": f"truth: {facts['truth']}",
        "command": command_line(
            "meal-bayes view", shown_trial.file, "--trial", str(shown_trial.number)
        ),
        "tables": [table],
        "figures": [(plots.trial_picture(trial), caption)] if trial.steps else [],
        "wide": True,
    }


def _steps(trial: Trial, *, gaps: bool) -> Iterator[list[str]]:
    momdp = trial.momdp
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        beliefs = [percent(p) for p in step.belief.positive.tolist()]
        words = [""] * len(beliefs)
        if step.observation is not None:
            words = attribute_labels(momdp, action, step.observation)
        label = last_label(trial, action)
        if step.warning:
            label += f" ({step.warning})"
        cells = [f"{word}, {p}" if word else p for word, p in zip(words, beliefs, strict=True)]
        row = [str(number), label, f"{step.cost:g}", *cells]
        if gaps:
            gap = step.decision.gap
            row.append("" if gap is None else f"{gap:{AMOUNT}}")
        yield row
