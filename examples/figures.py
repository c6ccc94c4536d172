"""Draw figures of an experiment from data frames, with pandas and with the package's plots.

    python examples/figures.py

The program writes figures/cost.png (fraction of trials up to each cost), figures/accuracy.png (by
attribute) and figures/calibration.png (how well calibrated the beliefs are).
"""

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

import meal_bayes as mb
from meal_bayes.evaluation.plots import cost_distribution, reliability_diagram
from meal_bayes.look import save

AGENTS = ("random_legal", "predefined_plus", "greedy")


def main(trials: int = 60, folder: str | Path = "figures", logs: str | Path = "logs") -> None:
    """Run three agents on the same queries about ROC36's objects, and draw the results."""
    config = mb.OfflineConfig("roc36", attributes=2, trials=trials, agents=AGENTS)
    run = mb.run_offline(config, logs=logs)
    print(mb.summarize(run.trials()).to_frame()[["agent", "accuracy", "cost_s", "reward"]])

    frame = run.to_frame()  # a row a trial
    by_agent = frame.groupby("agent", sort=False)
    save(cost_distribution(dict(iter(by_agent["cost_s"]))), Path(folder) / "cost.png")

    words = frame.assign(attribute=frame["query"].str.split(", ")).explode("attribute")
    table = words.pivot_table("success", "attribute", "agent", aggfunc="mean").astype(float)
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.add_subplot()
    table[list(AGENTS)].plot.bar(ax=axes, ylabel="accuracy", xlabel="", rot=30)
    axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
    figure.savefig(Path(folder) / "accuracy.png", dpi=150)

    beliefs = pd.DataFrame(
        {"belief": trial.last_belief.positive, "truth": trial.truth == 1} for trial in run.trials()
    ).explode(["belief", "truth"])
    axes = reliability_diagram(beliefs["belief"], beliefs["truth"])
    save(axes, Path(folder) / "calibration.png")


if __name__ == "__main__":
    main()
