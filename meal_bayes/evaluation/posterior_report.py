"""Files about a fitted posterior: draws for ArviZ, a summary of every entry, figures."""

from pathlib import Path
from typing import Any

import numpy as np

from meal_bayes import look
from meal_bayes.arrays import yes_of
from meal_bayes.evaluation import calibration, plots
from meal_bayes.evaluation.statistics import HIGH_QUANTILE, LOW_QUANTILE
from meal_bayes.files import write_whole
from meal_bayes.posterior import checks, idata
from meal_bayes.posterior.draws import rows_of
from meal_bayes.posterior.fit import PosteriorFit, arviz_groups, counted_names
from meal_bayes.seeds import stream


def write_posterior(fit: PosteriorFit, folder: Path, settings: dict[str, object]) -> dict[str, Any]:
    """Write draws, summary and figures of a fit to a folder, and return its checks.

    Parameters
    ----------
    fit : PosteriorFit
        Of `fit_posterior`.
    folder : Path
        Gets posterior.nc, summary.csv, forest.png, predictive.png, reliability_each.png and
        reliability_together.png.
    settings : dict[str, object]
        What made the draws, noted in posterior.nc.

    Returns
    -------
    dict[str, Any]
        `convergence` (R-hat and effective sample sizes by variable), `pareto_k` (of what the
        leave-one-out prediction cannot be trusted for), `divergences`, `misperception` (a fraction
        of objects, or None), `predictive_p` (2,), and `belief`: NLL and ECE of the beliefs after
        one behavior ("each") and after all ("together").
    """
    percepts = fit.counts.values
    check = checks.predictive_check(fit.draws, percepts, stream(fit.seed, "predictive"))
    beliefs = checks.beliefs_without_itself(fit.draws, percepts)
    draws = fit.draws.assign_attrs(idata.attributes_of(settings))
    whole = idata.to_idata(draws, **arviz_groups(fit))
    idata.save_netcdf(whole, folder / "posterior.nc")
    summary = idata.summary_of(whole)
    write_whole(folder / "summary.csv", summary.rename_axis("entry").to_csv())
    look.save(_forest(fit), folder / "forest.png")
    look.save(plots.predictive(check.observed, check.predicted), folder / "predictive.png")
    for name, (positive, truth) in beliefs.items():
        figure = plots.reliability_diagram(positive, truth)
        look.save(figure, folder / f"reliability_{name}.png")
    epsilon = fit.draws.get("misperception")
    return {
        "convergence": idata.convergence(summary).to_dict("records"),
        "pareto_k": idata.unreliable(whole),
        "divergences": int(fit.statistics.get("diverging", np.zeros(1)).sum()),
        "misperception": None if epsilon is None else float(epsilon.mean()),
        "predictive_p": check.p_values.tolist(),
        "belief": {name: _quality(*pair, fit.seed) for name, pair in beliefs.items()},
    }


def _forest(fit: PosteriorFit) -> Any:
    """Draw Pr(yes) of each row, the median and the middle of the draws (`MASS`)."""
    mean, *_ = rows_of(fit.draws)  # (C*S,P,E,2,K)
    low, middle, high = np.quantile(yes_of(mean), [LOW_QUANTILE, 0.5, HIGH_QUANTILE], axis=0)
    attributes = counted_names(fit.counts, "attribute")
    return plots.forest(middle, low, high, attributes, counted_names(fit.counts, "behavior"))


def _quality(positive: Any, truth: Any, seed: int) -> dict[str, float]:
    """Score beliefs (n,) by the truths; the last score is what calibrated ones would get."""
    return {
        "nll": float(calibration.negative_log_likelihood(positive, truth).mean()),
        "ece": calibration.calibration_error(positive, truth),
        "ece_calibrated": calibration.calibrated_error(positive, seed),
    }
