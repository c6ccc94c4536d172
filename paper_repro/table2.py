"""Table 2: how many features ISPY32's behaviors and modalities have, in the public files."""

from frame import Cell, Claim, Result, Setting, Table, main, paper_values

from meal_bayes import load_dataset

NAMES = {"shape": "fpfh", "vgg": "fc7", "audio": "corl-audio"}  # the paper's name: the files'


def run(setting: Setting) -> Result:
    """Read the recordings; raises `DownloadError` where they cannot be had."""
    paper = paper_values("table2")
    sizes = {key: values.shape[-1] for key, values in load_dataset("ispy32").features.items()}
    behaviors = dict.fromkeys(behavior for behavior, _ in sizes)
    rows: list[tuple[Cell, ...]] = []
    claims = []
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
                claims.append(Claim(f"{behavior} {name} has {number} features", found == number))
    return Result(
        item="table2",
        title="Features of ISPY32's contexts",
        paper=f"{len(claims)} sizes",
        ours=f"{len(sizes)} contexts, {sum(bool(claim.recorded) for claim in claims)} of the sizes",
        tables=(Table("features", ("behavior", "modality", "paper", "files"), tuple(rows)),),
        claims=tuple(claims),
        notes=(
            "A dash under files: the public files hold no such features. Modalities that the paper "
            "does not list are used as well.",
        ),
    )


if __name__ == "__main__":
    main(run)
