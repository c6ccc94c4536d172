"""One sound file of every kind that the package reads, for the benchmarks that damage them."""

from importlib import resources
from pathlib import Path

import numpy as np

from meal_bayes.datasets import load_percepts, make_synthetic
from meal_bayes.datasets.csv_files import save_csv_folder
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable, save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.experiments import offline_tasks
from meal_bayes.learner import Learner
from meal_bayes.trial_log import write_trials
from meal_bayes.trials import TrialOutcomes

FILES = {  # kind: the file that is damaged
    "log": "run.mcap",
    "outcomes": "outcomes.mcap",
    "table": "own.npz",
    "csv": "look_color.csv",
    "labels": "labels.csv",
    "toml": "own.toml",
}
OBJECTS = 6
RECORDINGS = 3
TRIALS = 6


def make_sound(folder: Path) -> None:
    """Write one sound file of every kind."""
    shipped = resources.files("meal_bayes") / "domain/tables/toy.toml"
    text = shipped.read_text(encoding="utf-8").replace('name = "toy"', 'name = "own"')
    (folder / FILES["toml"]).write_text(text, encoding="utf-8")
    domain = load_domain(folder / FILES["toml"])
    rng = np.random.default_rng(5)
    dataset = make_synthetic(domain, objects=OBJECTS, recordings=RECORDINGS, rng=rng)
    save_csv_folder(dataset, folder)
    shape = (OBJECTS, RECORDINGS, len(domain.behaviors), len(domain.attributes))
    bins = np.zeros((OBJECTS, OBJECTS, shape[3], shape[2], len(BIN_EDGES) + 1), np.uint8)
    odds = rng.normal(0, 2, shape)
    percepts = PerceptTable(
        domain,
        dataset.objects,
        dataset.labels,
        log_odds=odds,
        edges=BIN_EDGES,
        training_bins=bins,
        provenance={},
    )
    save_percepts(percepts, folder / FILES["table"])
    learner = Learner("roc36", agent="greedy", logs=None).fit(load_percepts("roc36"))
    tasks = offline_tasks(load_percepts("roc36"), 2, TRIALS, 0)
    trials = [learner.ask(task) for task in tasks]
    header = {"config": {"dataset": "roc36"}}
    write_trials(folder / FILES["log"], trials, header=header)
    write_trials(folder / FILES["outcomes"], [TrialOutcomes.of(trials)], header=header)
