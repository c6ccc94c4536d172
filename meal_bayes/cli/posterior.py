"""`posterior`: fit the confusion matrices Theta, check the fit; `export`: a problem they make."""

from collections.abc import Sequence
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from meal_bayes.datasets import PerceptTable

_R_HAT = 1.01  # above it the chains do not agree
_ESS = 400  # below it the figures are rough
_NAMED = 5  # surprising objects
_FORMATS = ("pomdp", "pomdpx")


@click.command(short_help="Fit the confusion matrices, check the fit, save and draw it.")
@opt.shared("dataset", "root")
@opt.option(
    "--method", click.Choice(["grid", "pymc"]), "grid", None,
    "Exact quadrature in a second, or NUTS in minutes.",
)  # fmt: skip
@opt.option(
    "--model", click.Choice(["same", "crossed"]), "same", None,
    "The grid's, or attributes crossed with behaviors that err together (pymc only).",
)  # fmt: skip
@opt.option("--attributes", None, None, "A,B", "The attributes to fit; all by default.")
@opt.option("--levels", click.IntRange(2, 8), 2, "K", "Of a percept: 2, 4 or 8.")
@opt.option(
    "--prior-scale", click.FloatRange(0, 1000, min_open=True), 1.0, "F",
    "Weight of the prior of the rows, of that which is learned from the data.",
)  # fmt: skip
@opt.option(
    "--out", opt.FOLDER, None, "DIR", "Folder of what is written; one in posteriors/ by default."
)
@opt.option("--draws", click.IntRange(10, 100_000), 1000, None, "Of each chain.")
@opt.option("--tune", click.IntRange(10, 1_000_000), 1000, None, "Steps before them (pymc).")
@opt.option("--chains", click.IntRange(2, 64), 4, None, "Of the sampler.")
@opt.option("--seed", opt.SEED, 0, "S", "Equal seeds give equal draws.")
@opt.shared("json")
def posterior(root: Path | None, out: Path | None, as_json: bool, **options: Any) -> None:
    """Fit how likely each percept is of true and of false objects, and how far objects differ.

    Writes the draws (posterior.nc, for ArviZ), a summary of every entry (summary.csv), and
    figures: forest.png, predictive.png, and reliability_each.png and reliability_together.png of
    the beliefs after one behavior and after all.
    """
    from meal_bayes.errors import SettingsError
    from meal_bayes.files import check_folder
    from meal_bayes.posterior.draws import rows_of, sensing
    from meal_bayes.posterior.grid import prior_of

    if options["method"] == "grid" and options["model"] != "same":
        raise SettingsError("--model crossed needs --method pymc: no grid can hold it.")
    dataset, table = opt.table_of(options["dataset"], root)
    config = {"command": "posterior", **options, "dataset": dataset}
    levels = config["levels"]
    names = opt.listed(config["attributes"]) if config["attributes"] else table.domain.attributes
    columns = sorted({*table.domain.columns(names)})
    counts = percept_counts(table, levels)[:, columns]  # (O,P,E',2,K)
    senses = sensing(counts)
    percepts = counts[:, :, senses]
    behaviors = [*compress(table.domain.behavior_names, senses)]
    name = f"{Path(dataset).stem}-{config['method']}-{config['model']}-{opt.digest(config)}"
    folder = check_folder(out or Path("posteriors") / name)
    prior = config["prior_scale"] * prior_of(percepts)
    attributes = [table.domain.attributes[p] for p in columns]
    draws, statistics = _fit(percepts, attributes, behaviors, prior, config)
    mean, *_ = rows_of(draws)
    yes = mean[..., levels // 2 :].sum(axis=-1)  # Pr(yes) of each row, (C*S,P,E,2)
    facts = _write(draws, statistics, yes, percepts, prior, table.objects, config, folder)
    if as_json:
        terminal.print_json({"config": config, **facts, "out": str(folder)})
        return
    _print(facts, sampled=bool(statistics))
    terminal.note(f"draws, summary and figures in {folder}")


def _fit(
    counts: "NDArray[Any]", attributes: list[str], behaviors: Sequence[str],
    prior: "NDArray[Any]", config: dict[str, Any],
) -> "tuple[xr.Dataset, xr.Dataset]":  # fmt: skip
    """Return the draws, and the sampler's statistics, which the grid has none of."""
    import xarray as xr

    from meal_bayes.posterior.draws import draw_grid
    from meal_bayes.seeds import stream

    named: dict[str, Any] = {"attributes": attributes, "behaviors": behaviors, "prior": prior}
    draws = config["draws"]
    chains = config["chains"]
    seed = config["seed"]
    if config["method"] == "grid":
        rng = stream(seed, "posterior")
        return draw_grid(counts, rng, **named, draws=draws, chains=chains), xr.Dataset()
    terminal.note("the model is compiled first, which takes half a minute or two")
    from meal_bayes.posterior.hierarchical import Sampling, fit_hierarchical

    with terminal.progress("NUTS", "steps") as advance:
        sampling = Sampling(draws, config["tune"], chains, seed=seed)
        return fit_hierarchical(
            counts, **named, model=config["model"], sampling=sampling, progress=advance
        )


def _write(
    draws: "xr.Dataset", statistics: "xr.Dataset", yes: "NDArray[Any]", counts: "NDArray[Any]",
    prior: "NDArray[Any]", objects: tuple[str, ...], config: dict[str, Any], folder: Path,
) -> dict[str, Any]:  # fmt: skip
    """Write draws, summary and figures, and return the checks of the fit."""
    import numpy as np

    from meal_bayes.evaluation import calibration, canvas, plots
    from meal_bayes.files import write_whole
    from meal_bayes.posterior import checks, idata
    from meal_bayes.seeds import stream

    seed = config["seed"]
    attributes, behaviors = (draws[dim].values.tolist() for dim in ("attribute", "behavior"))
    terminal.note("checking the fit ...")
    check = checks.predictive_check(draws, counts, stream(seed, "predictive"))
    beliefs = checks.beliefs_without_itself(draws, counts)
    groups = _groups(draws, counts, prior, objects, config)
    if statistics:
        groups["sample_stats"] = statistics
    made = idata.to_idata(draws.assign_attrs(idata.attributes_of(config)), **groups)
    idata.save_netcdf(made, folder / "posterior.nc")
    summary = idata.summary_of(made)
    write_whole(folder / "summary.csv", summary.to_csv())
    low, middle, high = np.quantile(yes, [0.025, 0.5, 0.975], axis=0)
    canvas.save(plots.forest(middle, low, high, attributes, behaviors), folder / "forest.png")
    canvas.save(plots.predictive(check.observed, check.predicted), folder / "predictive.png")
    quality = {}
    for name, pair in beliefs.items():
        canvas.save(plots.reliability_diagram(*pair), folder / f"reliability_{name}.png")
        rng = stream(seed, "calibrated belief")
        quality[name] = {
            "nll": float(calibration.negative_log_likelihood(*pair).mean()),
            "ece": calibration.calibration_error(*pair),
            "ece_calibrated": calibration.expected_calibration_error(pair[0], rng),
        }
    epsilon = draws.get("misperception")
    return {
        "convergence": idata.convergence(summary).to_dict("records"),
        "pareto_k": idata.unreliable(made),
        "divergences": int(statistics.get("diverging", np.zeros(1)).sum()),
        "misperception": None if epsilon is None else float(epsilon.mean()),
        "predictive_p": check.p_values.tolist(),
        "belief": quality,
    }


def _groups(
    draws: "xr.Dataset", counts: "NDArray[Any]", prior: "NDArray[Any]", objects: tuple[str, ...],
    config: dict[str, Any],
) -> dict[str, "xr.Dataset"]:  # fmt: skip
    """Return the groups of InferenceData beside the draws: data, predictions, likelihood, prior."""
    import xarray as xr

    from meal_bayes.posterior import checks
    from meal_bayes.posterior.draws import ROW, draw_prior, log_prior
    from meal_bayes.seeds import stream

    seed = config["seed"]
    units = checks.units_of(counts, objects, draws["attribute"].values.tolist())
    shown = xr.DataArray(
        counts, {"object": list(objects)} | {dim: draws[dim].values for dim in (*ROW, "level")}
    )
    groups = {
        "observed_data": xr.Dataset({"yes": units.yes}),
        "constant_data": xr.Dataset({"counts": shown}),
        "posterior_predictive": checks.predict_yes(draws, units, stream(seed, "units")),
        "log_likelihood": checks.pointwise_log_likelihood(draws, units),
    }
    if config["model"] == "same":
        before = draw_prior(draws, prior, stream(seed, "prior"))
        groups |= {
            "prior": before,
            "prior_predictive": checks.predict_yes(before, units, stream(seed, "unseen")),
            "log_prior": log_prior(draws, prior),
        }
    return groups


def _print(facts: dict[str, Any], *, sampled: bool) -> None:
    columns = {
        "variable": "{variable}", "entries": "{entries}", "R-hat": "{r_hat:.3f}",
        "ESS bulk": "{ess_bulk:.0f}", "ESS tail": "{ess_tail:.0f}",
    }  # fmt: skip
    terminal.print_table(columns, facts["convergence"])
    p = facts["predictive_p"]
    scores = {
        name: "NLL {nll:.3f}, ECE {ece:.3f} ({ece_calibrated:.3f} if calibrated)".format(**quality)
        for name, quality in facts["belief"].items()
    }
    convergence = "independent, from the grid"
    if sampled:
        worst = max(row["r_hat"] for row in facts["convergence"])
        few = min(min(row["ess_bulk"], row["ess_tail"]) for row in facts["convergence"])
        convergence = f"{facts['divergences']} divergences, R-hat at most {worst:.3f}"
        if facts["divergences"] or not worst < _R_HAT:
            convergence += ": do not trust these draws; give more --tune and --draws"
        elif few < _ESS:
            convergence += f"; few independent draws ({few:.0f}), give more --draws"
    shown = {
        "draws": convergence,
        "predicted": f"{p[1]:.0%} (true) and {p[0]:.0%} (false) of replicates vary as much as the "
        "objects seen; near 0 or 100 % the model does not fit",
        "beliefs": "learned without the object, after one behavior: "
        f"{scores['each']}; after all: {scores['together']}",
    }
    if unreliable := sorted(facts["pareto_k"].items(), key=lambda unit: -unit[1]):
        named = ", ".join(f"{name} ({k:.2f})" for name, k in unreliable[:_NAMED])
        count = f"{len(unreliable)} of the objects' attributes"
        shown["leave one out"] = f"not to be trusted for {count}, by Pareto k: {named}"
    if facts["misperception"] is not None:
        shown["misperceived"] = f"{facts['misperception']:.1%} of objects, by all behaviors alike"
    terminal.output().print()
    terminal.print_facts(terminal.output(), shown)


@click.command(short_help="Write a query's decision problem for other solvers.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@opt.option(
    "--format", click.Choice(_FORMATS), None, None,
    "What FILE's name ends in, by default. SARSOP reads both, pomdpx better.",
)  # fmt: skip
@opt.shared("dataset", "root")
@opt.option("--query", None, None, "A,B,...", "The attributes asked.", required=True)
def export(file: Path, **options: Any) -> None:
    """Write a query's decision problem to FILE (.pomdp or .pomdpx).

    It is the paper's (Eq. 8: percepts independent given the truth, uniform prior), with the
    confusion matrices that held-out classifiers showed on the data set's recordings.
    """
    from meal_bayes.domain import read_query
    from meal_bayes.files import check_output
    from meal_bayes.momdp import Objective, build_momdp, write_pomdp, write_pomdpx
    from meal_bayes.posterior import ConfusionPosterior

    kind = options["format"] or file.suffix.removeprefix(".")
    if kind not in _FORMATS:
        raise click.UsageError(f"{file} ends in neither .pomdp nor .pomdpx; give --format.")
    check_output(file, inputs=[options["dataset"]])
    _, table = opt.table_of(options["dataset"], options["root"])
    query = read_query(options["query"], table.domain)
    columns = table.domain.columns(query.attributes)
    theta = ConfusionPosterior.from_counts(percept_counts(table, 2))
    rows, precision = theta.select(columns, exact=True)
    momdp = build_momdp(table.domain, query, rows, precision, objective=Objective(abstain=True))
    write = write_pomdp if kind == "pomdp" else write_pomdpx
    write(momdp, file)
    observations = momdp.levels ** len(momdp.query) + (2 if kind == "pomdp" else 1)
    terminal.say(
        f"{file}: {momdp.n_states} states, {momdp.n_actions} actions, {observations} observations, "
        f"{file.stat().st_size:,} bytes"
    )
    terminal.note(
        f"solve it with SARSOP: pomdpsol --timeout 5 --output {file.stem}.policy {file.name}"
    )


def percept_counts(table: "PerceptTable", levels: int) -> "NDArray[Any]":
    """Count each object's percepts by classifiers that never saw it."""
    import numpy as np

    from meal_bayes.perception.confusion import by_truth

    level = table.levels_of(table.log_odds, levels)  # (O,R,E,P)
    shown = (level[..., None] == np.arange(levels)) & ~np.isnan(table.log_odds)[..., None]
    return by_truth(shown.sum(axis=1).swapaxes(1, 2), table.labels)
