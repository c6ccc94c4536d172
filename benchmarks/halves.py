"""What beliefs are worth about objects of which nothing was learned: halves of the objects.

    python benchmarks/halves.py cy101,ispy32,roc36 [--json] > now.json
    python benchmarks/halves.py compare before.json now.json

The objects of a data set are split in halves, 20 times. Classifiers, confusion matrices, trait and
base rates are learned from one half, and the beliefs of `bayes` about all asked attributes of the
other half are judged: after one recording of one behavior, one of each behavior, and all of all.
Objects that are left out one at a time (`calibration.py`) share nearly all training objects, so
that what is learned changes with the object that is left out; halves do not have this fault.

The gap is the probability of the likelier answer less how often it is right. Intervals are 95 %,
over splits (corrected resampled t). `compare` pairs two versions by split: run it in two checkouts
(PYTHONPATH).
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from knowing_little import first_objects
from measuring import options_of, show
from numpy.typing import NDArray

from meal_bayes import load_dataset, load_percepts
from meal_bayes.agents.knowledge import Knowledge, knowledge_of
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.evaluation.statistics import resampled
from meal_bayes.experiments import askable
from meal_bayes.perception import Perception, fit_and_validate, fit_spaces
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.posterior.checks import log_likelihood
from meal_bayes.posterior.trait import truth_evidence
from meal_bayes.seeds import stream

SPLITS = 20
SEED = 9931
LEVELS = 4
KINDS = ("one of one", "one of each", "all of all")
Row = dict[str, Any]


def measure(name: str, split: int) -> list[Row]:
    """Measure one split: a row for each kind of evidence."""
    start = time.process_time()
    data = load_dataset(name)
    columns = data.domain.columns(askable(load_percepts(name)))
    order = stream(SEED, "halves", name, split).permutation(len(data.objects))
    half = first_objects(data, order[: len(order) // 2])
    training = TrainingSet.everything(half)
    spaces = fit_spaces(half, training, whiten=True)
    settings = PerceptionSettings(levels=LEVELS)
    perception, counts = fit_and_validate(half, training, settings=settings, spaces=spaces)
    knowledge = knowledge_of(data.domain, counts, half.labels)
    found: dict[str, list[NDArray[np.float64]]] = {kind: [] for kind in KINDS}
    for o in order[len(order) // 2 :].tolist():
        truth = data.labels[o, columns]
        shown = percepts(data, perception, o)[:, columns]  # (R,P,E,K)
        for kind, odds in log_odds(knowledge, columns, shown).items():
            yes = 1 / (1 + np.exp(-odds[:, truth >= 0]))
            found[kind].append(np.stack([yes, np.broadcast_to(truth[truth >= 0] == 1, yes.shape)]))
    rows = []
    for kind, parts in found.items():
        # Objects weigh alike.
        gaps, losses = zip(*map(judged, parts), strict=True)
        rows.append(
            {"data": name, "evidence": kind, "split": split}
            | {"gap": float(np.mean(gaps)), "nll": float(np.mean(losses))}
            | {"cpu": time.process_time() - start}
        )
    return rows


def percepts(data: Dataset, perception: Perception, o: int) -> NDArray[np.int64]:
    """Return what one object showed in each recording, (R,P,E,K); zeros where nothing was."""
    table = load_percepts(data.domain.data)
    shape = data.recordings, len(data.domain.attributes), len(data.domain.behaviors), LEVELS
    shown = np.zeros(shape, np.int64)
    for e, behavior in enumerate(data.domain.behaviors):
        if behavior.name not in perception.classifiers:
            continue
        n = int(data.recording_counts[o, e])
        features = {m: data.features[behavior.name, m][o, :n] for m in behavior.modalities}
        classifier = perception.classifiers[behavior.name]
        # Percept tables keep half precision.
        level = table.levels_of(classifier.log_odds(features).astype(np.float16), LEVELS)
        shown[:n, :, e] = level[..., None] == np.arange(LEVELS)
    return shown


def log_odds(
    knowledge: Knowledge, columns: list[int], shown: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    """Return beliefs (S,P) of each kind of evidence, in S cases."""
    assert knowledge.trait is not None
    rows, precision = knowledge.trait.select(*knowledge.posterior.select(columns))
    log_classes = np.log(np.maximum(knowledge.trait.latent_classes, 1e-300))
    rates = knowledge.base_rates[columns]

    def evidence(counts: NDArray[np.int64]) -> NDArray[np.float64]:
        each = [
            log_likelihood(counts.astype(float), rows[:, :, c], precision[:, :, c])
            for c in range(log_classes.shape[1])
        ]
        return np.stack(each, axis=-1)  # (S,P,E,C)

    single = evidence(shown)
    one = np.moveaxis(single, 2, 1).reshape(-1, *single[:, :, 0].shape[1:])  # (R x E,P,C)
    seen = shown.any(axis=(1, 3)).ravel()  # behaviors without features show nothing
    cases = (one[seen], single.sum(axis=2), evidence(shown.sum(axis=0)[None]).sum(axis=2))
    prior = np.log(rates) - np.log1p(-rates)
    return {
        kind: prior + truth_evidence(case, log_classes)
        for kind, case in zip(KINDS, cases, strict=True)
    }


def judged(part: NDArray[np.float64]) -> tuple[float, float]:
    """Return the gap and the log-loss of beliefs and truths (2,S,P) of one object."""
    yes, truth = part
    said = np.maximum(yes, 1 - yes)
    right = (yes > 0.5) == (truth == 1)
    loss = -np.log(np.where(truth == 1, yes, 1 - yes))
    return float((said - right).mean()), float(loss.mean())


def summed(rows: list[Row], before: list[Row] | None = None) -> list[Row]:
    """Sum up splits, or the differences of two versions, by the splits that both have."""
    was = {(row["data"], row["evidence"], row["split"]): row for row in before or []}
    cells: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for row in rows:
        earlier: Row | None = {"gap": 0.0, "nll": 0.0}
        if before is not None:
            earlier = was.get((row["data"], row["evidence"], row["split"]))
        if earlier is None:
            continue
        values = row["gap"] - earlier["gap"], row["nll"] - earlier["nll"]
        cells.setdefault((row["data"], row["evidence"]), []).append(values)
    table = []
    for (data, evidence), differences in cells.items():
        line: Row = {"data": data, "evidence": evidence, "splits": len(differences)}
        for measure_, column in zip(("gap", "nll"), np.transpose(differences), strict=True):
            # As many objects are judged as taught.
            found = resampled(column, 1.0).interval()
            line[measure_] = f"{found.estimate:+.4f} [{found.low:+.4f}, {found.high:+.4f}]"
        table.append(line)
    return table


def main() -> None:
    """Measure the splits, or compare two runs, and print a table, or JSON."""
    parser = options_of(__doc__)
    parser.add_argument("data", help="names of data sets with commas between, or compare")
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--splits", type=int, default=SPLITS)
    options = parser.parse_args()
    if options.data == "compare":
        before, now = (json.loads(path.read_text("utf-8")) for path in options.files)
        show(summed(now, before))
        return
    rows = []
    for name in options.data.split(","):
        for split in range(options.splits):
            rows += measure(name, split)
    show(summed(rows), rows if options.json else None)


if __name__ == "__main__":
    main()
