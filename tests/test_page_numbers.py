"""Numbers that pages and docstrings repeat for their readers are those of the code."""

import math
from pathlib import Path

import pytest
from scipy.special import ndtri

from meal_bayes import display, palette, untrusted
from meal_bayes.agents import (
    AGENTS,
    ITRSBonus,
    agent,
    co_occurrence,
    exploration,
    label_prices,
    progress,
)
from meal_bayes.datasets import levels, percepts
from meal_bayes.domain import Domain, TransitionDiagram, query, success
from meal_bayes.domain.labels import PRIOR_OBJECTS
from meal_bayes.evaluation import calibration, outcome_model, statistics
from meal_bayes.experiments import offline, online, online_protocol
from meal_bayes.learner import online as learning
from meal_bayes.learner import views
from meal_bayes.learner.settings import REFIT_EVERY
from meal_bayes.momdp import flat_pomdp
from meal_bayes.momdp.model import DISCOUNT
from meal_bayes.perception import feature_spaces, own_classifier, settings
from meal_bayes.perception.settings import DEFAULT
from meal_bayes.planners import POMCP, momdp_arrays
from meal_bayes.planners.factored import policy as table
from meal_bayes.planners.pomcp import expansion
from meal_bayes.posterior import grid, trait
from meal_bayes.simulated_arm import physics
from meal_bayes.trial_log import container, reader, schema, writer
from meal_bayes.trials import faults
from meal_bayes.trials.placing import look_of
from paper_repro import claims, inference, published
from paper_repro import online as repeats
from paper_repro.items import fig8, fig9, fig12, hierarchical, pomdpsol, table3

ROOT = Path(__file__).resolve().parents[1]
LOOKS = [look_of(dark=dark, narrow=False) for dark in (False, True)]
POWER = f"{100 * inference.POWER:g} %"
WORDS = {
    0.5: "half", 2: "two", 3: "three", 4: "four", 5: "five", 8: "eight", 10: "ten", 20: "twenty",
}  # fmt: skip
MINUS = "\N{MINUS SIGN}"
PARTS = {0.2: "a fifth", 0.25: "a quarter", 0.5: "a half"}
TIMES = {1: "once", 2: "twice"}


DOMAIN = Domain.__dataclass_fields__
DIAGRAM = TransitionDiagram.__dataclass_fields__
FOLDS = settings.FOLDS_TRAINED_ANEW
LEVELS = AGENTS["bayes"].levels


def point(number: float) -> str:
    """Return a number without the zero before its point, as pages have it."""
    return f"{number:g}".removeprefix("0")


def brief(number: float) -> str:
    """Return a power of ten, such as 1e-3."""
    return f"{number:.0e}".replace("e-0", "e-")


def millions(number: int) -> str:
    """Return whole millions in words."""
    return "a million" if number == 1_000_000 else f"{word(number / 1e6)} million"


def size(amount: int) -> str:
    """Return a number of bytes in the largest unit of which it is a multiple."""
    for shift, unit in ((30, "GB"), (20, "MB"), (10, "KB")):
        if amount % (1 << shift) == 0:
            return f"{amount >> shift} {unit}"
    return f"{amount:,} bytes"


def word(number: float) -> str:
    """Return a number in words, as a page has it in a sentence."""
    return WORDS.get(number, f"{number:g}")


def times(number: int) -> str:
    """Return how often, in words."""
    return TIMES.get(number, f"{word(number)} times")


SECURITY = [
    f"| a text file of numbers (CSV) | {size(untrusted.TEXT_LIMIT)},",
    f"| a domain table | {size(untrusted.TABLE_LIMIT)}, "
    f"lines of {untrusted.LINE_LIMIT:,} characters; "
    f"{untrusted.NAME_LIMIT:,} attributes, behaviors or states; "
    f"names of {untrusted.LETTER_LIMIT} characters; "
    f"{untrusted.DIAGRAM_LIMIT:,} entries of the diagram |",
    f"| JSON (headers of logs and tables) | {size(untrusted.JSON_LIMIT)}, "
    f"{untrusted.DEPTH_LIMIT} deep,",
    f"| a percept table | {size(percepts._LARGEST)} a member, unpacked;",
    f"| a saved learner | {size(untrusted.MEMBER_LIMIT)} a member, unpacked;",
    f"| one record of a log | {size(schema.RECORD_LIMIT)} packed or unpacked; "
    f"a message {size(schema.MESSAGE_LIMIT)}, a trial {size(schema.TRIAL_LIMIT)} |",
    f"| a whole log | unpacks to {size(reader._FREE_BYTES)} and "
    f"{reader._UNPACKING} times its size;",
    f"| one trial | {schema.EDGE_LIMIT:,} edges of search trees, "
    f"{schema.COUNT_LIMIT:,} percept counts; of features {schema.FEATURE_LIMIT:,} a step and "
    f"{schema.TRIAL_FEATURES:,} in all,",
    f"a search {schema.MOST_OBJECTS:,} objects |",
    f"| MOMDPs that a reader remembers | {schema.MOMDP_MEMORY}, or {size(schema.MOMDP_BYTES)} |",
    f"| rewards, costs, shaping | {untrusted.LARGEST:,.0f} s |",
]
LIMITS = [
    f"in queries of up to {co_occurrence.MOST_VALUES} values",
    f"**{word(faults._LEAST).capitalize()} executions without a yield make a behavior broken",
    f"Up to {DEFAULT.exact_recordings:,} recordings of a behavior, and for percept tables "
    f"{DEFAULT.exact_objects} objects,",
    f"leaves out {word(DEFAULT.folds)} folds of objects and compares recordings with "
    f"{DEFAULT.landmarks} landmarks",
]
LIMITS.append(f"| {word(table._MANY)} attributes, Eq. 8;")
BETA = ITRSBonus().beta
LEARNING = [
    f"no bonus is left ({ITRSBonus().alpha:g} {MINUS} {BETA:g} s)",
    f"({ITRSBonus().alpha:g} {MINUS} {BETA:g} / 6 > 0)",
    f"paid for {word(exploration._PAID_BY_ITRS)} percepts of a behavior in a trial at most",
    f"as many as it was asked, and {progress._FIRST:g} more",
    rf"p = \frac{{{success._PRIOR:g}\,p_0 + S}}{{{success._PRIOR:g} + S + F}}",
    f"weighed by $2^{{-m/{views.HALVED}}}$",
    f"when labeled recordings have grown by {PARTS[REFIT_EVERY]} (`refit_every`)",
    f"and {word(views.HALVED)} trials halve what it is believed by",
    f"is given up after {word(faults._LEAST)} executions or {word(faults._LEAST + 1)}",
]
PROBLEM = [
    rf"$\gamma = {point(DISCOUNT)}$ acts",
    f"`bayes` uses $K = {LEVELS}$",
    f"$(n_k + {PRIOR_OBJECTS:g}) / (n + K)$ of $n$ objects",
]
PLANNING = [
    f"for up to {word(table._MANY)} attributes (which share "
    f"{table._FINER * POMCP().points:,} points",
    f"priced at {momdp_arrays._PRICE:.4f} of",
]
OWN_DATA = [
    f"{MINUS}r of a wrong one [{DOMAIN['report_reward'].default:g}]",
    f"[{', '.join(f'{s:g}' for s in DOMAIN['legal_budget'].default)}]",
    f'`illegal` ["{DIAGRAM["illegal"].default}"; or',
]
PAPER_PAGES = [
    f"would decide an online statement at {POWER} power",
    f"repeats are the units, by Student's t ({repeats.SPLITS}).",
    f"{2 * repeats.REPEATS} repeats in place of {repeats.REPEATS} would narrow intervals",
    f"A claim of more than {word(claims._SHOWN)} statements shows",
    f"its points of Fig. 9 ({pomdpsol.TRIALS}), those of `fig9` from two irrelevant attributes to "
    f"four ({fig9.TRIALS}) and MORC that must answer there ({fig9.FORCED}).",
    f"In Fig. 8 there are {fig8.TRIALS:,}, as many as there are questions of one attribute",
    f"planned ({table3.TRIALS}; in Fig. 9 Fig. 8's where its questions are the same, "
    f"{fig9.PUBLISHED} at the end, else {fig9.TRIALS}).",
    f"Fig. 12 has {fig12.REPEATS} at each of its {len(fig12.ALPHAS) * len(fig12.BETAS)} pairs of",
]
PAGES = {
    "SECURITY.md": SECURITY,
    "docs/limits.md": LIMITS,
    "docs/concepts/learning.md": LEARNING,
    "docs/concepts/problem.md": [
        f"are then {co_occurrence._BAYES_FACTOR:g} times as likely",
        f"(up to {co_occurrence.MOST_VALUES}, those of "
        f"{word(math.log2(co_occurrence.MOST_VALUES))} attributes",
        *PROBLEM,
    ],
    "docs/concepts/observation-model.md": [
        f"$(n^+ + {PRIOR_OBJECTS:g}) / (n + {2 * PRIOR_OBJECTS:g})$ of the training objects",
    ],
    "docs/concepts/perception.md": [
        f"clipped at {word(feature_spaces._FAR)} standard deviations",
    ],
    "docs/concepts/planning.md": PLANNING,
    "docs/concepts/words.md": [
        f"One of the {word(len(levels.BIN_EDGES) + 1)} bins",
        f"at most {offline.UNIT} trials of an agent",
    ],
    "docs/how-to/own-data.md": OWN_DATA,
    "docs/how-to/posterior.md": [f"(`bayes` has {LEVELS}: `--levels {LEVELS}`)"],
    "docs/log-format.md": [
        f"columns of {writer.ROWS} trials",
        f"more than {millions(schema.FEATURE_LIMIT)} features, and those beyond "
        f"{millions(schema.TRIAL_FEATURES)} of a trial",
    ],
    "docs/paper/departures.md": [
        f"| discount in planning | {point(DISCOUNT)} |",
        f"a total of {grid.PRIOR_WEIGHT:g} a row",
        f"one tree search, {POMCP().simulations} simulations a decision",
        f"of {word(exploration._PAID_BY_ITRS)} percepts of a behavior in a trial at most",
    ],
    "docs/tutorials/own-robot.md": [
        f"yields nothing, at least {times(faults._LEAST)} in a row",
        f"whose features came {times(faults._LEAST)} and could not be read",
    ],
    "meal_bayes/agents/agent.py": [f"each is right in {100 * agent._TRUST:g} of 100 cases"],
    "meal_bayes/agents/label_prices.py": [
        f"as Normal, up to {label_prices._Z[-1]:g} standard deviations",
    ],
    "meal_bayes/agents/progress.py": [
        f"as many as it was asked so far, and {progress._FIRST:g} more",
    ],
    "meal_bayes/domain/query.py": [f"at most 2^{query._TABLE_LIMIT.bit_length() - 1}."],
    "meal_bayes/domain/tables.py": [f'illegal ["{DIAGRAM["illegal"].default}", or'],
    "meal_bayes/domain/success.py": [
        f"The prior is worth {word(success._PRIOR)} executions",
    ],
    "meal_bayes/display.py": [f"a value in at most {display._LONGEST} characters"],
    "meal_bayes/evaluation/calibration.py": [
        f"over {word(calibration.BINS)} bins",
        "clipped to [{0}, 1 - {0}]".format(f"{calibration.CLIP:.0e}".replace("-0", "-")),
    ],
    "meal_bayes/evaluation/outcome_model.py": [
        f"# of its {statistics.MASS:.0%} credible".replace("%", " %"),
        "{success} of accuracy, {cost:g} s of cost, {reward:g} of reward".format(
            **outcome_model.MARGINS
        ).removeprefix("0"),
    ],
    "meal_bayes/evaluation/templates/report.html": [
        f"--ink: {LOOKS[0].ink.lower()}; --soft: {LOOKS[0].soft.lower()};",
        f"--ink: {LOOKS[1].ink.lower()}; --soft: {LOOKS[1].soft.lower()};",
        f"--back: {palette.GROUNDS[0]};",
    ],
    "meal_bayes/evaluation/summary.py": [
        f"# {statistics.MASS:.0%} interval".replace("%", " %"),
    ],
    "meal_bayes/experiments/config.py": [
        f"by default {online._REWARD:g} on public data",
    ],
    "meal_bayes/experiments/offline.py": [
        f"Up to {offline.UNIT} trials of one agent",
        f"from a cluster after {offline.UNIT} trials.",
    ],
    "meal_bayes/experiments/online_protocol.py": [
        f"the {word(online_protocol.ASKED)} attributes that are perceived best",
        f"each with {word(online_protocol._POSITIVES)} positives of every attribute",
        f"{online_protocol._TESTS} at most",
    ],
    "meal_bayes/momdp/build.py": [f"discounted by {DISCOUNT:g} a step"],
    "meal_bayes/momdp/solver_files.py": [
        f"without a percept: `{flat_pomdp.NOTHING}`, nothing has happened",
        f"`{flat_pomdp.DONE}`, x has changed",
    ],
    "meal_bayes/planners/factored/policy.py": [
        f"by the price ({brief(momdp_arrays._PRICE)} of",
        f"{word(table._MANY)} in some seconds",
    ],
    "meal_bayes/planners/pomcp/policy.py": [f"(drawn ones beyond {expansion.ENUMERATE})"],
    "meal_bayes/learner/learner.py": [
        f"in trials that taught it, and {progress._FIRST:g} more.",
    ],
    "meal_bayes/learner/online.py": [f"now another by more than 1 in {1 / learning._SAME:g}."],
    "meal_bayes/palette.py": [f"with the page is at least {palette.READABLE:g} to 1,"],
    "meal_bayes/simulated_arm/arm.py": [
        f"Called {physics.FRAMES_PER_SECOND} times a simulated second",
    ],
    "meal_bayes/simulated_arm/physics.py": [
        f"is called {physics.FRAMES_PER_SECOND} times a simulated second",
    ],
    "meal_bayes/perception/feature_spaces.py": [
        f"clipped at {feature_spaces._FAR:g} standard deviations",
    ],
    "meal_bayes/perception/fold_classifiers.py": [
        f"with {word(FOLDS)}, {sum(math.comb(FOLDS, k) for k in (1, 2, 3))} trainings serve",
    ],
    "meal_bayes/perception/own_classifier.py": [
        f"rows sum to 1 within {brief(own_classifier._SUM)}",
    ],
    "meal_bayes/perception/settings.py": [f"; {FOLDS} folds by default"],
    "meal_bayes/posterior/grid.py": [f"at the weight of {grid._GRADED:g} percepts"],
    "meal_bayes/posterior/trait.py": [
        f"Its precision is {word(trait._WITHIN)} of that given the truth",
        f"a half-normal({trait._SCALE:g}) prior",
    ],
    "meal_bayes/trial_log/container.py": [
        f"The search ends after {size(container._SEARCHED * schema.RECORD_LIMIT)}:",
    ],
    "meal_bayes/trial_log/writer.py": [f"{writer.ROWS} trials in a message"],
    "docs/how-to/check-a-statement.md": [
        f"splits that would decide it at {POWER} power",
        f"(*t* of `level` + {ndtri(inference.POWER):.2f}) standard".replace("0.", "."),
    ],
    "paper_repro/inference.py": [
        f"on which side of a bound an effect is, at {POWER} power.",
        f"number below {inference._MOST:,} would",
        f"the {statistics.MASS_TEXT} percentile interval",
    ],
    "paper_repro/items/hierarchical.py": [
        f"the first {hierarchical.OFFLINE_TRIALS} of {fig8.TRIALS:,} trials",
    ],
    "paper_repro/published.py": [
        f"is right with {published.ANSWER_RIGHT:g} there".replace("0.", "."),
    ],
    "paper_repro/rules.py": PAPER_PAGES,
    "paper_repro/statements.py": [
        f"that would decide it at {POWER} power;",
        f"by the {statistics.MASS_TEXT} prediction interval of one more of ours.",
        f"at its part of {100 * inference.LEVEL:g} %;",
    ],
}


@pytest.mark.parametrize(
    ("page", "sentence"), [(page, text) for page, texts in PAGES.items() for text in texts]
)
def test_a_page_has_the_number_of_the_code(page: str, sentence: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    found = sentence in " ".join(text.split())
    assert found, f"{page} says another number than the code; expected {sentence!r}"
