"""A rule stands in one place, which others call; where it must stand twice, both are the same."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.arrays import _array_fields, lowest_yes, no_and_yes_of, yes_of
from meal_bayes.cli.posterior import posterior as posterior_command
from meal_bayes.datasets.detections import detected_levels
from meal_bayes.datasets.levels import BIN_COUNT, BIN_EDGES, STORED
from meal_bayes.datasets.percepts import PerceptTable
from meal_bayes.domain import load_domain
from meal_bayes.momdp import observation
from meal_bayes.planners.open_loop import bayes_error
from meal_bayes.posterior import ConfusionPosterior, grid

PACKAGE = Path(__file__).resolve().parents[1] / "meal_bayes"
ONCE = [  # how a rule is written, where alone, and what others call
    (r"(shape\[-?\w+\]|levels|len\(names\)) // 2", "arrays.py",
     "lowest_yes: which levels of a percept say yes"),
    (r"(?i)discount\b.* = 0\.\d", "momdp/model.py", "DISCOUNT: of agents and problems alike"),
    (r"\b(taus?|TAUS)\*\*2", "posterior/grid.py", "LOG_TAU_PRIOR: the prior of tau"),
    (r"\b1e9\b", "posterior/grid.py experiments/config.py", "AS_INFINITE: for inf"),
    (r"2\.0 / sizes", "perception/kernel_ridge.py", "object_weights: what a recording weighs"),
    (r"mean \* \(1 - mean\) / |, 0\.99\)|1 \+ progress\.percepts",
     "agents/label_prices.py", "rate_moments, uncertain, Progress.beta: rates of a Beta"),
    (r"failed=.* and |x == next_x and not perceived", "momdp/model.py",
     "MOMDP.charged_for: what failed, and cost so much"),
    (r"thresholds - 1\) / ", "planners/open_loop/bayes_error.py",
     "threshold_below, _first_yes: how thresholds of error tables are spaced"),
    (r"(limit|unpaid)\b.*\) ?/ (counts|np.maximum\(planned)|model.bonus_limit / ",
     "planners/momdp_arrays.py", "paid_share: of how many percepts exploring is paid"),
    (r"""f"not \{|"not ["']""", "domain/words.py", "denied: how it is said that one is false"),
    (r"(= |, |else |\{|return )-((self|domain|progress)\.)?(report_)?reward\b", "domain/event.py",
     "wrong_reward: what a wrong report earns where nothing is said"),
    (r"(?i)\bmax_steps(: int)? = \d", "planners/solver.py",
     "MAX_STEPS: of a trial, played or simulated"),
    (r"n't\"\)", "domain/words.py", "contracts_not"),
    (r"percept_counts.*sum\(.*limit|limit.*percept_counts.*sum\(", "momdp/belief.py",
     "percepts_left: when recordings are used up"),
    (r"youden\(.*\) *(>|<)", "perception/confusion.py", "informative: which pairs tell anything"),
]  # fmt: skip


@pytest.mark.parametrize(("pattern", "places", "rule"), ONCE, ids=[rule[2][:20] for rule in ONCE])
def test_a_rule_is_written_once(pattern: str, places: str, rule: str) -> None:
    lines = [
        (path.relative_to(PACKAGE).as_posix(), number, line.strip())
        for path in sorted(PACKAGE.rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if re.search(pattern, line)
    ]
    assert {path for path, _, _ in lines} >= {*places.split()}, f"{pattern} is no more {rule}"
    elsewhere = [line for line in lines if line[0] not in places.split()]
    assert not elsewhere, f"call {places}, {rule}; found {elsewhere}"


def test_percepts_of_a_new_object_count_as_those_of_learned_ones() -> None:
    rng = np.random.default_rng(5)
    counts = rng.integers(0, 6, (3, 2, 2, 4))
    dispersion = rng.uniform(0.1, 50.0, (3, 2, 2))
    posterior = ConfusionPosterior(np.zeros(counts.shape), np.ones(counts.shape), dispersion)
    after = posterior.update(counts).concentration - 1.0
    n = counts.sum(axis=-1, keepdims=True)
    learned = grid.worth_of_percept(n.astype(float), dispersion[..., None]) * counts
    both = "change posterior/grid.py, worth_of_percept, and dirichlet.py, _effective, together"
    np.testing.assert_allclose(after, learned, rtol=1e-12, err_msg=both)


def test_a_table_in_memory_holds_what_its_file_does() -> None:
    fields = {name: np.dtype(kind) for name, kind in _array_fields(PerceptTable)}
    both = (
        "change datasets/levels.py, STORED and BIN_COUNT, and percepts.py, PerceptTable, together"
    )
    assert fields["log_odds"] == STORED, both
    assert fields["training_bins"] == BIN_COUNT, both


def test_the_command_names_the_numbers_of_levels_that_bins_make() -> None:
    (option,) = (option for option in posterior_command.params if option.name == "levels")
    bins = len(BIN_EDGES) + 1
    fitting = [str(k) for k in range(2, bins + 1, 2) if bins % k == 0]
    both = "change datasets/levels.py, BIN_EDGES, and cli/posterior.py, --levels, together"
    assert f"{', '.join(fitting[:-1])} or {fitting[-1]}" in option.help, both
    assert (option.type.min, option.type.max) == (2, bins), both


@pytest.mark.parametrize("levels", [2, 4, 8])
def test_all_take_the_same_levels_for_yes(levels, monkeypatch) -> None:
    rng = np.random.default_rng(levels)
    rows = rng.dirichlet(np.ones(levels))
    # The kernel of plans, in Python: Pr(one percept says yes).
    monkeypatch.setattr(bayes_error, "predictive", observation.predictive)
    monkeypatch.setattr(bayes_error, "_lowest_yes", lowest_yes)
    percepts = SimpleNamespace(rows=rows[None, None, None], precision=np.full((1, 1, 1), np.inf))
    evidence = bayes_error.Evidence(np.zeros((1, 1, levels)), np.zeros(1))
    scratch = SimpleNamespace(evidence=evidence, bins=np.zeros((1, 2)))
    bayes_error._count_yes.py_func(percepts, (0, 0, 0), 1, scratch)
    np.testing.assert_allclose(scratch.bins[0], no_and_yes_of(rows))
    # What a detector says in words.
    toy = load_domain("toy")
    for sure in (-1.0, -0.5, 0.5, 1.0):
        level = detected_levels({toy.attributes[0]: sure}, toy, levels)[0]
        assert yes_of(np.eye(levels)[level]) == (sure > 0)
