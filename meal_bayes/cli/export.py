"""`meal-bayes export`: the decision problem of a query as a file for other solvers."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.options import dataset_option, json_option, table_of
from meal_bayes.cli.screen import note

if TYPE_CHECKING:
    from meal_bayes.datasets import PerceptTable
    from meal_bayes.momdp import MOMDP
    from meal_bayes.perception import ConfusionCounts

_FORMATS = ("pomdp", "pomdpx")


@click.command(short_help="Write a query's decision problem for other solvers.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--format", "kind", type=click.Choice(_FORMATS),
    help="What FILE's name ends in, by default. SARSOP reads both, pomdpx better.",
)  # fmt: skip
@dataset_option
@click.option("--query", "question", metavar="A,B,...", help="The attributes asked.")
@click.option(
    "--object", "name", metavar="NAME",
    help="Learn without this object, as for a trial about it; from all by default.",
)  # fmt: skip
@click.option(
    "--discount", type=click.FloatRange(0, 1, min_open=True), metavar="G", help="Of a step.  [0.99]"
)
@click.option(
    "--reward", type=click.FloatRange(min=0, min_open=True), metavar="R",
    help="For a right report, and taken for a wrong one; the data set's by default.",
)  # fmt: skip
@click.option(
    "--forbid-illegal", is_flag=True,
    help="Price illegal behaviors below every report, so that no solver takes one.",
)  # fmt: skip
@click.option(
    "--model", metavar="NAME", help="A reference model (A1 to A5) in place of a data set's query."
)
@click.option(
    "--reference", metavar="DIR",
    help="Folder of the reference models; MEAL_BAYES_REFERENCE by default.",
)  # fmt: skip
@json_option
def export(
    file: Path,
    kind: str | None,
    dataset: str,
    root: Path | None,
    question: str | None,
    name: str | None,
    discount: float | None,
    reward: float | None,
    forbid_illegal: bool,
    model: str | None,
    reference: str | None,
    as_json: bool,
) -> None:
    """Write a query's decision problem to FILE (.pomdp or .pomdpx).

    It is the paper's (Eq. 8: percepts independent given the truth, uniform prior), with the
    confusion matrices that held-out classifiers showed on the data set's recordings.
    """
    from meal_bayes.momdp.pomdp_file import write_pomdp
    from meal_bayes.momdp.pomdpx_file import write_pomdpx

    kind = kind or file.suffix.removeprefix(".")
    if kind not in _FORMATS:
        raise click.UsageError(f"{file} ends in neither .pomdp nor .pomdpx; give --format.")
    if (model is None) == (question is None):
        raise click.UsageError("Give either --query (of a data set) or --model (a reference).")
    if model is not None and name is not None:
        raise click.UsageError("A reference model knows no objects; leave --object out.")
    if model is None and reference is not None:
        raise click.UsageError("--reference goes with --model; leave it out, or name a model.")
    momdp = (
        _query(table_of(dataset, root), question, name)
        if question
        else _reference(reference, str(model))
    )
    if discount is not None:
        momdp = replace(momdp, discount=discount)
    if reward is not None:
        momdp = replace(momdp, correct=reward, incorrect=-reward)
    write = write_pomdp if kind == "pomdp" else write_pomdpx
    write(momdp, file, forbid_illegal=forbid_illegal)
    facts = {
        "file": str(file),
        "format": kind,
        "attributes": list(momdp.query.attributes),
        "states": momdp.n_states,
        "actions": momdp.n_actions,
        "observations": momdp.levels ** len(momdp.query) + (2 if kind == "pomdp" else 1),
        "bytes": file.stat().st_size,
    }
    if as_json:
        click.echo(json.dumps(facts))
        return
    click.echo(
        f"{file}: {facts['states']} states, {facts['actions']} actions, "
        f"{facts['observations']} observations, {facts['bytes']:,} bytes"
    )
    note(f"solve it with SARSOP: pomdpsol --timeout 5 --output {file.stem}.policy {file.name}")


def _reference(folder: str | None, name: str) -> "MOMDP":
    from meal_bayes.domain import unknown
    from meal_bayes.errors import SettingsError
    from meal_bayes.momdp.reference import load_reference

    models = load_reference(folder)
    if name not in models:
        raise SettingsError(unknown("reference model", name, models))
    return models[name]


def _query(dataset: str, question: str, name: str | None) -> "MOMDP":
    """Build the paper's problem of a query, from all objects or all but one."""
    from meal_bayes.datasets import load_percepts, object_index
    from meal_bayes.domain import read_query
    from meal_bayes.momdp import build_momdp
    from meal_bayes.perception import table_counts
    from meal_bayes.posterior import ConfusionPosterior

    table = load_percepts(dataset)
    query = read_query(question, table.domain)
    if name is None:
        counts = _held_out_counts(table)
    else:
        counts = table_counts(table, object_index(table.objects, name))
    columns = [table.domain.attribute_index(attribute) for attribute in query.attributes]
    confusion, precision = ConfusionPosterior.from_counts(counts).select(columns, exact=True)
    return build_momdp(table.domain, query, confusion, precision, abstain=True)


def _held_out_counts(table: "PerceptTable") -> "ConfusionCounts":
    """Count each object's percepts by classifiers that never saw it."""
    import numpy as np

    from meal_bayes.perception.confusion import by_truth

    levels = table.levels_of(table.log_odds, 2)  # (O,R,E,P)
    known = ~np.isnan(table.log_odds)
    counts = np.stack([((levels == level) & known).sum(axis=1) for level in range(2)], axis=-1)
    return by_truth(counts.transpose(0, 2, 1, 3).astype(np.int64), table.labels)
