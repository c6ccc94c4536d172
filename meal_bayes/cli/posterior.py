"""`posterior`: fit the confusion matrices Theta, check the fit; `export`: a problem they make."""

from pathlib import Path
from typing import Any, TypedDict, Unpack

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.files import check_output, command_line

_R_HAT = 1.01  # above it the chains do not agree
_ESS = 400  # below it the figures are rough
_NAMED = 5  # surprising cases, an object's attribute each, that are named
_FORMATS = ("pomdp", "pomdpx")


class _Fitting(TypedDict):
    """Options of `posterior` that name its draws."""

    dataset: str
    method: str
    model: str
    attributes: str | None
    levels: int
    prior_scale: float
    draws: int
    tune: int
    chains: int
    seed: int


@click.command(short_help="Fit the confusion matrices, check the fit, save and draw it.")
@opt.shared("dataset", "root")
@opt.option(
    "--method",
    click.Choice(["grid", "pymc"]),
    "grid",
    None,
    "Exact quadrature (takes a second), or NUTS (takes minutes).",
)
@opt.option(
    "--model",
    click.Choice(["same", "crossed"]),
    "same",
    None,
    "Model of the grid method, or crossed effects of attributes and behaviors with correlated "
    "errors (pymc only).",
)
@opt.option("--attributes", None, None, "A,B", "The attributes to fit; all by default.")
@opt.option("--levels", click.IntRange(2, 8), 2, "K", "Number of levels of a percept: 2, 4 or 8.")
@opt.option(
    "--prior-scale",
    opt.FiniteRange(0, 1000, min_open=True),
    1.0,
    "F",
    "Weight of the rows' prior, relative to the one learned from the data.",
)
@opt.option(
    "--out", opt.FOLDER, None, "DIR", "Folder of the results; a new one in posteriors/ by default."
)
@opt.option("--draws", click.IntRange(10, 100_000), 1000, None, "Draws of each chain.")
@opt.option(
    "--tune", click.IntRange(10, 1_000_000), 1000, None, "Tuning steps before the draws (pymc)."
)
@opt.option("--chains", click.IntRange(2, 64), 4, None, "Chains of the sampler.")
@opt.option(
    "--jobs",
    click.IntRange(1, 1024),
    None,
    None,
    "Number of chains to sample in parallel (pymc); by default the number of processors.",
)
@opt.option("--seed", opt.SEED, 0, "S", "Equal seeds give equal draws.")
@opt.shared("json")
def posterior(
    root: Path | None,
    out: Path | None,
    jobs: int | None,
    as_json: bool,
    **options: Unpack[_Fitting],
) -> None:
    """Fit the confusion matrices, and how much objects differ.

    The command writes posterior draws (posterior.nc, for ArviZ), a summary of every entry
    (summary.csv), and figures: forest.png, predictive.png, and reliability_each.png and
    reliability_together.png of the beliefs after one behavior and after all.
    """
    from meal_bayes.evaluation.posterior_report import write_posterior
    from meal_bayes.files import check_folder
    from meal_bayes.perception.confusion import percept_counts
    from meal_bayes.posterior.draws import Sampling
    from meal_bayes.posterior.fit import check_method, fit_posterior, named_counts

    check_method(options["method"], options["model"])
    dataset, table = opt.table_of(options["dataset"], root)
    config = {"command": "posterior", **options, "dataset": dataset}
    names = (
        opt.comma_list(options["attributes"]) if options["attributes"] else table.domain.attributes
    )
    # Each attribute once, whatever order and repeats were typed.
    columns = sorted({*table.domain.columns(names)})  # in the order of the domain
    counts = named_counts(
        percept_counts(table, options["levels"])[:, columns],
        objects=table.objects,
        attributes=[table.domain.attributes[p] for p in columns],
        behaviors=table.domain.behavior_names,
    )
    name = f"{Path(dataset).stem}-{options['method']}-{options['model']}-{opt.digest(config)}"
    folder = check_folder(out or Path("posteriors") / name)  # before the work that it is to hold
    sampled = options["method"] == "pymc"
    if sampled:
        terminal.note("the model is compiled first, which takes half a minute or two")
    draws, tune, chains = options["draws"], options["tune"], options["chains"]
    sampling = Sampling(draws, tune, chains, jobs, options["seed"])
    with terminal.progress("NUTS", "steps") as advance:
        fit = fit_posterior(
            counts,
            method=options["method"],
            model=options["model"],
            prior_scale=options["prior_scale"],
            sampling=sampling,
            progress=advance,
        )
    terminal.note("checking the fit ...")
    facts = write_posterior(fit, folder, config)
    if as_json:
        terminal.print_json({"config": config, **facts, "out": str(folder)})
        return
    _print(facts, sampled=sampled)
    terminal.note(f"draws, summary and figures in {folder}")


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
    # Draws of the grid are independent; of NUTS the worst variable decides.
    convergence = "independent, from the grid"
    if sampled:
        worst = max(row["r_hat"] for row in facts["convergence"])
        few = min(min(row["ess_bulk"], row["ess_tail"]) for row in facts["convergence"])
        convergence = f"{facts['divergences']} divergences, R-hat at most {worst:.3f}"
        if facts["divergences"] or not worst < _R_HAT:
            convergence += ": do not trust these draws; give more --tune and --draws"
        elif few < _ESS:
            convergence += f"; few independent draws ({few:.0f}), give more --draws"
    lines = {
        "draws": convergence,
        "predicted": f"{p[1]:.0%} (true) and {p[0]:.0%} (false) of replicates vary as much as the "
        "objects seen; near 0 or 100 % the model does not fit",
        "beliefs": "learned without the object, after one behavior: "
        f"{scores['each']}; after all: {scores['together']}",
    }
    unreliable = sorted(facts["pareto_k"].items(), key=lambda entry: -entry[1])
    if unreliable:
        named = ", ".join(f"{name} ({k:.2f})" for name, k in unreliable[:_NAMED])
        count = f"{len(unreliable)} of the objects' attributes"
        lines["leave one out"] = f"not to be trusted for {count}, by Pareto k: {named}"
    if facts["misperception"] is not None:
        lines["misperceived"] = f"{facts['misperception']:.1%} of objects, by all behaviors alike"
    terminal.output().print()
    terminal.print_facts(terminal.output(), lines)


class _Exporting(TypedDict):
    """Options of `export`."""

    format: str | None
    dataset: str
    root: Path | None
    query: str
    yes_no: bool
    payoffs: tuple[float, float, float, float] | None


@click.command(short_help="Write a query's decision problem for other solvers.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@opt.option(
    "--format",
    click.Choice(_FORMATS),
    None,
    None,
    "Format of the file; by default the ending of FILE. SARSOP reads both, pomdpx better.",
)
@opt.shared("dataset", "root")
@opt.option("--query", None, None, "A,B,...", "The attributes asked, or a question.", required=True)
@opt.shared("yes_no", "payoffs")
def export(file: Path, **options: Unpack[_Exporting]) -> None:
    """Write a query's decision problem to FILE (.pomdp or .pomdpx).

    The problem is that of the paper: percepts are independent given the truth (Eq. 8), and the
    prior is uniform. The confusion matrices are those of held-out classifiers on the recordings of
    the data set. With --yes-no there are two reports, no and yes.
    """
    from meal_bayes.domain import read_question
    from meal_bayes.momdp import Objective, build_momdp, write_pomdp, write_pomdpx
    from meal_bayes.perception.confusion import percept_counts
    from meal_bayes.posterior import ConfusionPosterior

    file_format = options["format"] or file.suffix.removeprefix(".")
    if file_format not in _FORMATS:
        raise click.UsageError(f"{file} ends in neither .pomdp nor .pomdpx; give --format.")
    # Before the work, so that a name that cannot be written is told at once.
    check_output(file, inputs=[options["dataset"]])
    _, table = opt.table_of(options["dataset"], options["root"])
    answer = "yes or no" if options["yes_no"] else "values"
    query = read_question(options["query"], table.domain, answer, options["payoffs"] or None)
    columns = table.domain.columns(query.attributes)
    theta = ConfusionPosterior.from_counts(percept_counts(table, 2))
    rows, precision = theta.select(columns, exact=True)
    momdp = build_momdp(table.domain, query, rows, precision, objective=Objective(abstain=True))
    write = write_pomdp if file_format == "pomdp" else write_pomdpx
    write(momdp, file)
    observations = momdp.levels ** len(momdp.query) + (2 if file_format == "pomdp" else 1)
    terminal.say(
        f"{file}: {momdp.n_states} states, {momdp.n_actions} actions, {observations} observations, "
        f"{file.stat().st_size:,} bytes"
    )
    solution = file.with_suffix(".policy")
    command = command_line("pomdpsol --timeout 5 --output", solution, file)
    terminal.note(f"solve it with SARSOP: {command}")
