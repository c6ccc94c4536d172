"""Table 2: how many features ISPY32's behaviors and modalities have, in the public files."""

from meal_bayes import load_dataset
from paper_repro.frame import Cell, Result, Setting, Table, paper_values
from paper_repro.statements import THEIRS, constructed

NAMES = {"shape": "fpfh", "vgg": "fc7", "audio": "corl-audio"}  # the paper's name: the files'


def run(setting: Setting) -> Result:
    """Read the recordings; raises `DownloadError` where they cannot be had."""
    paper = paper_values("table2")
    sizes = {key: values.shape[-1] for key, values in load_dataset("ispy32").features.items()}
    behaviors = dict.fromkeys(behavior for behavior, _ in sizes)
    rows: list[tuple[Cell, ...]] = []
    same = listed = 0
    for behavior in behaviors:
        printed = paper.get(behavior, paper["others"])
        files = {NAMES.get(name, name): (name, number) for name, number in printed.items()}
        for modality in dict.fromkeys([*files, *(m for b, m in sizes if b == behavior)]):
            name, number = files.get(modality, (modality, None))
            size = sizes.get((behavior, modality))
            rows.append(
                (behavior, name if name == modality else f"{name} ({modality})", number, size)
            )
            if number is not None:
                same = same + (size == number)
                listed = listed + 1
    rule = f"read from the files: {same} of {listed}"
    return Result(
        title="Features of ISPY32's contexts",
        sentence=f"Of the {listed} sizes that the paper prints, {same} are those of the files.",
        tables=(Table("features", ("behavior", "modality", "paper", "files"), tuple(rows)),),
        evidence={THEIRS: {"features have the printed sizes": constructed(rule)}},
        notes=(
            "A dash under files: the public files hold no such features. Modalities that the paper "
            "does not list are used as well.",
        ),
    )
