"""Table 2: how many features ISPY32's behaviors and modalities have, in the public files."""

from meal_bayes import load_dataset
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.statements import STANDS, Statement, fact

NAMES = {"shape": "fpfh", "vgg": "fc7", "audio": "corl-audio"}  # the paper's name: the files'


def run(setting: Setting) -> Result:
    """Read the recordings; raises `DownloadError` where they cannot be had."""
    paper = paper_values("table2")
    sizes = {key: values.shape[-1] for key, values in load_dataset("ispy32").features.items()}
    behaviors = dict.fromkeys(behavior for behavior, _ in sizes)
    rows: list[tuple[Cell, ...]] = []
    statements = []
    for behavior in behaviors:
        printed = paper.get(behavior, paper["others"])
        files = {NAMES.get(name, name): (name, number) for name, number in printed.items()}
        for modality in dict.fromkeys([*files, *(m for b, m in sizes if b == behavior)]):
            name, number = files.get(modality, (modality, None))
            found = sizes.get((behavior, modality))
            rows.append(
                (behavior, name if name == modality else f"{name} ({modality})", number, found)
            )
            if number is not None:
                text = f"{behavior} {name} has {number} features"
                rule = f"the files hold {number} (they hold {found or 'none'})"
                statements.append(Statement(text, fact(found == number, rule)))
    same = sum(one.as_dict()["recorded"] == STANDS for one in statements)
    return Result(
        title="Features of ISPY32's contexts",
        paper=f"{len(statements)} sizes",
        ours=f"{len(sizes)} contexts, {same} of the sizes",
        tables=(Table("features", ("behavior", "modality", "paper", "files"), tuple(rows)),),
        statements=tuple(statements),
        notes=(
            "A dash under files: the public files hold no such features. Modalities that the paper "
            "does not list are used as well.",
        ),
    )
