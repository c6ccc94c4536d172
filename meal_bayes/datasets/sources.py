"""Recordings by name: where the public data sets lie, how they are fetched, and their files read.

What a reader does to the files stands in its docstring. They are downloaded from pinned commits,
checked, and kept in a cache. Environment: ``MEAL_BAYES_DATA_DIR`` names the cache folder,
``MEAL_BAYES_DATA_URL`` a mirror (an http address or a folder) to read from,
``MEAL_BAYES_OFFLINE=1`` forbids the network.

``SHA256SUMS`` beside this file lists every file that the shipped domains and the paper's items
need, below the mirror base. It was made in a folder mirror of the two repositories at their pinned
commits, by ``sha256sum <files> | sort -k 2 > SHA256SUMS``; ``sha256sum --check SHA256SUMS`` there
repeats it.
"""

import logging
import os
import shutil
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.csv_files import load_csv_folder, read_features, read_rows
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.frames import Context, FeatureRows, add_once, fault, join_features
from meal_bayes.datasets.percepts import load_percepts
from meal_bayes.digests import checksum_of
from meal_bayes.domain import Domain, load_domain, unknown
from meal_bayes.errors import DataError, DownloadError, SettingsError
from meal_bayes.files import checked_path, path_text

log = logging.getLogger("meal_bayes.datasets")

_WITHOUT = "the embedded percepts (`load_percepts`) need no download"
# Subfolders of feature files, as readers and the registry (SHA256SUMS) name them.
_ROC36 = "sensorimotor_features"
_ISPY32 = "corl_features"
_CY101 = "normalized_data_without_noobject"
_OVERFLOW = 2.0**31  # a 32-bit count whose sign bit is set lies this much too low


@dataclass(frozen=True, slots=True)
class Source:
    """The folder of a data set in a public repository (owner/name), at one pinned commit.

    Its subfolder `recordings` holds the feature files; `load` reads a domain's data set from it.
    """

    repository: str
    commit: str
    folder: str
    recordings: str
    load: Callable[[Domain, Path], Dataset]

    @property
    def path(self) -> str:
        """Path below a mirror base: owner/name/commit/folder."""
        return f"{self.repository}/{self.commit}/{self.folder}"


def load_roc36(domain: Domain, folder: Path) -> Dataset:
    """Read ROC36: 36 containers = 3 weights x 3 colors x 4 contents, 10 recordings a behavior.

    The files are `objects.txt` and `sensorimotor_features/<behavior>-<modality>.txt`.

    * Rows name their object but not their recording: rows of one object are numbered 1 to 10 in
      file order.
    * Labels are the three words of an object's name (weight_color_content); every other attribute
      is false.
    * Kept, as it cannot be undone: the features are principal components fitted on all 36 objects,
      held-out ones too, without labels.
    """
    words: dict[str, list[str]] = {}
    for where, cells in read_rows(folder / "objects.txt"):
        name = ",".join(cells)
        if len(name.split("_")) != 3:
            raise fault(where, f"{name!r}", "weight_color_content", "restore the name")
        add_once(words, where, name, name.split("_"))

    # Recordings have no number in the files: count the rows of each object.
    def numbered(_: Context, rows: FeatureRows) -> FeatureRows:
        numbers: dict[str, Iterator[int]] = defaultdict(lambda: count(1))
        return rows._replace(keys=[(name, str(next(numbers[name]))) for (name,) in rows.keys])

    files = folder / _ROC36 / "{}-{}.txt"
    features = _features(domain, list(words), files, ["object"], recordings=10, keyed=numbered)
    return Dataset(
        domain, tuple(words), features, _labels(domain, words, "ROC36"), rows_checked=True
    )


def load_ispy32(domain: Domain, folder: Path) -> Dataset:
    """Read ISPY32: 32 household objects, 81 words people said of them, 5 recordings a behavior.

    The files are `object_list.csv`, `labels.csv` and `corl_features/<behavior>_<modality>.txt`.

    * Column two, the trial number, is a key and not a feature.
    * Labels are those of the percept table that ships, which come from
      `full_annotations_ijcai2016.pickle`; no pickle is read.
    * `labels.csv` has what players of a game said of some pairs of word and object (1, -1; 0 where
      nobody was asked). They are a second rater, who answers where a person is asked; the paper's
      experiments did not use them.
    * Kept as they are: objects 22 and 24 are both heavy and light.
    """
    names: dict[str, str] = {}  # by number
    for where, cells in read_rows(folder / "object_list.csv"):
        number = str(len(names) + 1)
        if cells[1:] != [number]:
            raise fault(where, f"{','.join(cells)[:60]!r}", f"name,{number}", "restore the row")
        names[cells[1]] = cells[0]
    objects = tuple(names.values())

    def named(_: Context, rows: FeatureRows) -> FeatureRows:
        keys = [(names.get(number, number), trial) for number, trial in rows.keys]
        return rows._replace(keys=keys)

    files = folder / _ISPY32 / "{}_{}.txt"
    features = _features(domain, objects, files, ["object", "trial"], recordings=5, keyed=named)
    table = load_percepts("ispy32", domain=domain)
    for name in objects:
        if name not in table.objects:
            reason = unknown("object", name, table.objects)
            raise DataError(f"ISPY32 has no labels of it. {reason}")
    labels = table.labels[[table.objects.index(name) for name in objects]]
    answers = _second_rater(domain, folder / "labels.csv", [*names])
    return Dataset(domain, objects, features, labels, answers=answers, rows_checked=True)


def _second_rater(domain: Domain, path: Path, numbers: list[str]) -> NDArray[np.int8]:
    """Read what was said of objects, by their numbers, and of a domain's attributes, (O,P)."""
    answers = np.full((len(numbers), len(domain.attributes)), -1, np.int8)
    said = {"1.0": 1, "-1.0": 0, "0.0": -1}
    columns = list[str]()
    for where, (word, *cells) in read_rows(path):
        if not columns:
            columns = cells
            if not {*numbers} <= {*columns}:
                raise fault(where, "other columns", f"predicate,{numbers[0]},...", "restore them")
        elif len(cells) != len(columns) or not {*cells} <= {*said}:
            expected = f"a word and {len(columns)} cells, 1.0, -1.0 or 0.0"
            raise fault(where, f"{','.join([word, *cells])[:60]!r}", expected, "restore the row")
        elif word in domain.attributes:
            of_object = dict(zip(columns, cells, strict=True))
            p = domain.attribute_index(word)
            answers[:, p] = [said[of_object[number]] for number in numbers]
    return answers


def load_cy101(domain: Domain, folder: Path) -> Dataset:
    """Read CY101: 100 household objects, 5 recordings a behavior.

    The files are `objects.txt`, `cy101_labels.csv` and `normalized_data_without_noobject/`.

    * Rows come in another order in each file; they are joined by their key `<object>_t<k>`.
    * The 101st object, `no_object`, has labels but no recordings and is left out.
    * One look_color count (`smallstuffedanimal_moose_t2`) has its 32-bit sign bit set
      (-2147483519); 2^31 is added, which gives 129 and is logged.
    * Kept: recordings that are copies of another, of the same object (`basket_cylinder_t5` of
      nearly all behaviors, `ball_blue` look, `noodle_1` tap, `smallstuffedanimal_otter` hold) or of
      another object (crush_vibro: `cannedfood_tomato_paste_t1` equals `ball_base_t1`).
    * An absent word counts as false; repeated words count once; spaces around a word are removed.
    """
    listed = (cells[0] for _, cells in read_rows(folder / "objects.txt"))
    objects = tuple(name for name in listed if name != "no_object")
    path = folder / "cy101_labels.csv"
    words: dict[str, set[str]] = {}
    for where, cells in read_rows(path):
        if cells == ["object", "words"]:
            continue
        if len(cells) != 2:  # object, words
            expected = 'object,"word, word, ..."'
            raise fault(where, f"{len(cells)} columns", expected, "quote the words")
        add_once(words, where, cells[0], {word.strip() for word in cells[1].split(", ")} - {""})
    for name in objects:
        if name not in words:
            raise DataError(f"{path}: found no row of object {name!r}; add {name},<words>.")
    labels = _labels(domain, {name: words[name] for name in objects}, "CY101")

    def corrected(context: Context, rows: FeatureRows) -> FeatureRows:
        """Split the keys `<object>_t<k>`, and mend counts (in double precision: single rounds)."""
        keys = [key.rpartition("_t")[::2] if "_t" in key else (key, "") for (key,) in rows.keys]
        if context[1] != "color":
            return rows._replace(keys=keys)
        # No count is below 0 but by its sign bit.
        low = rows.values < -_OVERFLOW / 2
        for row, column in np.argwhere(low):
            where = f"{Path(rows.places[row]).name}, feature {column + 1}"
            log.info("cy101: added 2^31 to the count of %s in %s", rows.keys[row][0], where)
        values = np.where(low, rows.values + _OVERFLOW, rows.values)
        return rows._replace(keys=keys, values=values)

    files = folder / _CY101 / "{}_{}.txt"
    features = _features(domain, objects, files, ["object_t<k>"], recordings=5, keyed=corrected)
    return Dataset(domain, objects, features, labels, rows_checked=True)


def _features(
    domain: Domain,
    objects: Sequence[str],
    files: Path,
    key_columns: Sequence[str],
    *,
    recordings: int,
    keyed: Callable[[Context, FeatureRows], FeatureRows],
) -> dict[Context, NDArray[np.float32]]:
    """Read and join the files of a domain; `keyed` gives rows the keys (object, recording)."""
    paths = ((context, files.with_name(files.name.format(*context))) for context in domain.contexts)
    contexts = ((context, keyed(context, read_features(p, key_columns))) for context, p in paths)
    return join_features(objects, contexts, recordings)


def _labels(domain: Domain, words: Mapping[str, Collection[str]], name: str) -> NDArray[np.int8]:
    """Return the labels (O,P) of objects that are named by words; `DataError` where none fits."""
    # An attribute that no object has is misspelled, here or in the files.
    vocabulary = set().union(*words.values())
    for attribute in domain.attributes:
        if attribute not in vocabulary:
            raise DataError(f"{name} has no labels of it. {unknown('word', attribute, vocabulary)}")
    return np.array([[a in true for a in domain.attributes] for true in words.values()], np.int8)


# Repository and commit, as they stand in each path of SHA256SUMS too.
_POMDP = ("shiqizhang6/perception_pomdp", "4ab4abf1a47ce184f0327d3c143533d482c2604c")
_LEARNING = ("keke-220/Predicate_Learning", "62b9e1efa8b4cf990a68c3526a9ae872d8a6b1ad")
SOURCES = {
    "roc36": Source(*_POMDP, "data/icra2014", _ROC36, load_roc36),
    "ispy32": Source(*_POMDP, "data/ijcai2016", _ISPY32, load_ispy32),
    "cy101": Source(*_LEARNING, "data/cy101", _CY101, load_cy101),
}


def source(data: str) -> Source:
    """Return the source of a data set; `SettingsError` where there is none of that name."""
    if data not in SOURCES:
        raise SettingsError(unknown("data set", data, SOURCES))
    return SOURCES[data]


def find_folder(data: str, root: Path) -> Path:
    """Return a data set's folder below a mirror, in a clone of its repository, or at `root`."""
    home = source(data)
    # A mirror of the address, a clone of the repository, or the folder itself.
    for folder in (root / home.path, root / home.folder, root):
        if (folder / home.recordings).is_dir():
            return folder
    raise DataError(
        f"{root}: found no recordings of {data}; expected {home.path}/{home.recordings} below it; "
        f"give a folder mirror, a clone of {home.repository}, or leave root out to download."
    )


def load_dataset(name: str | Path, *, root: str | Path | None = None) -> Dataset:
    """Load the recordings of a domain's data set.

    Parameters
    ----------
    name : str | Path
        Name of a shipped domain, or the path of your own domain file (TOML).
    root : str | Path | None
        Folder of the files. For your own data it is the folder of CSV files. For public data it is
        a mirror or a clone of the repository; without it, the files are downloaded once and
        checked.

    Raises
    ------
    SettingsError
        The domain is unknown, or `root` is missing although the data are your own.
    DataError
        The files do not have the expected layout.
    DownloadError
        The files cannot be downloaded.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> from tempfile import TemporaryDirectory
    >>> from meal_bayes.datasets import make_synthetic
    >>> rng = np.random.default_rng(0)
    >>> data = make_synthetic(meal_bayes.load_domain("toy"), objects=4, recordings=2, rng=rng)
    >>> with TemporaryDirectory() as folder:
    ...     meal_bayes.save_csv_folder(data, folder)
    ...     again = meal_bayes.load_dataset("toy", root=folder)
    >>> again.objects == data.objects
    True
    """
    if str(path_text(name)).endswith(".npz"):
        raise SettingsError(
            f"{name} is a percept table, which holds no recordings; give the domain (a shipped "
            "name, or the path of its TOML) and, for your own, the folder of the CSV files."
        )
    domain = load_domain(name)
    if domain.data not in SOURCES:
        if root is None:
            raise SettingsError(
                f"Domain {domain.name!r} has no public recordings (those are {list(SOURCES)}); "
                "give root=<folder of your CSV files>, or make data with make_synthetic."
            )
        return load_csv_folder(domain, checked_path("root", root))
    if root is None:
        root = fetch(domain.data)
    return SOURCES[domain.data].load(domain, find_folder(domain.data, checked_path("root", root)))


def cache_folder() -> Path:
    """Return the cache folder: ``MEAL_BAYES_DATA_DIR``, or the cache folder of the system."""
    import pooch  # noqa: PLC0415  loaded when needed, so that the package loads NumPy only

    named = os.environ.get("MEAL_BAYES_DATA_DIR")
    if named:
        return checked_path("MEAL_BAYES_DATA_DIR", named)
    try:
        return Path(pooch.os_cache("meal_bayes")).expanduser()
    except RuntimeError:  # as of a user without an account
        raise SettingsError(
            "This user has no home folder, and so no cache; set MEAL_BAYES_DATA_DIR to a folder "
            "that can be written."
        ) from None


def registry(data: str) -> dict[str, str]:
    """Return the SHA-256 checksums of a data set's files, by their paths below the mirror."""
    folder = f"{source(data).path}/"
    listed = Path(__file__).with_name("SHA256SUMS").read_text(encoding="ascii")
    rows = [line.split("  ", 1) for line in listed.splitlines()]
    return {path: digest for digest, path in rows if path.startswith(folder)}


def verify(data: str) -> list[tuple[Path, str]]:
    """Verify the checksums of the downloaded files: "ok", "missing" or "changed" for each."""
    states = []
    for name, digest in registry(data).items():
        path = cache_folder() / name
        state = "missing"
        if path.is_file():
            same = checksum_of(path) == digest
            state = "ok" if same else "changed"
        states.append((path, state))
    return states


def fetch(data: str) -> Path:
    """Download a data set's files into the cache, and return the cache folder.

    A file whose checksum is wrong is downloaded again.

    Raises
    ------
    DownloadError
        A file cannot be downloaded, or its checksum is wrong.
    """
    import pooch  # noqa: PLC0415  as above

    folder = cache_folder()
    base = os.environ.get("MEAL_BAYES_DATA_URL") or "https://raw.githubusercontent.com"
    base = str(path_text(base.removeprefix("file://"))).rstrip("/") + "/"
    if os.environ.get("MEAL_BAYES_OFFLINE", "0") not in ("", "0"):
        bad = [(path, state) for path, state in verify(data) if state != "ok"]
        if bad:
            path, state = bad[0]
            raise DownloadError(
                f"{path} is {state} ({len(bad)} files of {data} in all), and MEAL_BAYES_OFFLINE "
                "forbids the network; unset it, or set MEAL_BAYES_DATA_DIR to a folder that holds "
                f"them; {_WITHOUT}."
            )
        return folder
    pooch.get_logger().setLevel("WARNING")  # it would log every file on the terminal
    # Each file is checked by its digest, also where a mirror gave it.
    keeper = pooch.create(path=folder, base_url=base, registry=registry(data))
    web = base.startswith(("http://", "https://"))
    copy = pooch.HTTPDownloader() if web else lambda url, target, _: shutil.copyfile(url, target)
    for name in keeper.registry:
        try:
            keeper.fetch(name, downloader=copy)
        except (OSError, ValueError) as error:  # ValueError: another checksum; nothing was kept
            raise DownloadError(
                f"Cannot get {base}{name} into {folder} ({' '.join(str(error).split())[:400]}); "
                "set MEAL_BAYES_DATA_URL to a mirror (an http address or a folder) of the pinned "
                "commits, or MEAL_BAYES_DATA_DIR to a folder that can be written; "
                f"{_WITHOUT}."
            ) from error
    return folder
