"""Compare scikit-learn classifiers with those of the package, on held-out objects.

    python examples/own_classifier.py
    meal-bayes data percepts --dataset kitchen.toml --root recordings \
        --classifier sklearn.ensemble:RandomForestClassifier --out kitchen.npz

The recordings are synthetic. Neither the classifier nor its calibration was trained on the object
in the question.
"""

import numpy as np
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import meal_bayes as mb
from meal_bayes.datasets import make_synthetic

CLASSIFIERS = {
    "ours": None,
    "forest": RandomForestClassifier(50),
    "logistic": make_pipeline(StandardScaler(), LogisticRegression()),
}


def main(objects: int = 40) -> None:
    """Compare three classifiers on held-out objects, and ask a question with the last one."""
    rng = np.random.default_rng(0)
    domain = mb.load_domain("toy")
    recordings = make_synthetic(domain, objects=objects, recordings=3, signal=6.0, rng=rng)
    print(f"{'base':<10} log-loss {np.log(2):.3f}")  # of always predicting one half
    for name, classifier in CLASSIFIERS.items():
        table = mb.build_percept_table(recordings, classifier=classifier)
        right = np.where(table.labels == 1, 1, -1)[:, None, None] * table.log_odds
        loss = np.logaddexp(0, -right[np.isfinite(right)]).mean()
        print(f"{name:<10} log-loss {loss:.3f}")
    trial = mb.ask("Is it red?", dataset=table, object=table.objects[0], agent="greedy")
    print(trial)


if __name__ == "__main__":
    main()
