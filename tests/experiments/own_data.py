"""A small data set of one's own, on disk: the toy domain with made-up recordings."""

from importlib import resources
from pathlib import Path

import numpy as np

from meal_bayes.datasets.synthetic import make_synthetic_model
from meal_bayes.domain import load_domain

OBJECTS, RECORDINGS = 24, 3


def write_own_data(folder: Path, *, signal: float = 3.0) -> Path:
    """Write recordings and labels as CSV, and give the path of the domain's table."""
    text = (resources.files("meal_bayes") / "domain/tables/toy.toml").read_text(encoding="utf-8")
    path = folder / "own.toml"
    path.write_text(text.replace('name = "toy"', 'name = "own"'), encoding="utf-8")
    rng = np.random.default_rng(5)
    model = make_synthetic_model(load_domain(path), objects=OBJECTS, rng=rng, signal=signal)
    dataset = model.record(RECORDINGS, rng)
    rows = zip(dataset.objects, dataset.labels.tolist(), strict=True)
    lines = [f"{name},{','.join(map(str, values))}" for name, values in rows]
    header = ",".join(("object", *dataset.domain.attributes))
    (folder / "labels.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    for (behavior, modality), values in dataset.features.items():
        names = ",".join(f"f{i}" for i in range(values.shape[2]))
        lines = [f"object,recording,{names}"]
        for o, name in enumerate(dataset.objects):
            for r in range(RECORDINGS):
                lines.append(f"{name},{r + 1}," + ",".join(map(repr, values[o, r].tolist())))
        (folder / f"{behavior}_{modality}.csv").write_text("\n".join(lines) + "\n")
    return path
