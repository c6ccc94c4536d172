"""`meal-bayes data`: list and fetch recordings, compute percept tables."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.program import UNSOUND, Section

if TYPE_CHECKING:
    from meal_bayes.datasets import Dataset, PerceptTable
    from meal_bayes.datasets.bags import BagReport
    from meal_bayes.domain import Domain

_TOLERANCE = 1e-2  # log-odds by which a table made elsewhere may differ
_LISTED = 5  # files
_COUPLED = 6  # pairs of attributes


@click.group(cls=Section)
def data() -> None:
    """List, download and import data sets, and make percept tables."""


@data.command("list", short_help="List the data sets, or the content of one.")
@click.argument("name", required=False)
@opt.option("--dataset", None, None, "NAME|FILE", "Same as NAME.")
@opt.shared("root", "json")
def list_(name: str | None, dataset: str | None, root: Path | None, as_json: bool) -> None:
    """List the data sets of the package, and how many files of their recordings are here.

    With the NAME of a data set, the path of your own domain (TOML, with --root), or the path of
    your own table (.npz), list its objects and attributes, and for how many objects each
    attribute is true and false.
    """
    from meal_bayes.datasets import cache_folder, load_dataset, load_percepts, verify
    from meal_bayes.datasets.sources import SOURCES

    if name is not None and dataset is not None:
        raise click.UsageError(f"{name} and --dataset {dataset} name a data set; give one of them.")
    dataset = name or dataset
    if dataset is None and root is not None:
        raise click.UsageError("--root is the folder of one data set; name the data set, too.")
    if dataset is not None:
        held = load_dataset(dataset, root=root) if root is not None else load_percepts(dataset)
        _print_contents(held, as_json=as_json)
        return
    rows = []
    for source in SOURCES:
        table = load_percepts(source)
        states = verify(source)
        rows.append(
            {
                "name": source,
                "objects": len(table.objects),
                "behaviors": len(table.domain.behaviors),
                "attributes": len(table.domain.attributes),
                "recordings": table.recordings,
                "files": len(states),
                "files_cached": sum(state == "ok" for _, state in states),
            }
        )
    if as_json:
        terminal.print_json({"datasets": rows, "cache": str(cache_folder())})
        return
    counts = {name: f"{{{name}}}" for name in ("objects", "behaviors", "attributes", "recordings")}
    columns = {"data set": "{name}"} | counts | {"files here": "{files_cached} of {files}"}
    terminal.print_table(columns, rows)
    terminal.note(
        f"Percepts come with the package. The recordings behind them (files) are kept in "
        f"{cache_folder()}; get them with: meal-bayes data fetch NAME"
    )


@data.command(short_help="Download the recordings of a data set.")
@click.argument("dataset")
def fetch(dataset: str) -> None:
    """Download the recordings of a data set once, and verify their checksums."""
    from meal_bayes import datasets

    total = len(datasets.registry(dataset))
    with terminal.output(stderr=True).status(f"fetching {total} files of {dataset} ..."):
        folder = datasets.fetch(dataset)
    terminal.say(f"{dataset}: {total} files in {folder}")


@data.command(short_help="Verify the checksums of downloaded files.")
@click.argument("dataset")
def verify(dataset: str) -> None:
    """Verify the checksums of downloaded files; exit with 1 if a file differs or is missing."""
    from meal_bayes import datasets

    states = datasets.verify(dataset)
    bad = [(path, state) for path, state in states if state != "ok"]
    terminal.say(f"{dataset}: {len(states) - len(bad)} of {len(states)} files are as published")
    for path, state in bad[:_LISTED]:
        terminal.say(f"  {state}: {path}")
    if bad:
        more = f"  and {len(bad) - _LISTED} more; " if len(bad) > _LISTED else "  "
        terminal.say(f"{more}get them with: meal-bayes data fetch {dataset}")
        click.get_current_context().exit(UNSOUND)


@data.command()
@opt.option(
    "--dataset", None, None, "NAME|FILE", "A data set, or your own domain (TOML).", required=True
)
@opt.shared("perception")
@opt.option(
    "--classifier",
    None,
    None,
    "MODULE:NAME",
    "A scikit-learn classifier that replaces those of the package: "
    "sklearn.ensemble:RandomForestClassifier, or an "
    "instance in a module of your own.",
)
@opt.shared("root")
@opt.option("--out", opt.FILE, None, "FILE.npz", "File to write the table to.")
@opt.shared("jobs", "cluster")
def percepts(
    dataset: str,
    perception: str,
    classifier: str | None,
    root: Path | None,
    out: Path | None,
    jobs: int,
    cluster: str | None,
) -> None:
    """Compute a percept table from recordings.

    --out writes the table. The table of a shipped data set is compared with the one in the package.
    --jobs and --cluster compute several behaviors at a time, which does not change the table.
    """
    from meal_bayes.datasets import load_dataset, save_percepts
    from meal_bayes.datasets.sources import SOURCES
    from meal_bayes.errors import SettingsError
    from meal_bayes.experiments.parallel import in_parallel, on_cluster
    from meal_bayes.files import check_output
    from meal_bayes.look import listed
    from meal_bayes.perception import TableSource, build_percept_table

    if out is not None:
        if out.suffix != ".npz":
            raise SettingsError(f"--out {out}: give a name that ends in .npz.")
        check_output(out, inputs=[dataset])
    # A class is taken with its defaults; an instance of the user's as it is.
    estimator = None if classifier is None else opt.named_value(classifier)
    estimator = estimator() if isinstance(estimator, type) else estimator
    # A data set that ships has a table to compare with; an own one must be written somewhere.
    shipped = dataset in SOURCES
    compared = shipped and perception == "default" and classifier is None
    if out is None and not compared:
        raise SettingsError(
            f"The package holds no table of {dataset!r} by {classifier or perception} to compare "
            "with; give --out FILE.npz to write the new one."
        )
    with terminal.output(stderr=True).status(f"reading the recordings of {dataset} ..."):
        recordings = load_dataset(dataset, root=root)
    missing = [] if shipped else recordings.missing()
    if missing:
        terminal.note(f"fewer than {recordings.recordings} recordings: {listed(missing)}")
    shown = terminal.progress(f"percepts of {recordings.domain.name}", "behaviors")
    with on_cluster(cluster), shown as advance:
        table = build_percept_table(
            recordings,
            perception=perception,
            classifier=estimator,
            progress=advance,
            map_behaviors=partial(in_parallel, jobs=jobs),
        )
    if out is not None:
        save_percepts(table, out)
        terminal.say(f"{out}: {_size(table)}")
    found = root is None or dataset.endswith(".toml")  # by `ask` and runs, of these recordings
    if classifier is None and not shipped and found:  # what they would compute once more
        source = TableSource.of(dataset, perception, root=root)
        if not source.path.is_file():
            save_percepts(table, source.path)
    if compared:
        _compare(table, dataset)


def _of_bags(command: opt.Command) -> opt.Command:
    """Add the options that say what is read from bags."""
    for add in (
        opt.option("--feature", None, None, "NAME=MODULE:FUNCTION",
                   "A feature of your own that the domain names; may be repeated.", multiple=True),
        opt.option("--markers", None, None, "TOPIC", "Topic whose texts mark the "
                   'executions: "lift: red mug" begins one, an empty text ends it.'),
        opt.option("--executions", click.Path(exists=True, dir_okay=False, path_type=Path), None,
                   "FILE.csv", "Table of the executions: bag,object,behavior,start,end; times in s "
                   "since the bag's first message, or since 1970."),
        opt.option("--domain", None, None, "FILE.toml",
                   "Your domain, with the sources of its modalities.", required=True),
    ):  # fmt: skip
        command = add(command)
    return command


@data.command("import", short_help="Make recordings from ROS bags.")
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@_of_bags
@opt.option(
    "--out", opt.FOLDER, None, "FOLDER", "Folder to write the recordings to.", required=True
)
@opt.option("--labels", opt.FILE, None, "FILE.csv", "Labels of the objects: object,ATTRIBUTE,...")
def import_(bags: tuple[Path, ...], out: Path, labels: Path | None, **given: Any) -> None:
    """Make recordings from BAGS of ROS 1 or ROS 2 (extra "bags"), or folders of them.

    A line reports each damaged bag and each execution that lacks a signal; the others are imported.
    If the import fails, no folder is written.
    """
    from meal_bayes.datasets.bags import save_recordings
    from meal_bayes.errors import OutputError

    if out.exists():
        raise OutputError(f"{out} exists already; remove it, or give another --out.")
    domain, report = _read_bags(bags, **given)
    rows = [(t.bag, t.topic, f"{t.messages}", f"{t.rate:.1f} Hz", f"{t.gap:.2f} s")
            for t in report.topics]  # fmt: skip
    terminal.print_table(("bag", "topic", "messages", "rate", "longest gap"), rows,
                         left_aligned=("topic",))  # fmt: skip
    for fault in report.faults:
        terminal.say(f"missing: {fault}")
    save_recordings(domain, report, out, labels)
    objects = {one.object_name for one in report.executions}
    terminal.say(f"{out}: {len(report.executions)} executions with {len(objects)} objects")
    if labels is None:
        terminal.note(f"no labels yet: write 1, 0 or nothing in {out / 'labels.csv'}")


@data.command(short_help="Draw signals, windows and features of a bag.")
@click.argument("bag", type=click.Path(path_type=Path))
@_of_bags
@opt.option("--number", opt.COUNT, 1, None, "Number of the execution to draw.")
@opt.option("--out", opt.FILE, Path("execution.png"), "FILE", "PNG, PDF or SVG.")
def show(bag: Path, number: int, out: Path, **given: Any) -> None:
    """Draw the signals of one execution in a BAG, its window, and the features made from them."""
    from meal_bayes.datasets.bags import plot_execution
    from meal_bayes.errors import SettingsError
    from meal_bayes.look import check_figure_name, save

    check_figure_name(out)
    _, report = _read_bags((bag,), keep=number, **given)
    for fault in report.faults:
        terminal.say(f"missing: {fault}")
    kept = [one for one in report.executions if one.signals]
    if not kept:
        raise SettingsError(f"{bag} has {len(report.executions)} executions, and no {number}.")
    save(plot_execution(kept[0]), out)
    sizes = ", ".join(f"{name} {len(vector)}" for name, vector in kept[0].features.items())
    terminal.say(f"{out}: {kept[0]}; features: {sizes}")


def _read_bags(
    bags: tuple[Path, ...], domain: str, feature: tuple[str, ...], **given: Any
) -> "tuple[Domain, BagReport]":
    from meal_bayes.datasets.bags import read_bags
    from meal_bayes.domain import load_domain

    if (given["executions"] is None) == (given["markers"] is None):
        raise click.UsageError("Give either --executions or --markers.")
    own = {name: opt.named_value(value) for name, _, value in (f.partition("=") for f in feature)}
    held = load_domain(domain)
    with terminal.progress("bags", "bags") as advance:
        return held, read_bags(held, bags, functions=own, progress=advance, **given)


def _print_contents(table: "PerceptTable | Dataset", *, as_json: bool) -> None:
    from meal_bayes.experiments import askable
    from meal_bayes.look import listed

    costs = {behavior.name: behavior.cost for behavior in table.domain.behaviors}
    asked = askable(table)
    objects_with = {
        attribute: {"true": int((labels == 1).sum()), "false": int((labels == 0).sum())}
        for attribute, labels in zip(table.domain.attributes, table.labels.T, strict=True)
    }
    together = _coupled(table)
    if as_json:
        names = {"attributes": table.domain.attributes, "objects": table.objects}
        counts = {"objects_with": objects_with, "asked_by_runs": asked, "together": together}
        terminal.print_json({"name": table.domain.name, **names, **counts, "behaviors": costs})
        return
    counted = [
        f"{attribute} {count['true']} of {sum(count.values())}"
        for attribute, count in objects_with.items()
    ]
    facts = {
        "data set": f"{table.domain.name}: {_size(table)}",
        "attributes": f"{', '.join(counted)} objects",
    }
    if len(asked) < len(counted):
        facts["asked by runs"] = (
            f"{', '.join(asked) or 'none'}: with more than {table.domain.asked_minimum} objects "
            "that have it, and that have it not"
        )
    if together:
        pairs = [
            f"{' and '.join(pair['attributes'])} {pair['both']} "
            f"({pair['if_independent']:.0f} if independent)"
            for pair in together
        ]
        facts["both true"] = f"{listed(pairs, _COUPLED)} objects; bayes expects that"
    facts |= {
        "behaviors": ", ".join(f"{name} {cost:g} s" for name, cost in costs.items()),
        "objects": ", ".join(table.objects),
    }
    terminal.print_facts(terminal.output(), facts)


def _coupled(table: "PerceptTable | Dataset") -> "list[dict[str, Any]]":
    """Return the pairs that all labels couple, those that they couple most first."""
    from meal_bayes.agents.base_rates import learn_base_rates
    from meal_bayes.agents.joint_prior import coupled_pairs

    labels = table.labels
    rates = learn_base_rates(table.domain, labels).mean
    coupling = coupled_pairs(table.domain, labels, rates)
    together = []
    for number in (-coupling.log_bayes_factor).argsort(kind="stable").tolist():
        pair = coupling.pairs[number].tolist()
        labeled = labels[(labels[:, pair] >= 0).all(axis=1)][:, pair]
        expected = float((labeled == 1).mean(axis=0).prod()) * len(labeled)
        together.append(
            {
                "attributes": [table.domain.attributes[place] for place in pair],
                "both": int(labeled.all(axis=1).sum()),
                "objects": len(labeled),
                "if_independent": round(expected, 1),
            }
        )
    return together


def _size(table: "PerceptTable | Dataset") -> str:
    return (
        f"{len(table.objects)} objects, {len(table.domain.behaviors)} behaviors, "
        f"{len(table.domain.attributes)} attributes, {table.recordings} recordings"
    )


def _compare(table: "PerceptTable", name: str) -> None:
    """Compare a table with the shipped one; where they differ, the exit code is 1."""
    import numpy as np

    from meal_bayes.datasets import load_percepts

    shipped = load_percepts(name)
    new = table.log_odds.astype(float)
    old = shipped.log_odds.astype(float)
    same = new.shape == old.shape and bool((np.isnan(new) == np.isnan(old)).all())
    if not same:
        terminal.say(f"the table shipped for {name} holds other objects, behaviors or attributes")
    else:
        difference = float(np.nanmax(np.abs(new - old)))
        bins = float((table.training_bins != shipped.training_bins).mean())
        same = difference <= _TOLERANCE
        terminal.say(
            f"against the table that ships for {name}: log-odds differ by at most {difference:.2g} "
            f"({'within' if same else 'beyond'} {_TOLERANCE:g}), {bins:.2%} of the training counts"
        )
    if not same:
        click.get_current_context().exit(UNSOUND)
