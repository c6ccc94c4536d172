"""`meal-bayes export`: the decision problem of a query as a file for other solvers."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli.console import note, say
from meal_bayes.cli.options import option, shared, table_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from meal_bayes.datasets import PerceptTable

_FORMATS = ("pomdp", "pomdpx")


@click.command(short_help="Write a query's decision problem for other solvers.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@option(
    "--format", click.Choice(_FORMATS), None, None,
    "What FILE's name ends in, by default. SARSOP reads both, pomdpx better.",
)  # fmt: skip
@shared("dataset", "root")
@option("--query", None, None, "A,B,...", "The attributes asked.", required=True)
def export(file: Path, **options: Any) -> None:
    """Write a query's decision problem to FILE (.pomdp or .pomdpx).

    It is the paper's (Eq. 8: percepts independent given the truth, uniform prior), with the
    confusion matrices that held-out classifiers showed on the data set's recordings.
    """
    from meal_bayes.datasets import load_percepts
    from meal_bayes.domain import read_query
    from meal_bayes.files import check_output
    from meal_bayes.momdp import Objective, build_momdp, write_pomdp, write_pomdpx
    from meal_bayes.posterior import ConfusionPosterior

    kind = options["format"] or file.suffix.removeprefix(".")
    if kind not in _FORMATS:
        raise click.UsageError(f"{file} ends in neither .pomdp nor .pomdpx; give --format.")
    check_output(file, inputs=[options["dataset"]])
    table = load_percepts(table_of(options["dataset"], options["root"]))
    query = read_query(options["query"], table.domain)
    columns = table.domain.columns(query.attributes)
    theta = ConfusionPosterior.from_counts(percept_counts(table, 2))
    rows, precision = theta.select(columns, exact=True)
    momdp = build_momdp(table.domain, query, rows, precision, objective=Objective(abstain=True))
    write = write_pomdp if kind == "pomdp" else write_pomdpx
    write(momdp, file)
    observations = momdp.levels ** len(momdp.query) + (2 if kind == "pomdp" else 1)
    say(
        f"{file}: {momdp.n_states} states, {momdp.n_actions} actions, {observations} observations, "
        f"{file.stat().st_size:,} bytes"
    )
    note(f"solve it with SARSOP: pomdpsol --timeout 5 --output {file.stem}.policy {file.name}")


def percept_counts(table: "PerceptTable", levels: int) -> "NDArray[Any]":
    """Count each object's percepts by classifiers that never saw it."""
    import numpy as np

    from meal_bayes.perception.confusion import by_truth

    level = table.levels_of(table.log_odds, levels)  # (O,R,E,P)
    shown = (level[..., None] == np.arange(levels)) & ~np.isnan(table.log_odds)[..., None]
    return by_truth(shown.sum(axis=1).swapaxes(1, 2), table.labels)
