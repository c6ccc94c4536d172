"""A classifier of one's own perceives: any of scikit-learn's, left out object by object by us.

    python examples/own_classifier.py
    meal-bayes data percepts --dataset kitchen.toml --root recordings \
        --classifier sklearn.ensemble:RandomForestClassifier --out kitchen.npz

Made-up recordings stand in for a robot's. What is learned never saw the object it is asked about:
neither the classifier, nor what calibrates it.
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
    """Compare three classifiers on objects that they never saw, and ask with the last."""
    rng = np.random.default_rng(0)
    domain = mb.load_domain("toy")
    recordings = make_synthetic(domain, objects=objects, recordings=3, signal=6.0, rng=rng)
    print(f"{'base':<10} log-loss {np.log(2):.3f}")  # of saying nothing
    for name, classifier in CLASSIFIERS.items():
        table = mb.build_percept_table(recordings, classifier=classifier)
        right = np.where(table.labels == 1, 1, -1)[:, None, None] * table.log_odds
        loss = np.logaddexp(0, -right[np.isfinite(right)]).mean()
        print(f"{name:<10} log-loss {loss:.3f}")
    trial = mb.ask("Is it red?", dataset=table, object=table.objects[0], agent="greedy")
    print(trial)


if __name__ == "__main__":
    main()
